"""PackedForces: compressed contact forces of a long path.

One minute of touch is some 50 MB of forces on the nodes of a standard skin. Most of them are zero, and most others
change little from sample to sample. A bake packs its forces after the tracks are computed, and uses them only for
drawing, plots and sums. Forces are stored as whole numbers by their second differences in time. The error of a force is
at most 1 / 65,536 of the largest one within `BLOCK` samples, which is a twentieth of the tolerance of contact. Packing
unpacked forces again does not change them.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arrays import Array, Indices
from ..errors import DermisError
from ..skin.nodal_forces import NodalForces
from ..skin.point_forces import PointForces
from ..skin.surface_compliance import SurfaceCompliance

BLOCK = 64  # number of samples that are packed together
BITS = 16  # number of bits of the largest force in a block
PLANES = 3  # bytes of a second difference: 16 bits of the force, two bits for the differences, and a sign

Floats32 = NDArray[np.float32]


class Decoded(NamedTuple):
    """Unpacked forces of a block.

    Attributes:
        places: indices of the places that carry force in any sample, shape (c,).
        present: whether each place carries force in each sample, shape (n, c).
        force: forces [N], shape (n, c, 3).
    """

    places: NDArray[np.int32]
    present: NDArray[np.bool_]
    force: Floats32


class _Block(NamedTuple):
    """Packed forces of a block.

    Attributes:
        places: as in `Decoded`.
        rows: number of samples.
        unit: unit of the whole numbers [N].
        present: compressed changes of presence.
        force: compressed second differences in time, byte by byte.
    """

    places: NDArray[np.int32]
    rows: int
    unit: float
    present: bytes
    force: bytes


class PackedForces:
    """Packed forces of a sequence of samples, each on few of many places.

    `np.asarray` unpacks them to shape (k, places, 3).

    Args:
        samples: for each sample, indices of places in any order, shape (c,), and forces on them [N], shape (c, 3).
        places: number of all places.

    Raises:
        DermisError: a force is not finite.
    """

    def __init__(self, samples: Iterable[tuple[Indices | NDArray[np.int32], Array | Floats32]], places: int) -> None:
        given = iter(samples)
        self._blocks: list[_Block] = []
        self._count, self._places = 0, places
        while some := list(islice(given, BLOCK)):
            self._blocks.append(_packed(some))
            self._count += len(some)
        self._last: tuple[int, Decoded] | None = None  # last unpacked block: reads are usually in order

    def __len__(self) -> int:
        return self._count

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the unpacked array."""
        return self._count, self._places, 3

    @property
    def nbytes(self) -> int:
        """Size in memory [bytes]."""
        return sum(b.places.nbytes + len(b.present) + len(b.force) for b in self._blocks)

    def at(self, k: int) -> tuple[NDArray[np.int32], Floats32]:
        """Return the places of a sample, rising, shape (c,), and the forces on them [N], shape (c, 3)."""
        if not 0 <= k < self._count:
            raise IndexError(k)
        number, row = divmod(k, BLOCK)
        if self._last is None or self._last[0] != number:
            self._last = number, _decoded(self._blocks[number])
        block = self._last[1]
        return block.places[block.present[row]], block.force[row][block.present[row]]

    def decoded(self) -> Iterator[Decoded]:
        """Yield the unpacked forces of one block after the other."""
        return map(_decoded, self._blocks)

    def __array__(self, dtype: DTypeLike = None, copy: bool | None = None) -> NDArray[Any]:
        out = np.zeros(self.shape, np.float32)
        start = 0
        for block in self.decoded():
            end = start + len(block.force)
            out[start:end, block.places] = block.force
            start = end
        return out if dtype is None else out.astype(dtype, copy=False)

    def __getitem__(self, k: int) -> Floats32:
        """Return the forces of a sample on all places [N], shape (places, 3)."""
        out = np.zeros(self.shape[1:], np.float32)
        places, force = self.at(k)
        out[places] = force
        return out


class SpreadForces:
    """Forces on the nodes of a mesh, computed from packed forces on points when they are read.

    `np.asarray` returns them with shape (k, nodes, 3).

    Args:
        points: packed forces on cells of a smooth pad.
        nodes: map from forces on cells to forces on nodes.
    """

    def __init__(self, points: PackedForces, nodes: NodalForces) -> None:
        self._points, self._nodes = points, nodes

    def __len__(self) -> int:
        return len(self._points)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the unpacked array."""
        return len(self._points), len(self._nodes.mesh.pad), 3

    def __array__(self, dtype: DTypeLike = None, copy: bool | None = None) -> NDArray[Any]:
        out = np.zeros(self.shape, np.float32)
        for k in range(len(out)):
            out[k] = self[k]
        return out if dtype is None else out.astype(dtype, copy=False)

    def __getitem__(self, k: int) -> Floats32:
        """Return the forces of a sample on all nodes [N], shape (nodes, 3)."""
        cells, force = self._points.at(k)
        return self._nodes.spread(cells.astype(np.intp), force).astype(np.float32)


@dataclass(frozen=True, eq=False)
class PackedPoints:
    """Forces on points of the smooth skin over a scene, packed; see `PointRecord`.

    Attributes:
        surface: the smooth pad.
        packed: packed forces on its cells.
    """

    surface: SurfaceCompliance
    packed: PackedForces

    def at(self, k: int) -> PointForces:
        """Return the forces of the k-th sample in contact."""
        cells, force = self.packed.at(k)
        return PointForces(self.surface, cells.astype(np.intp), force.astype(np.float64))

    @property
    def starts(self) -> NDArray[np.intp]:
        """Index in `cells` and `force` at which each sample in contact begins, and their length, shape (k + 1,)."""
        counts = [block.present.sum(axis=1) for block in self.packed.decoded()]
        return np.concatenate([np.zeros(1, np.intp), np.cumsum(np.concatenate([np.zeros(0, np.intp), *counts]))])

    @property
    def cells(self) -> NDArray[np.int32]:
        """Indices of the loaded cells of all samples, shape (n,)."""
        every = [np.broadcast_to(b.places, b.present.shape)[b.present] for b in self.packed.decoded()]
        return np.concatenate([np.zeros(0, np.int32), *every])

    @property
    def force(self) -> Floats32:
        """Forces on `cells` [N], shape (n, 3)."""
        return np.concatenate([np.zeros((0, 3), np.float32), *(b.force[b.present] for b in self.packed.decoded())])


def _packed(samples: Sequence[tuple[Indices | NDArray[np.int32], Array | Floats32]]) -> _Block:
    places = np.unique(np.concatenate([own for own, _ in samples])).astype(np.int32)
    present = np.zeros((len(samples), len(places)), np.bool_)
    force = np.zeros((*present.shape, 3))
    for row, (own, loads) in enumerate(samples):
        at = np.searchsorted(places, own)
        present[row, at] = True
        force[row, at] = loads
    most = float(np.abs(force).max(initial=0.0))
    if not math.isfinite(most):
        raise DermisError("a force on the skin is no finite number", where="skin contact", value=most)
    part, exponent = math.frexp(most)
    unit = 2.0 ** (exponent - (part == 0.5) - BITS)  # packing again gives the same unit, or a fraction of it
    turned = np.rint(force / unit).astype(np.int32).reshape(len(samples), -1)
    for _ in range(2):
        turned = np.diff(turned, axis=0, prepend=np.zeros((1, turned.shape[1]), np.int32))
    folded = np.ascontiguousarray((turned << 1 ^ turned >> 31).T)  # zigzag code: sign in the lowest bit
    planes = folded.astype("<i4").view(np.uint8).reshape(-1, 4).T[:PLANES]
    came = np.packbits(np.diff(present, axis=0, prepend=np.zeros((1, len(places)), np.bool_)))
    return _Block(places, len(samples), unit, zlib.compress(came.tobytes()), zlib.compress(planes.tobytes()))


def _decoded(block: _Block) -> Decoded:
    count, wide = block.rows, len(block.places)
    bits = np.unpackbits(np.frombuffer(zlib.decompress(block.present), np.uint8), count=count * wide)
    present = np.logical_xor.accumulate(bits.reshape(count, wide).astype(np.bool_), axis=0)
    planes = np.zeros((4, 3 * wide * count), np.uint8)
    planes[:PLANES] = np.frombuffer(zlib.decompress(block.force), np.uint8).reshape(PLANES, -1)
    folded = np.ascontiguousarray(planes.T).view("<i4").reshape(3 * wide, count).T
    turned = folded >> 1 ^ -(folded & 1)
    for _ in range(2):
        turned = np.cumsum(turned, axis=0, dtype=np.int32)
    return Decoded(block.places, present, (turned * block.unit).astype(np.float32).reshape(count, wide, 3))

"""PackedForces: contact forces of a long path in little memory: whole numbers, as they change, with few bits each.

A finger's minute of touch is some 50 MB of forces on the nodes of a standard skin, most of which are zero, and most
others nearly as they were a sample before. Forces that a bake keeps once its tracks are made are packed: they are
drawn, plotted and summed up, and no track is made from them. A force is then off by 1 / 65,536 of the largest one
within `BLOCK` samples at most, a twentieth of what contact is solved to. Packing it again changes nothing.
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

BLOCK = 64  # samples that are packed together
BITS = 16  # of the largest force among them
PLANES = 3  # bytes of a second difference: 16 bits, two for the differences, and a sign

Floats32 = NDArray[np.float32]


class Decoded(NamedTuple):
    """Forces of some samples: on which places (c,), whether there was one (n, c), and how large [N] (n, c, 3)."""

    places: NDArray[np.int32]
    present: NDArray[np.bool_]
    force: Floats32


class _Block(NamedTuple):
    """The same, packed: the unit of the forces [N], their second differences in time by byte, and bits of presence."""

    places: NDArray[np.int32]
    rows: int
    unit: float
    present: bytes
    force: bytes


class PackedForces:
    """Forces on few of many places, sample after sample; `np.asarray` unpacks them, shape (k, places, 3).

    Args:
        samples: places, rising or not, shape (c,), and finite forces on them [N], shape (c, 3), of each sample.
        places: how many there are.

    Raises:
        DermisError: a force that is no finite number.
    """

    def __init__(self, samples: Iterable[tuple[Indices | NDArray[np.int32], Array | Floats32]], places: int) -> None:
        given = iter(samples)
        self._blocks: list[_Block] = []
        self._count, self._places = 0, places
        while some := list(islice(given, BLOCK)):
            self._blocks.append(_packed(some))
            self._count += len(some)
        self._last: tuple[int, Decoded] | None = None  # whoever looks at one sample looks at the next

    def __len__(self) -> int:
        return self._count

    @property
    def shape(self) -> tuple[int, int, int]:
        """Of the array that it unpacks to."""
        return self._count, self._places, 3

    @property
    def nbytes(self) -> int:
        """How much memory it takes."""
        return sum(b.places.nbytes + len(b.present) + len(b.force) for b in self._blocks)

    def at(self, k: int) -> tuple[NDArray[np.int32], Floats32]:
        """Return the places of a sample, rising, and the forces on them [N]."""
        if not 0 <= k < self._count:
            raise IndexError(k)
        number, row = divmod(k, BLOCK)
        if self._last is None or self._last[0] != number:
            self._last = number, _decoded(self._blocks[number])
        block = self._last[1]
        return block.places[block.present[row]], block.force[row][block.present[row]]

    def decoded(self) -> Iterator[Decoded]:
        """Yield the forces of `BLOCK` samples after the other."""
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
    """Forces on the nodes of a mesh, brought there from those on points; `np.asarray` gives them, shape (k, nodes, 3).

    Args:
        points: the forces on cells of a smooth pad.
        nodes: converts them to forces on the nodes.
    """

    def __init__(self, points: PackedForces, nodes: NodalForces) -> None:
        self._points, self._nodes = points, nodes

    def __len__(self) -> int:
        return len(self._points)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Of the array that it unpacks to."""
        return len(self._points), len(self._nodes.mesh.pad), 3

    @property
    def nbytes(self) -> int:
        """How much memory it takes beside the points."""
        return 0

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
        surface: the smooth pad. packed: the forces on its cells.
    """

    surface: SurfaceCompliance
    packed: PackedForces

    def at(self, k: int) -> PointForces:
        """Return the forces of the k-th sample in contact."""
        cells, force = self.packed.at(k)
        return PointForces(self.surface, cells.astype(np.intp), force.astype(np.float64))

    @property
    def starts(self) -> NDArray[np.intp]:
        """Where each sample in contact begins in the others, and their length, shape (k + 1,)."""
        counts = [block.present.sum(axis=1) for block in self.packed.decoded()]
        return np.concatenate([np.zeros(1, np.intp), np.cumsum(np.concatenate([np.zeros(0, np.intp), *counts]))])

    @property
    def cells(self) -> NDArray[np.int32]:
        """Cells of the pad's tree, shape (n,)."""
        every = [np.broadcast_to(b.places, b.present.shape)[b.present] for b in self.packed.decoded()]
        return np.concatenate([np.zeros(0, np.int32), *every])

    @property
    def force(self) -> Floats32:
        """Forces on them [N], shape (n, 3)."""
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
    unit = 2.0 ** (exponent - (part == 0.5) - BITS)  # forces packed again meet the same unit, or a part
    turned = np.rint(force / unit).astype(np.int32).reshape(len(samples), -1)
    for _ in range(2):
        turned = np.diff(turned, axis=0, prepend=np.zeros((1, turned.shape[1]), np.int32))
    folded = np.ascontiguousarray((turned << 1 ^ turned >> 31).T)  # small numbers of either sign become small ones
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

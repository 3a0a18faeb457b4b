"""Stiffening: all that skin of one shape and Poisson's ratio does beyond linear skin.

Forces f [N] on skin of modulus E displace it by u = C f - U n(q), where q + n(q) = U' f / E: U holds a few patterns of
displacement, n is the force that stiffening takes in them. E only scales; the mesh that skin is solved on, or points of
the smooth skin, ask for the patterns where they need them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError
from ..files import write_npz
from ..npz import opened_npz
from .energy import Energy
from .following import Following
from .patterns import Patterns
from .stress_series import StressSeries
from .symmetric import packed_cubic, packed_quartic, side, whole_cubic, whole_quartic

VERSION = 1
_ARRAYS = "version key cubic quartic reach centres displacement nodes tetrahedra fields squares cubes".split()
_FLOATS = "cubic quartic reach centres displacement nodes fields squares cubes".split()
_FOLLOWING = ("following", "following_squares", "following_cubes")
_HALF = ("fields", "squares", "cubes")  # each row by its largest number: stress is then good to 0.05 %


@dataclass(frozen=True, eq=False)
class Stiffening:
    """What a skin's tissue adds to its linearisation at rest, at E = 1.

    Attributes:
        energy: beyond linear tissue's. patterns: of displacement. stress: beyond linear tissue's.
        key: of the shape and Poisson's ratio that it was made for.
        following: how tissue follows; None where stress is told by its series alone.
    """

    energy: Energy
    patterns: Patterns
    stress: StressSeries
    key: str = ""
    following: Following | None = None

    @property
    def count(self) -> int:
        """Number of patterns k."""
        return self.energy.count

    def write(self, path: Path) -> None:
        """Write it as plain arrays, each number as short as its error allows.

        Raises:
            DermisError: the file cannot be written.
        """
        stress = self.stress
        arrays: dict[str, NDArray[Any]] = {
            "version": np.array(VERSION),
            "key": np.array(self.key),
            "cubic": packed_cubic(self.energy.cubic).astype(np.float32),
            "quartic": packed_quartic(self.energy.quartic).astype(np.float32),
            "reach": np.zeros(0) if self.energy.reach is None else self.energy.reach,
            "centres": self.patterns.centres,
            "displacement": self.patterns.at(self.patterns.centres),
            "nodes": stress.nodes,
            "tetrahedra": stress.tetrahedra.astype(np.int32),
        }
        fields = stress.fields.reshape(-1, stress.fields.shape[-1]).T
        for name, rows in zip(_HALF, (fields, stress.squares, stress.cubes), strict=True):
            arrays[name], arrays[f"{name}_scale"] = _halved(rows)
        if self.following is not None:
            fields = self.following.fields.reshape(-1, self.following.fields.shape[-1]).T
            for name, rows in zip(_FOLLOWING, (fields, self.following.squares, self.following.cubes), strict=True):
                arrays[name], arrays[f"{name}_scale"] = _halved(rows)
        write_npz(path, arrays)

    @classmethod
    def read(cls, path: Path) -> Stiffening:
        """Read what `write` wrote.

        Raises:
            DermisError: the file cannot be read, is of another version, or its arrays do not fit together.
        """
        where = str(path)
        with opened_npz(path, kind="the table of a skin that stiffens") as archive:
            halves = _HALF + (_FOLLOWING if _FOLLOWING[0] in archive.names else ())
            found = archive.arrays([*_ARRAYS, *_FOLLOWING[: len(halves) - 3], *(f"{name}_scale" for name in halves)])
        version = found["version"]
        if version.shape != () or version.dtype.kind not in "iu" or int(version) != VERSION:
            raise DermisError(
                "a table of a skin that stiffens, of another version",
                where=where,
                value=str(version)[:40],
                limit=str(VERSION),
                remedy="Delete it: it is made again",
            )
        if not _fits(found):
            raise DermisError("a stiffening skin's arrays do not fit", where=where, value=found["displacement"].shape)
        rows = {name: found[name].astype(np.float32) * found[f"{name}_scale"][:, None] for name in halves}
        fields = rows["fields"].T.reshape(len(found["tetrahedra"]), 6, -1)
        following = None
        if len(halves) > len(_HALF):
            moved, squares, cubes = (np.ascontiguousarray(rows[name]) for name in _FOLLOWING)
            following = Following(np.ascontiguousarray(moved.T.reshape(len(found["nodes"]), 4, -1)), squares, cubes)
        return cls(
            Energy(
                whole_cubic(found["cubic"]).astype(np.float32),
                whole_quartic(found["quartic"]).astype(np.float32),
                found["reach"] if found["reach"].size else None,
            ),
            Patterns.through(found["centres"], found["displacement"]),
            StressSeries(
                found["nodes"],
                found["tetrahedra"],
                np.ascontiguousarray(fields),
                np.ascontiguousarray(rows["squares"]),
                np.ascontiguousarray(rows["cubes"]),
            ),
            str(found["key"]),
            following,
        )


def _halved(rows: NDArray[np.float32]) -> tuple[NDArray[np.float16], NDArray[np.float32]]:
    """Return rows in half precision over their largest numbers, and those numbers."""
    scale = np.abs(rows).max(axis=1, initial=0.0)
    scale = np.where(scale > 0.0, scale, 1.0).astype(np.float32)
    return (rows / scale[:, None]).astype(np.float16), scale


def _fits(found: dict[str, NDArray[Any]]) -> bool:
    """Return whether the arrays of a file belong together."""
    if any(found[n].dtype.kind != "f" or not np.isfinite(found[n]).all() for n in _FLOATS):
        return False
    if found["key"].dtype.kind != "U" or found["key"].shape != ():
        return False
    for name in (n for n in _HALF + _FOLLOWING if n in found):
        rank = len(found["fields" if name in _HALF else _FOLLOWING[0]])
        scale = found[f"{name}_scale"]
        if found[name].ndim != 2 or scale.dtype.kind != "f" or scale.shape != (rank,) or len(found[name]) != rank:
            return False
        if found[name].dtype.kind != "f" or not np.isfinite(found[name]).all():
            return False
        if not (np.isfinite(scale).all() and (scale > 0.0).all()):
            return False
    if found["cubic"].ndim != 1 or found["quartic"].ndim != 1:
        return False
    count, few = side(len(found["cubic"]), 3), side(len(found["quartic"]), 4)
    centres, nodes, tetra = found["centres"], found["nodes"], found["tetrahedra"]
    if _FOLLOWING[0] in found:
        moved, squares, cubes = (found[name] for name in _FOLLOWING)
        fits = nodes.ndim == 2 and moved.shape[1] == 4 * len(nodes) and 0 < side(cubes.shape[1], 3) <= count
        if not (fits and squares.shape[1] == count * (count + 1) // 2):
            return False
    reach = found["reach"]
    return (
        0 < few <= count
        and reach.shape in ((0,), (count,))
        and bool((reach > 0.0).all())
        and centres.ndim == 2
        and found["displacement"].shape == (len(centres), 3, count)
        and centres.shape[1] == 3
        and nodes.ndim == 2
        and nodes.shape[1] == 3
        and found["squares"].shape[1] == count * (count + 1) // 2
        and 0 < side(found["cubes"].shape[1], 3) <= count
        and tetra.dtype.kind in "iu"
        and tetra.ndim == 2
        and tetra.shape[1] == 4
        and len(tetra) > 0
        and found["fields"].shape[1] == 6 * len(tetra)
        and 0 <= int(tetra.min())
        and int(tetra.max()) < len(nodes)
    )

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

from ..arrays import Floats
from ..errors import DermisError
from ..files import write_npz
from ..npz import opened_npz
from .cubic import Cubic
from .energy import Energy
from .features import Features
from .following import Following, Learned
from .patterns import Patterns
from .stress_series import StressSeries
from .symmetric import entries, packed_cubic, packed_forms, side, whole_cubic, whole_forms

VERSION = 3
_ENERGY = "cubic cubic_across signs reach press".split()
_LEARNED = ["learned_centres", "learned_weights"]
_FLOATS = [*_ENERGY, "centres", "displacement", "nodes", *_LEARNED]
_ARRAYS = ["version", "key", "tetrahedra", *_FLOATS]
_FORMS = ("first", "second", "across")  # blocks of features
_FEATURES = tuple(f"{name}_{block}" for name in ("energy", "series") for block in _FORMS)
_FOLLOWING = ("following", "following_squares", "following_cubes")
_HALF = (*_FEATURES, "fields", "squares", "cubes")  # each row by its largest number: stress is then good to 0.05 %


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
        stress, third, known = self.stress, self.energy.third, self.following
        learned = None if known is None else known.learned
        arrays: dict[str, NDArray[Any]] = {
            "version": np.array(VERSION),
            "key": np.array(self.key),
            "cubic": packed_cubic(third.first).astype(np.float32),
            "cubic_across": packed_forms(third.across).astype(np.float32),
            "signs": self.energy.signs,
            "reach": np.zeros(0) if self.energy.reach is None else self.energy.reach,
            "press": np.zeros(0) if self.energy.press is None else self.energy.press,
            "centres": self.patterns.centres,
            "displacement": self.patterns.at(self.patterns.centres),
            "nodes": stress.nodes,
            "tetrahedra": stress.tetrahedra.astype(np.int32),
            "learned_centres": np.zeros((0, self.count), np.float32) if learned is None else learned.centres,
            "learned_weights": np.zeros((0, 0), np.float32) if learned is None else learned.weights,
        }
        halves = [*_packed(self.energy.features), *_packed(stress.features)]
        halves += [_rows(stress.fields), stress.squares, _flat(stress.cubes)]
        names: tuple[str, ...] = _HALF
        if known is not None:
            names += _FOLLOWING
            halves += [_rows(known.fields), known.squares, _flat(known.cubes)]
        for name, rows in zip(names, halves, strict=True):
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
            _check_version(archive.arrays(["version"])["version"], where)
            halves = _HALF + (_FOLLOWING if _FOLLOWING[0] in archive.names else ())
            found = archive.arrays([*_ARRAYS, *halves, *(f"{name}_scale" for name in halves)])
        if not _fits(found):
            raise DermisError("a stiffening skin's arrays do not fit", where=where, value=found["displacement"].shape)
        rows = {name: found[name].astype(np.float32) * found[f"{name}_scale"][:, None] for name in halves}
        first = whole_cubic(found["cubic"]).astype(np.float32)
        across = whole_forms(found["cubic_across"].astype(np.float32))
        even, odd = len(first), across.shape[1]
        forms, products = (_unpacked([rows[f"{n}_{b}"] for b in _FORMS], even, odd) for n in ("energy", "series"))
        shape, following = (products.count, even + odd), None
        if len(halves) > len(_HALF):
            moved, squares, cubes = (np.ascontiguousarray(rows[name]) for name in _FOLLOWING)
            fields = np.ascontiguousarray(moved.T.reshape(len(found["nodes"]), 4, -1))
            learned = Learned(*(found[name].astype(np.float32) for name in _LEARNED))
            known = learned if len(learned.centres) else None
            following = Following(fields, squares, cubes.reshape(len(cubes), *shape), products, known)
        reach, press = (found[name] if found[name].size else None for name in ("reach", "press"))
        return cls(
            Energy(Cubic(first, across), forms, found["signs"], reach, press),
            Patterns.through(found["centres"], found["displacement"]),
            StressSeries(
                found["nodes"],
                found["tetrahedra"],
                np.ascontiguousarray(rows["fields"].T.reshape(len(found["tetrahedra"]), 6, -1)),
                rows["squares"],
                rows["cubes"].reshape(len(rows["cubes"]), *shape),
                products,
            ),
            str(found["key"]),
            following,
        )


def _check_version(version: NDArray[Any], where: str) -> None:
    if version.shape != () or version.dtype.kind not in "iu" or int(version) != VERSION:
        raise DermisError(
            "a table of a skin that stiffens, of another version",
            where=where,
            value=str(version)[:40],
            limit=str(VERSION),
            remedy="Delete it: it is made again",
        )


def _rows(fields: Floats) -> Floats:
    """Return each field as a row, shapes (n, c, r) to (r, n c)."""
    return fields.reshape(-1, fields.shape[-1]).T


def _flat(cubes: Floats) -> Floats:
    return cubes.reshape(len(cubes), cubes.shape[1] * cubes.shape[2])


def _packed(features: Features) -> list[Floats]:
    """Return what differs in the blocks of features, a row each."""
    _, odd, e, o = features.shape
    across = features.across.transpose(1, 0, 2).reshape(odd, e * o)
    return [packed_forms(features.first), packed_forms(features.second), across]


def _unpacked(blocks: list[Floats], even: int, odd: int) -> Features:
    """Return the features of what `_packed` returned."""
    across = blocks[2].reshape(len(blocks[2]), even, odd).transpose(1, 0, 2)
    return Features(whole_forms(blocks[0]), whole_forms(blocks[1]), np.ascontiguousarray(across))


def _halved(rows: Floats) -> tuple[NDArray[np.float16], NDArray[np.float32]]:
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
        scale = found[f"{name}_scale"]
        if found[name].ndim != 2 or scale.dtype.kind != "f" or scale.shape != (len(found[name]),):
            return False
        if found[name].dtype.kind != "f" or not np.isfinite(found[name]).all():
            return False
        if not (np.isfinite(scale).all() and (scale > 0.0).all()):
            return False
    ranks = {"cubic": 1, "cubic_across": 2, "nodes": 2, "centres": 2, "tetrahedra": 2}  # before their lengths are asked
    if any(found[name].ndim != rank for name, rank in ranks.items()):
        return False
    even = side(len(found["cubic"]), 3)
    odd = side(found["cubic_across"].shape[1], 2) if found["cubic_across"].size else 0
    count, centres, tetra = even + odd, found["centres"], found["tetrahedra"]
    reach, pairs = found["reach"], entries(count, 2)
    if even == 0 or len(found["cubic_across"]) != even or found["cubic_across"].shape[1] != entries(odd, 2):
        return False
    features = {}
    for name in ("energy", "series"):
        first, second, across = (found[f"{name}_{block}"] for block in _FORMS)
        if len(first) != len(second) or first.shape[1] != entries(even, 2) or second.shape[1] != entries(odd, 2):
            return False
        if across.shape[1] != even * odd:
            return False
        features[name] = len(first) + len(across)
    told = {"fields": 6 * len(tetra), "squares": pairs, "cubes": features["series"] * count}
    if _FOLLOWING[0] in found:
        told |= dict(zip(_FOLLOWING, (4 * len(found["nodes"]), pairs, told["cubes"]), strict=True))
        if len(found[_FOLLOWING[2]]) > len(found[_FOLLOWING[1]]):
            return False
    seen, more = (found[name] for name in _LEARNED)
    if seen.ndim != 2 or more.ndim != 2 or seen.shape[1] != count or len(seen) != len(more):
        return False
    rows = {name: len(found["fields" if name in _HALF else _FOLLOWING[0]]) for name in told}
    rows[_FOLLOWING[1]] = len(found.get(_FOLLOWING[0], ())) - more.shape[1]
    rows[_FOLLOWING[2]] = len(found.get(_FOLLOWING[2], ()))
    return (
        all(found[name].shape == (rows[name], columns) for name, columns in told.items())
        and found["signs"].shape == (features["energy"],)
        and reach.shape in ((0,), (count,))
        and found["press"].shape in ((0,), reach.shape)
        and bool((reach > 0.0).all())
        and found["displacement"].shape == (len(centres), 3, count)
        and centres.shape[1] == 3
        and found["nodes"].shape[1] == 3
        and tetra.dtype.kind in "iu"
        and tetra.shape[1] == 4
        and len(tetra) > 0
        and 0 <= int(tetra.min())
        and int(tetra.max()) < len(found["nodes"])
    )

"""SampledTable: the exact law of a fingertip's tissue in a few fields, as a file, and made ready for a skin.

A file holds only what touches showed: patterns of the pad, fields beneath it, elements and their weights. What linear
tissue makes of them is worked out again when it is read, a second's work, and is then exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32, Indices
from ..errors import DermisError
from ..files import write_npz
from ..npz import opened_npz
from ..skin.model import SkinModel
from ..stiffening.patterns import Patterns
from ..stiffening.sampled_energy import SampledEnergy
from ..stiffening.sampled_stiffening import SampledStiffening, following_of
from ..stiffening.stiffening import Stiffening
from .held_tissue import HeldTissue
from .neo_hookean import NeoHookean
from .sampled_fit import Bases, on_elements

VERSION = 1
_HALF = ("beneath", "pressure")  # each row by its largest number
_ARRAYS = ("version", "key", "pad", "elements", "weights", "reach", *_HALF, *(f"{name}_scale" for name in _HALF))


@dataclass(frozen=True, eq=False)
class SampledTable:
    """What touches showed of the tissue of a fingertip's standard mesh.

    Attributes:
        pad: patterns of the pad, each storing energy 1/2 in linear tissue at E = 1, shape (k, 3 m).
        beneath: displacement beyond what linear tissue does under them, shape (j, 3 n).
        pressure: of the nodes, beyond it, shape (r, n).
        elements: that stand for all, rising, shape (e,). weights: for how much volume each [m^3], shape (e,).
        reach: amounts of the patterns that touches brought, shape (k,).
        key: of the shape and Poisson's ratio that it was made for.
    """

    pad: Floats32
    beneath: Floats32
    pressure: Floats32
    elements: Indices
    weights: Floats32
    reach: Array
    key: str = ""

    def write(self, path: Path) -> None:
        """Write it as plain arrays; what is beneath in half precision, which changes stress by a few 1e-4.

        Raises:
            DermisError: the file cannot be written.
        """
        arrays: dict[str, NDArray[Any]] = {
            "version": np.array(VERSION),
            "key": np.array(self.key),
            "pad": self.pad.astype(np.float32),
            "elements": self.elements.astype(np.int32),
            "weights": self.weights.astype(np.float32),
            "reach": self.reach.astype(np.float32),
        }
        for name in _HALF:
            rows = getattr(self, name)
            scale = np.abs(rows).max(axis=1, initial=0.0)
            scale = np.where(scale > 0.0, scale, 1.0).astype(np.float32)
            arrays[name], arrays[f"{name}_scale"] = (rows / scale[:, None]).astype(np.float16), scale
        write_npz(path, arrays)

    @classmethod
    def read(cls, path: Path) -> SampledTable:
        """Read what `write` wrote.

        Raises:
            DermisError: the file cannot be read, is of another version, or its arrays do not fit together.
        """
        where = str(path)
        with opened_npz(path, kind="the exact table of a skin that stiffens") as archive:
            version = archive.arrays(["version"])["version"]
            if version.shape != () or version.dtype.kind not in "iu" or int(version) != VERSION:
                raise DermisError(
                    "an exact table of a skin that stiffens, of another version",
                    where=where,
                    value=str(version)[:40],
                    limit=str(VERSION),
                    remedy="Delete it: it is made again",
                )
            found = archive.arrays(list(_ARRAYS))
        if not _fits(found):
            raise DermisError("an exact table's arrays do not fit", where=where, value=found["pad"].shape)
        rows = {name: found[name].astype(np.float32) * found[f"{name}_scale"][:, None] for name in _HALF}
        return cls(
            found["pad"].astype(np.float32),
            rows["beneath"],
            rows["pressure"],
            found["elements"].astype(np.int64),
            found["weights"].astype(np.float32),
            found["reach"].astype(np.float64),
            str(found["key"]),
        )

    def stiffening(self, skin: SkinModel, series: Stiffening) -> SampledStiffening:
        """Return it, ready for contact.

        Args:
            skin: of the standard mesh that it was made of. series: of the same tissue, for devices.

        Raises:
            DermisError: the skin is of another mesh.
        """
        mesh = skin.mesh
        nodes = len(mesh.nodes)
        told = self.pad.shape[1], self.beneath.shape[1], self.pressure.shape[1]
        if told != (3 * len(mesh.pad), 3 * nodes, nodes) or int(self.elements.max()) >= len(mesh.tetrahedra):
            raise DermisError(
                "an exact table of a skin that stiffens is of another mesh",
                where=f"skin '{mesh.name}'",
                value=told,
                limit=f"{3 * len(mesh.pad)}, {3 * nodes}, {nodes}",
                remedy="Delete it: it is made again",
            )
        tissue = NeoHookean(mesh, skin.material.poisson)
        beneath = self.beneath.astype(np.float64).reshape(len(self.beneath), nodes, 3)
        beneath[:, mesh.pad] = beneath[:, mesh.fixed] = 0.0
        moved = HeldTissue(tissue).followed(np.ascontiguousarray(self.pad.T, np.float64))
        pressure = self.pressure.astype(np.float64)
        bases = Bases(self.pad.astype(np.float64), moved, beneath, pressure, np.zeros((0, 0)))
        few = on_elements(tissue, bases, self.elements, self.weights.astype(np.float64))
        skins = np.unique(mesh.surface)  # beyond the pad, too: at its rim a pattern is then read between places
        patterns = Patterns.through(mesh.nodes[skins], moved[:, skins].transpose(1, 2, 0))
        following = following_of(few, beneath, pressure)
        return SampledStiffening(
            SampledEnergy(few, self.reach), patterns, series.stress, self.key, following, series=series
        )


def _fits(found: dict[str, NDArray[Any]]) -> bool:
    """Return whether the arrays of a file belong together."""
    floats = ("pad", "weights", "reach", *_HALF, *(f"{name}_scale" for name in _HALF))
    if any(found[n].dtype.kind != "f" or not np.isfinite(found[n]).all() for n in floats):
        return False
    if found["key"].dtype.kind != "U" or found["key"].shape != () or found["elements"].dtype.kind not in "iu":
        return False
    pad, beneath, pressure, elements = (found[n] for n in ("pad", "beneath", "pressure", "elements"))
    if pad.ndim != 2 or beneath.ndim != 2 or pressure.ndim != 2 or elements.ndim != 1 or not len(elements):
        return False
    if any(found[f"{n}_scale"].shape != (len(found[n]),) or not len(found[n]) for n in _HALF):
        return False
    return (
        len(pad) > 0
        and pad.shape[1] % 3 == 0
        and beneath.shape[1] == 3 * pressure.shape[1]
        and found["weights"].shape == elements.shape
        and bool((found["weights"] > 0.0).all())
        and int(elements[0]) >= 0
        and bool((np.diff(elements.astype(np.int64)) > 0).all())
        and found["reach"].shape == (len(pad),)
        and bool((found["reach"] > 0.0).all())
    )

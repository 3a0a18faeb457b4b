"""ModeFields: fields of the second power that tissue has for the ways in which products of patterns go."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Floats32
from .held_tissue import HeldTissue
from .jets import jets
from .pair_fields import PARTS, Slopes, square_fields
from .pair_modes import PairModes

AT_ONCE = 12  # displacements whose series are in memory together


@dataclass(frozen=True, eq=False)
class ModeFields:
    """Fields of each way, as much as there is of one.

    Attributes:
        modes: the ways. elements: fields of `square_fields`, shape (f, e, PARTS).
        nodal: squares of the dilatation around nodes, shape (n, f).
    """

    modes: PairModes
    elements: Floats32
    nodal: Array

    @classmethod
    def of(cls, linear: HeldTissue, patterns: Array, modes: PairModes) -> ModeFields:
        """Return the fields: what samples have, in the shares that make the ways of them."""
        tissue, mesh = linear.tissue, linear.tissue.mesh
        elements = np.zeros((modes.shares.shape[1], len(mesh.tetrahedra) * PARTS), np.float32)
        nodal = np.zeros((len(mesh.nodes), modes.shares.shape[1]))
        for start in range(0, len(modes.samples), AT_ONCE):
            some = slice(start, start + AT_ONCE)
            moved = np.asarray(np.tensordot(modes.samples[some], patterns, axes=1), np.float64)
            touched = Slopes.of(tissue, moved)
            corners = jets(tissue, linear.free_held, moved, 2)[2][:, mesh.tetrahedra]
            follow = np.einsum("seai,eaj->seij", corners, tissue.geometry.gradients, optimize=True)
            fields = square_fields(touched, follow).reshape(len(moved), -1)
            elements += modes.shares[some].T.astype(np.float32) @ fields
            nodal += (touched.nodal**2).T @ modes.shares[some]
        return cls(modes, elements.reshape(len(elements), -1, PARTS), nodal)

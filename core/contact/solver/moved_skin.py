"""MovedSkin: how far skin has moved, at points and beside them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from .point_set import PointSet


@dataclass(frozen=True, eq=False)
class MovedSkin:
    """A pad under forces on points.

    Attributes:
        points: that carry them. force: [N], shape (n, 3). image: displacement of the points [m], shape (n, 3).
    """

    points: PointSet
    force: Array
    image: Array

    @cached_property
    def common(self) -> Array:
        """How far the skin that touches has moved along itself, by its share of the load [m], shape (3,)."""
        load = np.sqrt(np.einsum("ij,ij->i", self.force, self.force))
        total = float(load.sum())
        if total == 0.0:
            return np.zeros(3)
        along = self.points.normals
        across = self.image - np.einsum("ij,ij->i", self.image, along)[:, None] * along
        return np.asarray(load @ across / total)

    @cached_property
    def raised(self) -> Array:
        """Displacement of points [m], without the part that spreads them along the skin, shape (n, 3).

        An edge parts the cells that it presses in between. Only their common way is theirs, else they see it no more.
        """
        along = self.points.normals
        return self.common + np.einsum("ij,ij->i", self.image - self.common, along)[:, None] * along

    @cached_property
    def afar(self) -> tuple[NDArray[np.float32], Indices, Array, Array]:
        """Forces that move skin where there are no points, taken together by the cells of the coarsest level.

        Returns:
            a table of the displacement of all p of them by a force on such a cell, (t, 3, p, 3); which of its rows are
            those of the k cells that carry any; those forces, in its unit, shape (k, 3); and how far all skin moves
            with the bone besides [m], shape (3,).
        """
        pad, loaded = self.points.pad, np.flatnonzero(self.force.any(axis=1))
        under, which = np.unique(pad.chart.tiles.root[self.points.cells[loaded]], return_inverse=True)
        on = np.stack([np.bincount(which, self.force[loaded, k], len(under)) for k in range(3)], axis=1)
        rows, place = pad.coarse.places(under)
        # symmetric: the rows of the few that carry force serve for all that they move
        return rows, place, on / pad.material.modulus, on.sum(axis=0) @ pad.spring

"""MovedSkin: how far skin has moved, at points and beside them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...arrays import Array, Indices
from .point_map import NONE
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
        """How far points have moved [m], but for what spreads them along the skin, and zero at last, shape (n + 1, 3).

        An edge parts the cells that it presses in between. Only their common way is theirs, else they see it no more.
        """
        along = self.points.normals
        out = np.zeros((len(along) + 1, 3))
        out[:-1] = self.common + np.einsum("ij,ij->i", self.image - self.common, along)[:, None] * along
        return out

    def under(self, cells: Indices) -> tuple[Array, Indices]:
        """Return how far skin has moved at cells [m], shape (n, 3), and a point under each, `NONE` where none is."""
        found = self.points.map.under(cells)
        owner = found.max(axis=1)
        shift = self.raised.take(found, axis=0).sum(axis=1) / np.maximum((found != NONE).sum(axis=1), 1)[:, None]
        afar = np.flatnonzero(owner == NONE)
        if len(afar) and self.force.any():
            shift[afar] = self._far[self.points.pad.chart.tiles.root[cells[afar]]]
        return shift, owner

    @cached_property
    def _far(self) -> Array:
        """The displacement of all cells of the coarsest level [m], by the forces under each, shape (p, 3)."""
        loaded = np.flatnonzero(self.force.any(axis=1))
        base = self.points.pad.chart.tiles.root[self.points.cells[loaded]]
        under, which = np.unique(base, return_inverse=True)
        force = np.zeros((len(under), 3), dtype=np.float32)
        np.add.at(force, which, self.force[loaded])
        pad = self.points.pad  # symmetric: the rows of the few that carry force serve for all that they move
        return pad.displaced(pad.coarse[under], force)

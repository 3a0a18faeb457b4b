"""MovedSkin: displacement of a pad's skin, at the contact points and elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from .cone import carrying
from .point_set import PointSet


@dataclass(frozen=True, eq=False)
class MovedSkin:
    """Pad under forces on points.

    Attributes:
        points: the points.
        force: forces on the points [N], shape (n, 3).
        image: displacement of the points [m], shape (n, 3).
    """

    points: PointSet
    force: Array
    image: Array

    @cached_property
    def common(self) -> Array:
        """Mean tangential displacement of the points, weighted with their forces [m], shape (3,)."""
        load = np.sqrt(np.einsum("ij,ij->i", self.force, self.force))
        total = float(load.sum())
        if total == 0.0:
            return np.zeros(3)
        along = self.points.normals
        across = self.image - np.einsum("ij,ij->i", self.image, along)[:, None] * along
        return np.asarray(load @ across / total)

    @cached_property
    def raised(self) -> Array:
        """Displacement of the points without their relative tangential movement [m], shape (n, 3).

        An edge pushes the cells on its two sides apart. With their full displacement, they would no longer be found
        near the edge.
        """
        return np.zeros((len(self.force), 3))

    @cached_property
    def afar(self) -> tuple[NDArray[np.float32], Indices, Array, Array]:
        """Data for the displacement of skin without points, with forces summed over the cells of level 0.

        Returns:
            Table of the displacement of all p cells of level 0 for forces on one of them, for E = 1, shape (t, 3, p,
            3); its rows for the k loaded cells; the forces on these, divided by the modulus, shape (k, 3); and the
            displacement of all skin with the bone [m], shape (3,).
        """
        pad, loaded = self.points.pad, carrying(self.force).nonzero()[0]
        under, which = np.unique(pad.chart.tiles.root[self.points.cells[loaded]], return_inverse=True)
        on = np.stack([np.bincount(which, self.force[loaded, k], len(under)) for k in range(3)], axis=1)
        rows, place = pad.coarse.places(under)
        # The compliance is symmetric, so that the rows of the few loaded cells are enough.
        return rows, place[:0], on[:0] / pad.material.modulus, np.zeros(3)

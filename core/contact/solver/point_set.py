"""PointSet: the contact points of a pad, which are centres of cells, with their compliance."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...arrays import Array, Indices
from ...skin.surface_compliance import SurfaceCompliance
from .point_matrix import PointMatrix

NONE = -1
SPREAD = 0.25e-3  # distance along both sides of a cell at which a point looks at bodies as well [m]


class PointSet:
    """Changing set of contact points.

    Args:
        pad: pad whose cells' centres are the points.

    Attributes:
        matrix: compliance between the points.
        number: index of the point at the centre of each cell of the pad, shape (cells,); `NONE` if the cell is no
            point.
        positions: positions of the points [m], shape (n, 3).
        inward: unit normals of the skin at the points, into the finger, shape (n, 3).
        areas: areas of the points' cells [m^2], shape (n,).
        spread: vectors of the length `SPREAD` along both sides of the points' cells [m], shape (n, 2, 3).
    """

    def __init__(self, pad: SurfaceCompliance) -> None:
        self.pad, self.matrix = pad, PointMatrix(pad)
        self.number = np.full(len(pad.chart.places), NONE)
        self._renumber(self.cells)

    def __len__(self) -> int:
        return len(self.matrix.cells)

    @property
    def cells(self) -> Indices:
        """The cells whose centres are the points, shape (n,)."""
        return self.matrix.cells

    def difference(self, cells: Indices) -> tuple[Indices, Indices]:
        """Return the positions of points to remove and the cells to add, so that given cells become the points."""
        number = self.number[cells]
        leaves = np.ones(len(self), dtype=np.bool_)
        leaves[number[number != NONE]] = False
        return leaves.nonzero()[0], cells[number == NONE]

    def change(self, leaving: Indices, entering: Indices) -> Indices:
        """Remove points by their positions, and add cells at the end; return the former position of each that stays."""
        before = self.cells
        order = self.matrix.change(leaving, entering)
        self._renumber(before)
        return order

    def save(self) -> tuple[Any, ...]:
        """Return the state, for `restore`."""
        return self.matrix.save()

    def restore(self, state: tuple[Any, ...]) -> None:
        """Go back to a saved state."""
        before = self.cells
        self.matrix.restore(state)
        self._renumber(before)

    def _renumber(self, before: Indices) -> None:
        """Compute the data of the points; `before` are the former cells."""
        cells, own = self.cells, self.pad.cells
        self.number[before] = NONE
        self.number[cells] = np.arange(len(cells))
        self.positions, self.inward = own.positions.take(cells, axis=0), -own.normals.take(cells, axis=0)
        self.areas: Array = own.areas.take(cells)
        sides = own.sides.take(cells, axis=0)
        self.spread = SPREAD * (sides / np.sqrt(np.einsum("nij,nij->ni", sides, sides))[:, :, None])

"""PointSet: the cells of a pad that are points of a contact at present, and the compliance between them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...arrays import Array, Indices
from ...skin.surface_compliance import SurfaceCompliance
from .point_map import NONE, PointMap
from .point_matrix import PointMatrix
from .point_tree import CORNERS


class PointSet:
    """Points that come and go.

    Args:
        pad: whose cells' centres they are.

    Attributes:
        matrix: the compliance between them. map: tells which of them lies where on the pad.
        positions, normals, areas: of the points, shapes (n, 3), (n, 3) and (n,).
        sides: of their cells [m], shape (n, 2, 3). beside: as `PointMap.beside`, shape (n, 4).
    """

    def __init__(self, pad: SurfaceCompliance) -> None:
        self.pad = pad
        self.matrix, self.map = PointMatrix(pad), PointMap(pad.chart, CORNERS)
        self._place = np.full(len(pad.chart.places), NONE)  # of each cell in `cells`
        self._number()

    def __len__(self) -> int:
        return len(self.matrix.cells)

    @property
    def cells(self) -> Indices:
        """The cells whose centres are the points, shape (n,)."""
        return self.matrix.cells

    def difference(self, cells: Indices) -> tuple[Indices, Indices]:
        """Return which points leave, by their place, and which cells enter, where these cells shall be the points."""
        inside = np.zeros(len(self._place), dtype=bool)
        inside[cells] = True
        return np.flatnonzero(~inside[self.cells]), cells[self._place[cells] == NONE]

    def change(self, leaving: Indices, entering: Indices) -> Indices:
        """Take points out by their place and put cells in at the end; return where each that stays was."""
        self._place[self.cells] = NONE
        order = self.matrix.change(leaving, entering)
        self._number()
        return order

    def save(self) -> tuple[Any, ...]:
        """Return the state, for `restore`."""
        return self.matrix.save()

    def restore(self, state: tuple[Any, ...]) -> None:
        """Go back to a saved state."""
        self._place[self.cells] = NONE
        self.matrix.restore(state)
        self._number()

    def _number(self) -> None:
        cells = self.cells
        self._place[cells] = np.arange(len(cells))
        self.map.mark(cells)
        self.positions, self.normals = self.pad.cells.positions[cells], self.pad.cells.normals[cells]
        self.areas: Array = self.pad.cells.areas[cells]
        self.sides, self.beside = self.pad.cells.sides[cells], self.map.beside(cells)

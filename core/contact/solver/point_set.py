"""PointSet: the cells of a pad that are points of a contact at present, and the compliance between them."""

from __future__ import annotations

from ctypes import byref
from typing import Any

import numpy as np

from ...arrays import Array, Indices
from ...errors import DermisError
from ...kernels import records
from ...kernels.library import kernels
from ...kernels.records import address
from ...skin.surface_compliance import SurfaceCompliance
from .point_matrix import PointMatrix

NONE = -1


class PointSet:
    """Points that come and go.

    Args:
        pad: whose cells' centres they are.

    Attributes:
        matrix: the compliance between them.
        owner: the point over each finest square of each root, `NONE` without, shape (roots + 1, squares).
        in_root: the last point in each root, `NONE` without, shape (roots,).
        number: index of the point at the centre of each cell of the pad, shape (cells,); `NONE` if the cell is no
            point.
        positions: positions of the points [m], shape (n, 3).
        normals: unit normals of the skin at the points, shape (n, 3).
        areas: areas of the points' cells [m^2], shape (n,).
        sides: side vectors of the points' cells [m], shape (n, 2, 3).
        beside: the points before and behind cells, along the finger, then around it, `NONE` without, shape (n, 4).
    """

    def __init__(self, pad: SurfaceCompliance) -> None:
        self.pad, self.matrix = pad, PointMatrix(pad)
        chart, tiles = pad.chart, pad.chart.tiles
        side, roots = 1 << (tiles.levels - 1), chart.starts[1]
        self.owner = np.full((roots + 1, side * side), NONE)  # the last root is beside the pad
        self.in_root, self.number = np.full(roots, NONE), np.full(len(chart.places), NONE)
        around = np.ascontiguousarray(chart.beside, dtype=np.int64)
        self._record = records.PointsRecord(known=len(chart.places), side=side)
        own = {"owner": self.owner, "in_root": self.in_root, "number": self.number, "around": around}
        self._kept = {"root": tiles.root, "halved": tiles.halved, "place": tiles.place, **own}
        for name, array in self._kept.items():
            setattr(self._record, name, address(array))
        self._renumber(self.cells)

    def __len__(self) -> int:
        return len(self.matrix.cells)

    @property
    def cells(self) -> Indices:
        """The cells whose centres are the points, shape (n,)."""
        return self.matrix.cells

    def difference(self, cells: Indices) -> tuple[Indices, Indices]:
        """Return which points leave, by their place, and which cells enter, where these cells shall be the points."""
        number = self.number[cells]
        leaves = np.ones(len(self), dtype=np.bool_)
        leaves[number[number != NONE]] = False
        return leaves.nonzero()[0], cells[number == NONE]

    def change(self, leaving: Indices, entering: Indices) -> Indices:
        """Take points out by their place and put cells in at the end; return where each that stays was."""
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
        """Set the data of the points, which were other cells before."""
        cells, own, record = self.cells, self.pad.cells, self._record
        self.beside = np.empty((len(cells), 4), dtype=np.int64)
        record.before, record.old_cells = len(before), address(before)
        record.count, record.cells, record.beside = len(cells), address(cells), address(self.beside)
        if kernels().number_points(byref(record)) != records.DONE:
            raise DermisError("a record for the kernels is damaged", where=kernels().path.name, value=len(cells))
        self.positions, self.normals = own.positions.take(cells, axis=0), own.normals.take(cells, axis=0)
        self.areas: Array = own.areas.take(cells)
        self.sides = own.sides.take(cells, axis=0)

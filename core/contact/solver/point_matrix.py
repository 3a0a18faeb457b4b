"""PointMatrix: compliance between contact points, updated when points are added and removed.

For each new point, its rows are computed. The place of a removed point is taken by one of the last points. The matrix
is in single precision, with a relative error of 1e-6.
"""

from __future__ import annotations

from ctypes import byref

import numpy as np

from ...arrays import Floats32, Indices
from ...kernels import records
from ...kernels.library import kernels
from ...kernels.records import address
from ...skin.surface_compliance import SurfaceCompliance

GROWTH = 1.2  # factor by which memory for points grows if it is too small


class PointMatrix:
    """Compliance matrix C [m/N] between cells of a pad.

    Args:
        pad: the pad.

    Attributes:
        cells: indices of the cells in the order of the rows, three rows each, shape (n,).
    """

    def __init__(self, pad: SurfaceCompliance) -> None:
        self.pad = pad
        self.cells: Indices = np.zeros(0, dtype=np.int64)
        self._store = np.zeros((0, 0), dtype=np.float32)
        self._saved = False

    @property
    def matrix(self) -> Floats32:
        """The compliance, shape (3 n, 3 n)."""
        n = 3 * len(self.cells)
        return self._store[:n, :n]

    def change(self, leaving: Indices, entering: Indices) -> Indices:
        """Remove points, and add cells at the end.

        Args:
            leaving: positions in `cells` of the points to remove, ascending, shape (k,).
            entering: indices of the cells to add, shape (j,).

        Returns:
            Former position of each point that stays, in the new order.
        """
        count, entered = len(self.cells), len(entering)
        size = count - len(leaving)
        order = np.arange(size)
        holes = np.ascontiguousarray(leaving[leaving < size], np.int64)
        stays = np.ones(count - size, dtype=np.bool_)  # of the last points, which fill the holes
        stays[leaving[len(holes) :] - size] = False
        order[holes] = former = size + stays.nonzero()[0]
        store, new = self._store, 3 * (size + entered)
        if self._saved or new > len(store):  # a saved state is not changed
            room = len(store) if new <= len(store) else 3 * int(GROWTH * new / 3)
            self._store, self._saved = np.empty((room, room), dtype=np.float32), False
        if len(holes) or store is not self._store:
            moves = records.MovesRecord(size, len(holes), address(holes), address(former), address(store), len(store))
            moves.out, moves.stride = address(self._store), len(self._store)
            kernels().move_points(byref(moves))
        self.cells = np.concatenate([self.cells[order], entering])
        if entered:
            rows = self._store[3 * size : new, :new]
            self.pad.rows(entering, self.cells, rows, self._store[: 3 * size, 3 * size : new])
        return order

    def save(self) -> tuple[Indices, Floats32]:
        """Return the present cells and rows, for `restore`; they are copied at the next change."""
        self._saved = True
        return self.cells, self._store

    def restore(self, state: tuple[Indices, Floats32]) -> None:
        """Go back to a saved state."""
        self.cells, self._store = state
        self._saved = True

"""PointMatrix: the compliance between the points that may touch, kept up as points come and go.

A point that enters costs one row of the kernel; one that leaves makes room for the last. Single precision is 1e-6 off,
and a frame that it is not enough for is solved in double precision anyway.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Array, Floats32, Indices
from ...skin.surface_compliance import SurfaceCompliance

GROWTH = 1.2  # of the room, where it is too small: pages that nothing was written to cost nothing


class PointMatrix:
    """C [m/N] between some cells of a pad.

    Args:
        pad: whose cells they are.

    Attributes:
        cells: in the order of the rows, three a cell, shape (n,).
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
        """Take points out by their place in `cells`, and put cells in at the end.

        Returns:
            Where each point that stays was before, in its new order.
        """
        count = len(self.cells)
        if self._saved:
            self._move(len(self._store), 3 * count)
        size = count - len(leaving)
        order = np.arange(size)
        holes = leaving[leaving < size]
        if len(holes):
            order[holes] = np.setdiff1d(np.arange(size, count), leaving)
            to, source = rows_of(holes), rows_of(order[holes])
            whole = self._store[: 3 * count, : 3 * count]
            whole[to] = whole[source]
            whole[:, to] = whole[:, source]
        self.cells = np.concatenate([self.cells[order], entering])
        if len(entering):
            old, new = 3 * size, 3 * len(self.cells)
            self._make_room(new, old)
            rows = self.pad.rows(entering, self.cells)
            self._store[old:new, :new] = rows
            self._store[:old, old:new] = rows[:, :old].T
        return order

    def save(self) -> tuple[Indices, Floats32]:
        """Return the present cells and rows, for `restore`; they are copied when they change next."""
        self._saved = True
        return self.cells, self._store

    def restore(self, state: tuple[Indices, Floats32]) -> None:
        """Go back to a saved state."""
        self.cells, self._store = state
        self._saved = True

    def displacement(self, force: Array) -> Array:
        """Return C f for forces [N] on the points, shape (n, 3), those without left out of the work."""
        loaded = np.flatnonzero(force.any(axis=1))
        if len(loaded) == 0:
            return np.zeros_like(force)
        if 2 * len(loaded) > len(force):
            return (self.matrix @ force.reshape(-1).astype(np.float32)).reshape(-1, 3).astype(np.float64)
        # the matrix is symmetric: rows are nearer to each other than columns
        rows = self.matrix.reshape(len(force), 3, -1)[loaded].reshape(3 * len(loaded), -1)
        return (force[loaded].reshape(-1).astype(np.float32) @ rows).reshape(-1, 3).astype(np.float64)

    def _make_room(self, wanted: int, kept: int) -> None:
        if wanted > len(self._store):
            self._move(int(GROWTH * wanted), kept)

    def _move(self, size: int, kept: int) -> None:
        """Go over to another store, so that the one that was saved stays as it is."""
        store = np.empty((size, size), dtype=np.float32)
        store[:kept, :kept] = self._store[:kept, :kept]
        self._store, self._saved = store, False


def rows_of(points: Indices) -> Indices:
    """Return the rows of points, three each."""
    return (3 * points[:, None] + np.arange(3)).reshape(-1)

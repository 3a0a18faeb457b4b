"""PointMatrix: compliance between contact points, updated when points are added and removed.

For each new point, its rows are computed. The place of a removed point is taken by one of the last points. The matrix
is in single precision, with a relative error of 1e-6.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Array, Floats32, Indices
from ...skin.surface_compliance import SurfaceCompliance
from .compliance import displaced

GROWTH = 1.2  # factor by which the memory grows if it is too small
_THREE = np.dtype("V12")  # the three components of a point in a row, which are moved together


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
            leaving: positions in `cells` of the points to remove, shape (k,).
            entering: indices of the cells to add, shape (j,).

        Returns:
            Former position of each point that stays, in the new order.
        """
        count = len(self.cells)
        if self._saved:
            self._move(len(self._store), 3 * count)
        size = count - len(leaving)
        order = np.arange(size)
        holes = leaving[leaving < size]
        if len(holes):
            stays = np.ones(count, dtype=np.bool_)
            stays[leaving] = False
            order[holes] = source = size + stays[size:].nonzero()[0]
            room = len(self._store) // 3
            rows = self._store.reshape(room, 3, 3 * room)
            rows[holes, :, : 3 * count] = rows[source, :, : 3 * count]
            columns = self._store.view(_THREE)[: 3 * count]
            columns[:, holes] = columns[:, source]
        self.cells = np.concatenate([self.cells[order], entering])
        if len(entering):
            old, new = 3 * size, 3 * len(self.cells)
            self._make_room(new, old)
            store = self._store
            self.pad.rows(entering, self.cells, store[old:new, :new], store[:old, old:new])
        return order

    def save(self) -> tuple[Indices, Floats32]:
        """Return the present cells and rows, for `restore`; they are copied at the next change."""
        self._saved = True
        return self.cells, self._store

    def restore(self, state: tuple[Indices, Floats32]) -> None:
        """Go back to a saved state."""
        self.cells, self._store = state
        self._saved = True

    def displacement(self, force: Array) -> Array:
        """Return the displacement C f [m], shape (n, 3), for forces on the points [N], shape (n, 3)."""
        return displaced(self.matrix, force)

    def _make_room(self, wanted: int, kept: int) -> None:
        if wanted > len(self._store):
            self._move(3 * int(GROWTH * wanted / 3), kept)

    def _move(self, size: int, kept: int) -> None:
        """Copy the rows to new memory, so that a saved state is not changed."""
        store = np.empty((size, size), dtype=np.float32)
        store[:kept, :kept] = self._store[:kept, :kept]
        self._store, self._saved = store, False

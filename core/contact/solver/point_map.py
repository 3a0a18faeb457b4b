"""PointMap: which point of a contact lies where on the pad, on a grid as fine as the finest cells."""

from __future__ import annotations

import numpy as np

from ...arrays import Array, Indices
from ...skin.pad_chart import PadChart

NONE = -1
_SIGNS = np.array([[0.0, 0.0], [-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])  # centre, corners
_BESIDE = 0.5 + 0.501 * np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])  # just beyond the sides


class PointMap:
    """The points over the finest squares of a chart.

    Args:
        chart: that points are cells of.
        reach: of corners from their cell's centre, in sides of it.
    """

    def __init__(self, chart: PadChart, reach: float) -> None:
        self.chart, self.tiles = chart, chart.tiles
        self.side = 1 << (self.tiles.levels - 1)  # finest squares along a root
        self._offsets = 0.5 + reach * _SIGNS
        self._owner = np.full((chart.starts[1] + 1, self.side * self.side), NONE)  # the last is beside the pad
        self._in_root = np.full(chart.starts[1], NONE)  # the last point in each root
        self._marked: Indices = np.zeros(0, dtype=np.int64)

    def mark(self, cells: Indices) -> None:
        """Set which cells are points."""
        tiles = self.tiles
        self._owner[self._marked] = NONE
        self._in_root[self._marked] = NONE
        self._marked = np.unique(tiles.root[cells])
        size = self.tiles.sizes(cells)
        kind = size[:, 0] * (2 * self.side) + size[:, 1]
        for one in np.unique(kind).tolist():
            part = np.flatnonzero(kind == one)
            a, b = divmod(one, 2 * self.side)
            place = tiles.place[cells[part]]
            rows, columns = place[:, :1] * a + np.arange(a), place[:, 1:] * b + np.arange(b)
            number = (rows[:, :, None] * self.side + columns[:, None]).reshape(len(part), -1)
            self._owner[tiles.root[cells[part], None], number] = part[:, None]
        self._in_root[self._marked] = self._owner[self._marked].max(axis=1)

    def under(self, cells: Indices) -> Indices:
        """Return up to four points under each cell, or beside it in its root, `NONE` where there is none, (n, 4)."""
        root = self.tiles.root[cells]
        found = self._owner[root[:, None], self.tiles.quarters[cells]]
        none = np.flatnonzero((found == NONE).all(axis=1))
        found[none, 0] = self._in_root[root[none]]
        return found

    def around(self, cells: Indices) -> Indices:
        """Return the points under the centre and the corners of cells, `NONE` where there is none, shape (n, 5)."""
        return self._at(cells, self._offsets)

    def beside(self, cells: Indices) -> Indices:
        """Return the points before and behind cells, along the finger, then around it, `NONE` without, shape (n, 4)."""
        return self._at(cells, _BESIDE)

    def _at(self, cells: Indices, offsets: Array) -> Indices:
        tiles, size = self.tiles, self.tiles.sizes(cells)[:, None]
        at = np.floor((tiles.place[cells][:, None] + offsets) * size + 1e-9).astype(np.int64)
        root = self.chart.beside[
            tiles.root[cells, None], (at[:, :, 0] // self.side) + 1, (at[:, :, 1] // self.side) + 1
        ]
        at %= self.side
        return np.asarray(self._owner[root, at[:, :, 0] * self.side + at[:, :, 1]])

"""The closest triangle of a point by numpy: for devices without a skin where no kernels can be loaded.

It is exact and slow. All else takes `TriangleTree`; both agree but for rounding.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Indices
from .tree import Nearest
from .triangles import TriangleTable

# As in core/kernels/closest.c: triangles as close as this, relative to the square, are told apart by their number, and
# weights below the other count as on an edge or a corner.
TIE, ON_FEATURE = 1e-12, 1e-9
# A margin for rounding, relative to lengths.
SLACK = 1e-9


class PlainTriangles:
    """The usable triangles of one surface; there must be one at least."""

    def __init__(self, table: TriangleTable) -> None:
        self._table, self._usable = table, np.flatnonzero(table.usable)

    def nearest(self, points: Array, limit: float, hints: Indices | None = None) -> Nearest:
        """Return the closest triangle of each point, as `TriangleTree.nearest` does; hints have no effect."""
        found = Nearest.nothing(len(points))
        centres, radius = self._table.bounds[0:3].take(self._usable, axis=1), self._table.bounds[6].take(self._usable)
        for i, x in enumerate(points):
            away = centres - x[:, None]
            distance = np.sqrt((away * away).sum(axis=0))
            reach = min(float((distance + radius).min()), limit) * (1.0 + SLACK) + SLACK * float(np.abs(x).max())
            close = self._usable[distance - radius <= reach]
            if not close.size:
                continue
            square, weights = self._measured(x, close)
            least = float(square.min())
            if least > limit * limit:
                continue
            k = int((square <= least * (1.0 + TIE)).argmax())  # the lowest number
            found.triangle[i], found.weights[i], found.square[i] = close[k], weights[:, k], square[k]
            a, ab, ac = self._table.rows[:9, close[k]].reshape(3, 3)
            found.point[i] = a + weights[1, k] * ab + weights[2, k] * ac
            zero = found.weights[i] <= ON_FEATURE
            if zero.sum() == 2:
                found.feature[i] = 4 + found.weights[i].argmax()
            elif zero.any():
                found.feature[i] = 1 + (zero.argmax() + 1) % 3
        return found

    def _measured(self, x: Array, triangle: Indices) -> tuple[Array, Array]:
        """Return squared distances of a point to triangles [m^2], (k,), and the closest points' weights, (3, k)."""
        rows = self._table.rows.take(triangle, axis=1)
        edges = np.stack([rows[3:6], rows[6:9], rows[6:9] - rows[3:6]])
        v = x[:, None] - rows[0:3]
        starts = np.stack([v, v, v - rows[3:6]])
        share = np.clip((starts * edges).sum(axis=1) / np.maximum(rows[9:12], 1e-300), 0.0, 1.0)
        u, w = np.zeros((2, triangle.size))
        for _ in range(3):  # the rest along the face is the error of the guess
            left = v - u * edges[0] - w * edges[1]
            along = (left * edges[0]).sum(axis=0), (left * edges[1]).sum(axis=0)
            u = u + (rows[10] * along[0] - rows[12] * along[1]) * rows[13]
            w = w + (rows[9] * along[1] - rows[12] * along[0]) * rows[13]
        left = v - u * edges[0] - w * edges[1]
        within = (np.minimum(u, w) > 0.0) & (u + w < 1.0)
        of_edges = starts - share[:, None] * edges
        squares = np.concatenate(
            [(of_edges * of_edges).sum(axis=1), np.where(within, (left * left).sum(axis=0), np.inf)[None]]
        )
        none = np.zeros(triangle.size)
        of_b = np.stack([share[0], none, 1.0 - share[2], u])
        of_c = np.stack([none, share[1], share[2], w])
        best = squares.argmin(axis=0)[None]
        square, b, c = (np.take_along_axis(part, best, axis=0)[0] for part in (squares, of_b, of_c))
        return square, np.stack([np.maximum(1.0 - b - c, 0.0), b, c])

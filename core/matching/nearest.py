"""Exact nearest neighbours for points on a thin sheet, whether queries lie near that sheet or off it.

Sensed data of a device with few motors lie on a curved sheet of few dimensions in the space of many channels. A k-d
tree cuts along channels: its boxes stand askew to the sheet, are mostly empty, and a query with noise, or from another
finger, visits many of them. So the points are turned into their principal axes first, which changes no distance: cuts
then run along the sheet, boxes are flat where the sheet is, and the axes across it hardly cost anything. Measured on
the 166,375 rows of the cable platform this is 3 times as fast near the sheet and up to 8 times far off it.

Turned coordinates are rounded. Squares of whole numbers, such as a sensor's counts, are whole again after rounding; of
other points, whatever rounding could decide, an exact hit or a tie for the last place, is decided anew from the points
as they were given.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..errors import DermisError

NEIGHBOURS = 8  # that are averaged. Source: [S2] III.B
LEAF = 32  # points in a leaf of the tree (measured)
SLACK = 1e-13  # of the squares of all that takes part: rounding of turned coordinates, some 20 terms
EXACT = 1e11  # squares of whole numbers, up to here all together, are within half of their rounded value


@dataclass(frozen=True, eq=False)
class Neighbours:
    """The nearest points of each query, nearest first.

    Attributes:
        index: shape (q, k). squared: squared distances, shape (q, k).
        tied: queries whose last neighbour is as far as one that was left out, or that several points hit exactly.
    """

    index: Indices
    squared: Array
    tied: NDArray[np.bool_]


class NearestPoints:
    """Points prepared for exact searches.

    Args:
        points: shape (n, d), finite.

    Attributes:
        points: as they were given.

    Raises:
        DermisError: no points, or values that are not finite.
    """

    def __init__(self, points: NDArray[Any]) -> None:
        from scipy.spatial import cKDTree

        points = np.ascontiguousarray(points, np.float64)
        if points.ndim != 2 or len(points) == 0 or not np.isfinite(points).all():
            raise DermisError("nearest neighbours need finite points", where="look-up table", value=points.shape)
        self.count, self.dimensions = points.shape
        self.points = points
        self._whole = bool((points == np.rint(points)).all())
        self._centre = points.mean(axis=0)
        own = points - self._centre
        _, axes = np.linalg.eigh(own.T @ own)
        self._axes = np.ascontiguousarray(axes[:, ::-1])  # widest first
        turned = own @ self._axes
        self._size = float(np.einsum("ij,ij->i", turned, turned).max())
        self._tree = cKDTree(turned, leafsize=LEAF)

    def query(self, queries: NDArray[Any], k: int) -> Neighbours:
        """Return the k nearest points of each query, shape (q, d).

        Raises:
            DermisError: more neighbours than points, another number of channels, or values that are not finite.
        """
        queries = np.ascontiguousarray(queries, np.float64)
        if not 1 <= k <= self.count:
            raise DermisError(
                "as many neighbours as there are points", where="look-up table", value=k, limit=f"1 to {self.count}"
            )
        if queries.ndim != 2 or queries.shape[1] != self.dimensions:
            raise DermisError(
                "the query has another number of channels than the table",
                where="look-up table",
                value=queries.shape,
                limit=f"(n, {self.dimensions})",
            )
        turned = (queries - self._centre) @ self._axes
        size = float(np.vdot(turned, turned))  # of all queries together: not below that of any
        if not size < np.inf:  # nor where it is no number
            raise DermisError("a query is not finite", where="look-up table")
        more = min(k + 1, self.count)  # one neighbour more tells ties
        distance, index = self._tree.query(turned, np.arange(1, more + 1))
        distance *= distance
        near, index = distance[:, :k], index[:, :k]
        if self._whole and self._size + size < EXACT and (queries == np.rint(queries)).all():
            np.rint(distance, out=distance)  # squares of whole numbers are whole: rounding leaves no doubt
            tied = distance[:, k] == near[:, -1] if more > k else np.zeros(len(queries), bool)
            if k > 1:
                tied |= near[:, 1] == 0.0
            return Neighbours(index, near, tied)
        doubt = SLACK * (self._size + size)
        tied = np.zeros(len(queries), bool)
        unsure = near[:, 0] <= doubt
        if more > k:
            unsure |= distance[:, k] - near[:, -1] <= doubt
        if unsure.any():
            near, index = near.copy(), index.copy()
            for i in np.flatnonzero(unsure):
                index[i], near[i], tied[i] = self._decided(queries[i], index[i])
        return Neighbours(index, near, tied)

    def query_one(self, query: Array, k: int) -> tuple[Indices, Array] | None:
        """Return the k nearest points of one query, shape (d,), and their squared distances; None where in doubt.

        In doubt are exact hits, ties for the last place, fewer than k + 1 points, and a query that is not finite:
        `query` decides, or refuses. Where calling costs as much as searching, a single query asks the tree alone.
        """
        turned = (query - self._centre) @ self._axes
        size = self._size + float(turned.dot(turned))
        if not (size < np.inf and k < self.count):
            return None
        squared, index = self._tree.query(turned, k + 1)
        squared *= squared
        doubt = SLACK * size
        if squared[0] <= doubt or squared[k] - squared[k - 1] <= doubt:
            return None
        return index[:k], squared[:k]

    def within(self, query: Array, squared: float) -> Indices:
        """Return all points at most as far from one query as given, by index, rising."""
        turned = (np.asarray(query, np.float64) - self._centre) @ self._axes
        doubt = SLACK * (float(turned @ turned) + self._size)
        near = np.asarray(self._tree.query_ball_point(turned, np.sqrt(max(squared, 0.0) + doubt)), np.int64)
        near.sort()
        return near[self._squared(query, near) <= squared]

    def _decided(self, query: Array, found: Indices) -> tuple[Indices, Array, bool]:
        """Return one query's neighbours, squared distances and whether they are tied, from the points as given."""
        k = len(found)
        rows = self.within(query, float(self._squared(query, found).max()))
        squared = self._squared(query, rows)
        order = np.lexsort((rows, squared))
        near = squared[order]
        tied = bool((len(rows) > k and near[k] == near[k - 1]) or (k > 1 and near[1] == 0.0))
        return rows[order[:k]], near[:k], tied

    def _squared(self, query: Array, rows: Indices) -> Array:
        off = self.points[rows] - query
        return np.einsum("ij,ij->i", off, off)

"""Exact nearest neighbours by a k-d tree in principal axes.

Readings of a device with few motors lie near a curved surface of few dimensions in the space of many channels. A k-d
tree divides space along the channels. Its boxes are oblique to this surface and mostly empty, so that a query with
noise, or from another finger, visits many of them. The points are therefore rotated to their principal axes first,
which changes no distance. Boxes are then thin where the surface is, and the axes across it cost hardly anything. On the
166,375 rows of the cable platform, this was measured to be 3 times as fast near the surface and up to 8 times as fast
far from it.

Rotation rounds the coordinates. The squared distance between points of whole numbers, such as a sensor's counts, is
whole again after rounding. For other points, rounding could decide an exact hit or a tie for the last place. Such
queries are solved again with the points as given.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..errors import DermisError

NEIGHBOURS = 8  # number of neighbours that are averaged. Source: [S2] III.B
LEAF = 32  # points in a leaf of the tree; the fastest as measured
SLACK = 1e-13  # rounding error of a squared distance, relative to the squared norms of points and queries
EXACT = 1e11  # up to this sum of squared norms, rounding errors of squared distances are below one half


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Nearest points of each query, the nearest first.

    Attributes:
        index: indices of the points, shape (q, k).
        squared: squared distances, shape (q, k).
        tied: whether the choice of neighbours is not unique: the last one is as far away as one that was left out, or
            several points equal the query; shape (q,).
    """

    index: Indices
    squared: Array
    tied: NDArray[np.bool_]


class NearestPoints:
    """Search structure for exact nearest neighbours.

    Args:
        points: points to be found, finite, shape (n, d).

    Attributes:
        points: the points as given, shape (n, d).

    Raises:
        DermisError: there are no points, or a value is not finite.
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
        """Return the k nearest points of each query.

        Args:
            queries: shape (q, d).
            k: number of neighbours.

        Raises:
            DermisError: there are fewer than k points, the queries have another dimension, or a value is not finite.
        """
        queries = np.ascontiguousarray(queries, np.float64)
        if not 1 <= k <= self.count:
            raise DermisError(
                "the number of neighbours is out of range", where="look-up table", value=k, limit=f"1 to {self.count}"
            )
        if queries.ndim != 2 or queries.shape[1] != self.dimensions:
            raise DermisError(
                "query and table have different numbers of channels",
                where="look-up table",
                value=queries.shape,
                limit=f"(n, {self.dimensions})",
            )
        turned = (queries - self._centre) @ self._axes
        size = float(np.vdot(turned, turned))  # sum of all queries, so at least that of each
        if not size < np.inf:  # true for NaN too
            raise DermisError("a query is not finite", where="look-up table")
        more = min(k + 1, self.count)  # one neighbour more, to detect ties
        distance, index = self._tree.query(turned, np.arange(1, more + 1))
        distance *= distance
        near, index = distance[:, :k], index[:, :k]
        if self._whole and self._size + size < EXACT and (queries == np.rint(queries)).all():
            np.rint(distance, out=distance)  # exact, since squared distances of whole numbers are whole
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
        """Return the k nearest points of a single query faster than `query`, or None.

        None is returned for exact hits, for ties for the last place, for fewer than k + 1 points and for a query that
        is not finite. `query` handles these cases.

        Args:
            query: shape (d,).
            k: number of neighbours.

        Returns:
            Indices and squared distances of the points, shape (k,) each.
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
        """Return the indices, in rising order, of all points within a squared distance of one query, shape (d,)."""
        turned = (np.asarray(query, np.float64) - self._centre) @ self._axes
        doubt = SLACK * (float(turned @ turned) + self._size)
        near = np.asarray(self._tree.query_ball_point(turned, np.sqrt(max(squared, 0.0) + doubt)), np.int64)
        near.sort()
        return near[self._squared(query, near) <= squared]

    def _decided(self, query: Array, found: Indices) -> tuple[Indices, Array, bool]:
        """Solve one query with the points as given.

        Args:
            query: shape (d,).
            found: its neighbours in rotated coordinates, shape (k,).

        Returns:
            Indices and squared distances of the neighbours, shape (k,) each, and whether they are tied.
        """
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

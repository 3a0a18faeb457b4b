"""Nearest neighbours by a k-d tree in principal axes, and weights that change smoothly with the query.

Readings of a device with few motors lie near a curved surface of few dimensions in the space of many channels. A k-d
tree divides space along the channels. Its boxes are oblique to this surface and mostly empty, so that a query with
noise, or from another finger, visits many of them. The points are therefore rotated to their principal axes first,
which changes no distance. Boxes are then thin where the surface is, and the axes across it cost hardly anything. On the
166,375 rows of the cable platform, this was measured to be 3 times as fast near the surface and up to 8 times as fast
far from it.

Which points are the nearest ones changes suddenly as a query moves. In a symmetric touch, two points are even equally
far up to rounding. The weight of a point therefore falls to zero at the distance of the first point that is left out. A
point comes and goes with weight zero, so a small change of the query or of the points changes a weighted mean little.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..errors import DermisError

NEIGHBOURS = 8  # number of neighbours that are averaged by the inverse square of their distance. Source: [S2] III.B
AT_ONCE = 4096  # queries whose neighbours' coordinates are held at once
LEAF = 32  # points in a leaf of the tree; the fastest as measured
LARGEST = 1e150  # of a value: the squares of larger ones are not finite, so no distance is
ROUNDING = 1e-12  # rounding error of a distance, relative to the norms of points and queries


def neighbours(dimensions: int) -> int:
    """Return the number of neighbours that are averaged with weights falling to zero.

    The mean square distance of the averaged points, by their weights, is that of `NEIGHBOURS` points weighted by the
    inverse square of their distance alone. For points spread evenly in D dimensions within a radius r it is
    (D - 2) / D r^2 by these weights, and (D - 2) / (D + 2) r^2 by weights that fall to zero at r, so r^2 is larger by
    (D + 2) / D.

    Args:
        dimensions: D, dimensions of the surface on which the points lie.

    >>> neighbours(3), neighbours(6)
    (17, 19)
    """
    return round(NEIGHBOURS * ((dimensions + 2) / dimensions) ** (dimensions / 2))


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Nearest points of each query, the nearest first.

    Attributes:
        index: indices of the points, shape (q, k).
        distance: their distances, shape (q, k).
        reach: distance of the first point that was left out, shape (q,); inf if there is none.
    """

    index: Indices
    distance: Array
    reach: Array

    def take(self, queries: Indices | slice) -> Neighbours:
        """Return the neighbours of some queries."""
        return Neighbours(self.index[queries], self.distance[queries], self.reach[queries])

    @cached_property
    def taper(self) -> Array:
        """Factors of the weights, from 1 at the query to 0 at the reach, shape (q, k).

        If all neighbours are as far as the reach, the factors are 1.
        """
        reach = self.reach[:, None]
        even = reach <= self.distance[:, :1] * (1.0 + ROUNDING)
        share = np.divide(self.distance, reach, out=np.zeros_like(self.distance), where=~even & np.isfinite(reach))
        return 1.0 - share * share

    @property
    def weights(self) -> Array:
        """Weights by the inverse square of the distance, less the inverse square of the reach, shape (q, k).

        The weights of a query sum to 1. A point that equals the query has weight 1.
        """
        nearest = self.distance[:, :1]
        ratio = np.divide(nearest, self.distance, out=np.ones_like(self.distance), where=self.distance > nearest)
        weights = self.taper * ratio * ratio
        return np.asarray(weights / weights.sum(axis=1, keepdims=True))


class NearestPoints:
    """Search structure for nearest neighbours among distinct points.

    Args:
        rows: points to be found, finite, shape (n, d). Several rows may be the same point.

    Attributes:
        points: the distinct points, shape (p, d).
        first: the first row of each point, shape (p,).

    Raises:
        DermisError: there are no points, or a value is not finite or above `LARGEST`.
    """

    def __init__(self, rows: NDArray[Any]) -> None:
        from scipy.spatial import cKDTree

        rows = np.ascontiguousarray(rows, np.float64)
        if rows.ndim != 2 or len(rows) == 0 or not np.isfinite(rows).all():
            raise DermisError("nearest neighbours need finite points", where="look-up table", value=rows.shape)
        _refuse_huge("a point", rows)
        self.dimensions = rows.shape[1]
        self.points, self.first, point = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        self._by_point = np.argsort(point.ravel(), kind="stable")
        self._ends = np.cumsum(np.bincount(point.ravel()))
        self.repeated: NDArray[np.bool_] = np.diff(self._ends, prepend=0) > 1  # of each point, whether it has two rows
        self._any_repeated = bool(self.repeated.any())
        self._centre = rows.mean(axis=0)
        own = self.points - self._centre
        _, axes = np.linalg.eigh(own.T @ own)
        self._axes = np.ascontiguousarray(axes[:, ::-1])  # widest first
        self._tree = cKDTree(own @ self._axes, leafsize=LEAF)

    def rows(self, point: int) -> Indices:
        """Return the rows of a point, rising."""
        return self._by_point[0 if point == 0 else self._ends[point - 1] : self._ends[point]]

    def query(self, queries: NDArray[Any], k: int) -> Neighbours:
        """Return the k nearest points of each query, or all points if there are fewer.

        Args:
            queries: shape (q, d).
            k: number of neighbours, at least 1.

        Raises:
            DermisError: the queries have another dimension, or a value is not finite or above `LARGEST`.
        """
        queries = np.ascontiguousarray(queries, np.float64)
        if queries.ndim != 2 or queries.shape[1] != self.dimensions:
            raise DermisError(
                "query and table have different numbers of channels",
                where="look-up table",
                value=queries.shape,
                limit=f"(n, {self.dimensions})",
            )
        turned = (queries - self._centre) @ self._axes
        if not np.isfinite(turned).all():
            raise DermisError("a query is not finite", where="look-up table")
        _refuse_huge("a query", queries)
        k = min(k, len(self.points))
        more = min(k + 1, len(self.points))
        index = self._tree.query(turned, np.arange(1, more + 1))[1]
        squared = np.empty(index.shape)
        for at in range(0, len(index), AT_ONCE):  # with the points as given, so that a hit is at distance 0
            rows = slice(at, at + AT_ONCE)
            squared[rows] = _squared(self.points[index[rows]], queries[rows, None])
        order = np.argsort(squared, axis=1, kind="stable")
        index, distance = (np.take_along_axis(a, order, axis=1) for a in (index, np.sqrt(squared)))
        reach = distance[:, k] if more > k else np.full(len(index), np.inf)
        return Neighbours(index[:, :k], distance[:, :k], reach)

    def query_one(self, query: Array, k: int) -> tuple[Indices, Array] | None:
        """Return the k nearest points of one query and their weights, faster than `query`.

        The weights are in proportion to `Neighbours.weights`. None is returned for a query that equals a point, that
        has a repeated point among its neighbours, whose neighbours are all equally far, or that is not finite, and for
        fewer than k + 1 points.

        Args:
            query: shape (d,).
            k: number of neighbours.

        Returns:
            Indices and weights of the points and of the first that is left out, shape (k + 1,) each.
        """
        turned = (query - self._centre) @ self._axes
        if not (k < len(self.points) and float(turned.dot(turned)) < np.inf):
            return None
        index = self._tree.query(turned, k + 1)[1]
        squared = _squared(self.points.take(index, axis=0), query)
        least = float(squared.min())
        if not 0.0 < least * (1.0 + 2.0 * ROUNDING) < squared.max():
            return None
        if self._any_repeated and self.repeated[index].any():
            return None
        inverse = 1.0 / squared
        return index, inverse - inverse.min()


def _refuse_huge(what: str, values: Array) -> None:
    largest = float(np.abs(values).max(initial=0.0))
    if largest > LARGEST:
        raise DermisError(
            f"{what} is too large for a distance", where="look-up table", value=largest, limit=f"{LARGEST:g}"
        )


def _squared(points: Array, query: Array) -> Array:
    """Return the squared distances of points, shape (..., d), from queries."""
    off = points - query
    return np.asarray(np.einsum("...i,...i->...", off, off))

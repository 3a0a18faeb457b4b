"""Exact nearest neighbours for points on a thin sheet, whether queries lie near that sheet or far off it.

Sensed data of a device with few motors lie on a sheet of few dimensions in the space of many channels. Near the sheet
a k-d tree finds neighbours in some 10 us. A query with much noise, or from another finger, lies far off it, and there a
k-d tree cannot prune: the box around a group of points knows nothing of the distance across the sheet, and most of the
tree is visited. For those queries a group knows its own flat: the principal directions of its points, their extent
along these, and how far they are from the flat. A query's distance splits into a part along the flat and one across
it, and both bound the distance from below. The bounds of all groups are one matrix product.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

GROUP = 64  # points in a group
FLAT = 3  # directions of a group's flat
FIRST = 2  # groups looked into before the others are ruled out
SLACK = 1e-9  # of the largest square: rounding of the bounds
CHUNK = 128  # queries at once
SHEET = 8  # principal directions that hold the sheet, for telling how far off it a query is
FAR = 0.3  # of the size of a group along its flat: queries farther off the sheet are left to the flats (measured)


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

    Raises:
        DermisError: no points, or values that are not finite.
    """

    def __init__(self, points: NDArray[Any]) -> None:
        points = np.ascontiguousarray(points, np.float64)
        if points.ndim != 2 or len(points) == 0 or not np.isfinite(points).all():
            raise DermisError("nearest neighbours need finite points", where="look-up table", value=points.shape)
        self.count, self.dimensions = points.shape
        self._centre = points.mean(axis=0)
        groups = _split(points - self._centre, GROUP)
        size = max(len(g) for g in groups)
        flat = min(FLAT, self.dimensions)
        self._index = np.full((len(groups), size), -1, np.int64)
        self._points = np.full((len(groups), size, self.dimensions), np.inf)
        middle = np.empty((len(groups), self.dimensions))
        axes = np.empty((len(groups), flat, self.dimensions))
        self._half = np.empty((len(groups), flat))
        self._away = np.empty(len(groups))
        for i, group in enumerate(groups):
            own = points[group] - self._centre
            self._index[i, : len(group)] = group
            self._points[i, : len(group)] = points[group]
            mean = own.mean(axis=0)
            _, vectors = np.linalg.eigh((own - mean).T @ (own - mean))
            axes[i] = vectors[:, ::-1][:, :flat].T
            along = own @ axes[i].T
            low, high = along.min(axis=0), along.max(axis=0)
            middle[i] = mean + (0.5 * (low + high) - mean @ axes[i].T) @ axes[i]
            self._half[i] = 0.5 * (high - low)
            off = own - middle[i]
            off -= (off @ axes[i].T) @ axes[i]
            self._away[i] = np.sqrt((off**2).sum(axis=1).max())
        flats = axes.transpose(1, 0, 2).reshape(-1, self.dimensions)
        self._bounds = np.ascontiguousarray(np.vstack([-2.0 * middle, flats]).T)
        self._middle2 = (middle**2).sum(axis=1)
        self._along = np.einsum("gfd,gd->fg", axes, middle)
        self._half = np.ascontiguousarray(self._half.T)
        self._flat = flat
        own = points - self._centre
        _, vectors = np.linalg.eigh(own.T @ own)
        self._across = np.ascontiguousarray(vectors[:, : max(self.dimensions - SHEET, 0)])
        self._far = FAR * 2.0 * float(np.sqrt((self._half**2).sum(axis=0).mean()))
        self._all = points

    @cached_property
    def _tree(self) -> cKDTree:
        from scipy.spatial import cKDTree as Tree

        return Tree(self._all)

    def query(self, queries: NDArray[Any], k: int) -> Neighbours:
        """Return the k nearest points of each query, shape (q, d).

        Raises:
            DermisError: more neighbours than points, another number of channels, or values that are not finite.
        """
        queries = np.ascontiguousarray(queries, np.float64)
        if not 1 <= k <= self.count:
            raise DermisError("as many neighbours as there are points", where="look-up table", value=k,
                              limit=f"1 to {self.count}")  # fmt: skip
        if queries.ndim != 2 or queries.shape[1] != self.dimensions:
            raise DermisError("the query has another number of channels than the table", where="look-up table",
                              value=queries.shape, limit=f"(n, {self.dimensions})")  # fmt: skip
        if not np.isfinite(queries).all():
            raise DermisError("a query is not finite", where="look-up table")
        far = np.linalg.norm((queries - self._centre) @ self._across, axis=1) > self._far
        if not far.any():
            return self._near(queries, k)
        index, squared = np.empty((len(queries), k), np.int64), np.empty((len(queries), k))
        tied = np.empty(len(queries), bool)
        off = np.flatnonzero(far)
        parts = [(off[i : i + CHUNK], self._some) for i in range(0, len(off), CHUNK)]
        for rows, search in [*parts, (np.flatnonzero(~far), self._near)]:
            if len(rows):
                found = search(queries[rows], k)
                index[rows], squared[rows], tied[rows] = found.index, found.squared, found.tied
        return Neighbours(index, squared, tied)

    def within(self, query: Array, squared: float) -> Indices:
        """Return all points at most as far from one query as given, by index, rising."""
        groups = np.flatnonzero(self._lower(query[None])[0] <= squared)
        away = ((self._points[groups] - query) ** 2).sum(axis=2)
        found: Indices = np.sort(self._index[groups][away <= squared])
        return found

    def _near(self, queries: Array, k: int) -> Neighbours:
        """Search the tree, for one neighbour more: it tells ties."""
        more = min(k + 1, self.count)
        _, index = self._tree.query(queries, [*range(1, more + 1)])
        # distances anew from the points: the tree's are roots, whose squares are rounded
        off = self._all[index]
        off -= queries[:, None]
        squared = np.einsum("qkd,qkd->qk", off, off)
        tied = squared[:, k] <= squared[:, k - 1] if more > k else np.zeros(len(queries), bool)
        if k > 1:
            tied |= squared[:, 1] == 0.0
        return Neighbours(index[:, :k], squared[:, :k], tied)

    def _some(self, queries: Array, k: int) -> Neighbours:
        count = len(queries)
        lower = self._lower(queries)
        groups, size = lower.shape[1], self._points.shape[1]
        least = int((self._index >= 0).sum(axis=1).min())
        first = min(max(FIRST, -(-k // least)), groups)
        best = np.argpartition(lower, first - 1, axis=1)[:, :first]
        away = self._away2(queries, np.repeat(np.arange(count), first), best.ravel()).reshape(count, -1)
        bound = np.partition(away, k - 1, axis=1)[:, k - 1]
        seen = np.zeros(lower.shape, bool)
        np.put_along_axis(seen, best, True, axis=1)
        rows, others = np.nonzero((lower <= bound[:, None]) & ~seen)
        more = self._away2(queries, rows, others)
        r0, c0 = np.nonzero(away <= bound[:, None])
        r1, c1 = np.nonzero(more <= bound[rows][:, None])
        owner = np.concatenate([r0, rows[r1]])
        squared = np.concatenate([away[r0, c0], more[r1, c1]])
        index = np.concatenate([self._index[best[r0, c0 // size], c0 % size], self._index[others[r1], c1]])
        order = np.lexsort((index, squared, owner))
        owner, squared, index = owner[order], squared[order], index[order]
        start = np.searchsorted(owner, np.arange(count + 1))
        at = start[:-1, None] + np.arange(k)
        near = squared[at]
        following = np.minimum(start[:-1] + k, len(squared) - 1)
        tied = (start[1:] - start[:-1] > k) & (squared[following] == near[:, -1])
        if k > 1:
            tied |= near[:, 1] == 0.0
        return Neighbours(index[at], near, tied)

    def _lower(self, queries: Array) -> Array:
        """Return a lower bound of the squared distance from each query to each group, shape (q, groups)."""
        groups = len(self._away)
        moved = queries - self._centre
        product = moved @ self._bounds
        square = (moved**2).sum(axis=1)[:, None]
        across = product[:, :groups]
        across += self._middle2
        across += square
        along = np.zeros_like(across)
        for f in range(self._flat):
            t = product[:, (1 + f) * groups : (2 + f) * groups]
            t -= self._along[f]
            np.abs(t, out=t)
            across -= t * t
            t -= self._half[f]
            np.maximum(t, 0.0, out=t)
            t *= t
            along += t
        np.maximum(across, 0.0, out=across)
        np.sqrt(across, out=across)
        across -= self._away
        np.maximum(across, 0.0, out=across)
        across *= across
        across += along
        # squares that cancel leave rounding of their own size
        across *= 1.0 - 1e-7
        across -= SLACK * (square + float(self._middle2.max()))
        return across

    def _away2(self, queries: Array, rows: Indices, groups: Indices) -> Array:
        """Return squared distances of queries to all points of groups, pair by pair, shape (pairs, size)."""
        off = self._points[groups]
        off -= queries[rows][:, None]
        out: Array = np.einsum("psd,psd->ps", off, off)
        return out


def _split(points: Array, size: int) -> list[Indices]:
    """Split points at medians along their widest direction into groups of at most `size`."""
    done, todo = [], [np.arange(len(points))]
    while todo:
        group = todo.pop()
        if len(group) <= size:
            done.append(group)
            continue
        own = points[group]
        own = own - own.mean(axis=0)
        _, vectors = np.linalg.eigh(own.T @ own)
        # whole groups of the full size: the last may be smaller
        half = size * -(-(len(group) // 2) // size)
        half = half if 0 < half < len(group) else len(group) // 2
        order = np.argpartition(own @ vectors[:, -1], half)
        todo += [group[order[half:]], group[order[:half]]]
    return done

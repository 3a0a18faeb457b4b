"""Which triangle is closest to each point: an exact search without any state.

Every candidate list is complete: a triangle is left out only where a lower bound of its distance exceeds an
upper bound of the closest one, so the answer is the same as trying all of them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array, Indices
from .triangles import TriangleTable

# Bounds are compared with this relative slack, far above rounding and far below any distance that matters.
SLACK = 1e-9
# Of squared bounds [m^2]: those of a triangle that a point lies on are rounding, and must not rule it out.
ON_IT = 1e-24
# Triangles within this relative squared distance of the best are equally close; the lowest index wins.
TIE = 1e-12
DENSE_PAIRS = 1_500_000
PAIRS_AT_ONCE = 2_000_000


class Nearest(NamedTuple):
    """The closest triangle of each point (-1: none within the limit), squared distance, weights of b and c."""

    triangle: Indices
    square: Array
    u: Array
    w: Array


def nearest(table: TriangleTable, points: Array, limit: Array, tree: CentroidTree | None = None) -> Nearest:
    """Return the closest triangle to each point within its limit.

    Args:
        points: [m], shape (n, 3).
        limit: largest distance of interest of each point [m], may be inf, shape (n,).
        tree: a search tree over the centroids, made here where the problem is large and none is given.
    """
    n, x = points.shape[0], np.ascontiguousarray(points.T)
    found = Nearest(np.full(n, -1), np.full(n, np.inf), np.zeros(n), np.zeros(n))
    if n == 0:
        return found
    kept = _within_box(table, points, limit)
    if kept.size == 0:
        return found
    if n * kept.size <= DENSE_PAIRS or (tree is None and kept.size < 64):
        step = max(1, DENSE_PAIRS // kept.size)
        for start in range(0, n, step):
            part = slice(start, min(start + step, n))
            owner, triangle = _dense_candidates(table, points[part], limit[part], kept)
            choose(table, x, owner + start, triangle, limit, found)
        return found
    tree = tree or CentroidTree(table)
    pending: list[tuple[Indices, Indices]] = []
    total = 0
    for owner, triangle in tree.candidates(points, limit):
        pending.append((owner, triangle))
        total += owner.size
        if total > PAIRS_AT_ONCE:
            _choose_all(table, x, pending, limit, found)
            pending, total = [], 0
    _choose_all(table, x, pending, limit, found)
    return found


def choose(table: TriangleTable, x: Array, owner: Indices, triangle: Indices, limit: Array, found: Nearest) -> None:
    """Measure candidate pairs exactly and write the closest of each point into `found`.

    Args:
        owner: the point of each pair, non-decreasing; triangle: its candidate, increasing for each point.
    """
    if owner.size == 0:
        return
    position = x.take(owner, axis=1)
    if owner.size > 2 * found.triangle.size:
        bound = table.disc_bound(position, triangle)
        first = np.flatnonzero(np.diff(owner, prepend=-1))
        of = owner[first]
        lowest = _first_at(bound, np.minimum.reduceat(bound, first), owner, first)
        upper = np.full(found.triangle.size, np.inf)
        upper[of] = table.closest(position[:, lowest], triangle[lowest])[0]
        np.minimum(upper, limit * limit, out=upper)
        keep = np.flatnonzero(bound <= upper[owner] * (1.0 + SLACK) + ON_IT)
        if keep.size == 0:
            return
        owner, triangle, position = owner[keep], triangle[keep], position[:, keep]
    square, u, w = table.closest(position, triangle)
    first = np.flatnonzero(np.diff(owner, prepend=-1))
    best = _first_at(square, np.minimum.reduceat(square, first) * (1.0 + TIE), owner, first)
    of = owner[best]
    better = (square[best] < found.square[of]) & (square[best] <= (limit[of] ** 2) * (1.0 + SLACK))
    best, of = best[better], of[better]
    found.triangle[of], found.square[of] = triangle[best], square[best]
    found.u[of], found.w[of] = u[best], w[best]


def _first_at(value: Array, threshold: Array, owner: Indices, first: Indices) -> Indices:
    """Index of the first pair of each owner whose value is at or below the owner's threshold."""
    counts = np.diff(first, append=owner.size)
    hits = np.flatnonzero(value <= np.repeat(threshold, counts))
    of = owner[hits]
    return hits[np.flatnonzero(np.diff(of, prepend=-1))]


def _choose_all(table: TriangleTable, x: Array, pending: Any, limit: Array, found: Nearest) -> None:
    if not pending:
        return
    owner = np.concatenate([p[0] for p in pending])
    triangle = np.concatenate([p[1] for p in pending])
    order = np.lexsort((triangle, owner))
    choose(table, x, owner[order], triangle[order], limit, found)


def _within_box(table: TriangleTable, points: Array, limit: Array) -> Indices:
    """Usable triangles whose bounding sphere comes within the limits of the points' bounding box."""
    usable = table.usable
    search_radius = float(limit.max())
    if np.isfinite(search_radius):
        centre, radius = table.bounds[0:3], table.bounds[6] + search_radius * (1.0 + SLACK)
        for axis in range(3):
            low, high = points[:, axis].min(), points[:, axis].max()
            usable = usable & (centre[axis] >= low - radius) & (centre[axis] <= high + radius)
    return np.flatnonzero(usable)


def _dense_candidates(table: TriangleTable, points: Array, limit: Array, kept: Indices) -> tuple[Indices, Indices]:
    """All pairs by bounding spheres, by one matrix product."""
    origin = points.mean(axis=0)
    p = points - origin
    c = table.bounds[0:3, kept].T - origin
    pp, cc = (p * p).sum(axis=1), (c * c).sum(axis=1)
    distance = p @ c.T
    distance *= -2.0
    distance += pp[:, None]
    distance += cc
    np.maximum(distance, 0.0, out=distance)
    np.sqrt(distance, out=distance)
    # the product cancels: sqrt(eps) of the largest length is its worst error
    slack = 4e-8 * np.sqrt(pp + cc.max())
    upper = np.minimum(distance.min(axis=1), limit) + 2.0 * slack
    distance -= table.bounds[6, kept]
    owner, column = np.nonzero(distance <= upper[:, None])
    return owner, kept[column]


class CentroidTree:
    """Search trees over triangle centroids, one for each octave of triangle size, so that a few large
    triangles do not widen the search among many small ones."""

    def __init__(self, table: TriangleTable) -> None:
        from scipy.spatial import cKDTree

        self._table = table
        usable = np.flatnonzero(table.usable)
        radius = table.bounds[6, usable]
        octave = np.ceil(np.log2(np.maximum(radius, radius.max() * 1e-6))).astype(int)
        self._classes = []
        for value in np.unique(octave):
            members = usable[octave == value]
            centres = np.ascontiguousarray(table.bounds[0:3, members].T)
            largest = float(table.bounds[6, members].max())
            self._classes.append((members, cKDTree(centres, balanced_tree=False), largest))

    def candidates(self, points: Array, limit: Array) -> Any:
        """Yield (owner, triangle) arrays that hold every possible closest triangle within the limits."""
        x = np.ascontiguousarray(points.T)
        upper = limit.copy()
        for members, tree, _ in self._classes:
            distance, index = tree.query(points)
            near = np.flatnonzero(distance * 0.0 == 0.0)
            exact = np.sqrt(self._table.closest(x[:, near], members[index[near]])[0])
            upper[near] = np.minimum(upper[near], exact)
        upper = upper * (1.0 + SLACK)
        step = 4096
        for start in range(0, points.shape[0], step):
            part = slice(start, start + step)
            for members, tree, radius in self._classes:
                lists = tree.query_ball_point(points[part], upper[part] + radius * (1.0 + SLACK), return_sorted=True)
                counts = np.fromiter(map(len, lists), dtype=np.int64, count=len(lists))
                if counts.any():
                    flat = np.concatenate([np.asarray(item, dtype=np.int64) for item in lists if item])
                    yield np.repeat(np.arange(start, start + counts.size), counts), members[flat]

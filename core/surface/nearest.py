"""Which triangle is closest to each point: an exact search without any state.

A triangle is left out only where a lower bound of its distance exceeds an upper bound of the closest one, so the
answer is the same as trying all of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from .tree import TriangleTree
from .triangles import TriangleTable

# Triangles within this relative squared distance of the best are equally close; the lowest index wins.
TIE = 1e-12
PAIRS_AT_ONCE = 1_500_000
# So many points are looked for at once, about: what is worked out then stays in a processor's cache.
POINTS_AT_ONCE = 700
# A margin for rounding, relative to lengths.
SLACK = 1e-9


class Nearest(NamedTuple):
    """The closest triangles of points.

    Attributes:
        which: the points that have one within the limit, rising, shape (k,).
        triangle: the closest of each, shape (k,). u, w: weights of its second and third corner, shape (k,) each.
    """

    which: Indices
    triangle: Indices
    u: Array
    w: Array


class TriangleSpheres:
    """All triangles of a surface as balls: a search that needs no preparation, for a few points.

    Args:
        table: the triangles; one must be usable at least.
    """

    def __init__(self, table: TriangleTable) -> None:
        self._usable = np.flatnonzero(table.usable)
        self._bounds = table.bounds if self._usable.size == table.usable.size else table.bounds[:, self._usable]

    def candidates(self, points: Array, limit: float, most: int) -> tuple[Indices, Indices]:
        """Return pairs as `TriangleTree.candidates` does, however many."""
        radius, found = self._bounds[6], []
        for x in points:
            away = self._bounds[0:3] - x[:, None]
            distance = np.sqrt(np.einsum("in,in->n", away, away))
            upper = min(float((distance + radius).min()), limit)
            found.append(self._usable[distance - radius <= upper * (1.0 + SLACK) + SLACK * float(np.abs(x).max())])
        return np.repeat(np.arange(len(points)), [some.size for some in found]), np.concatenate(found)


def nearest(table: TriangleTable, tree: TriangleTree | TriangleSpheres | None, points: Array, limit: float) -> Nearest:
    """Return the closest triangle to each point.

    Args:
        tree: of the triangles; None where none of them is usable.
        points: [m], shape (n, 3).
        limit: largest distance of interest [m], may be inf.
    """
    n = len(points)
    if tree is None or n == 0:
        return Nearest(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0))
    if n <= POINTS_AT_ONCE:
        pairs = tree.candidates(points, limit, PAIRS_AT_ONCE if n > 1 else np.iinfo(np.int64).max)
        if pairs is not None:
            return _closest(table, np.ascontiguousarray(points.T), *pairs, limit)
        # too many of them are equally near, as about the middle of a ball
    one, other = (nearest(table, tree, half, limit) for half in (points[: n // 2], points[n // 2 :]))
    joined = [np.concatenate(columns) for columns in zip(one, other, strict=True)]
    joined[0][one.which.size :] += n // 2
    return Nearest(*joined)


def _closest(table: TriangleTable, x: Array, owner: Indices, triangle: Indices, limit: float) -> Nearest:
    """Measure candidate pairs exactly and return the closest of each point.

    Args:
        owner: the point of each pair, non-decreasing. triangle: its candidate.
    """
    if owner.size == 0:
        return Nearest(owner, triangle, np.zeros(0), np.zeros(0))
    square, u, w = table.closest(x.take(owner, axis=1), triangle)
    begins = _begins(owner)
    least = np.minimum.reduceat(square, begins.nonzero()[0])
    least[least > limit * limit] = -1.0
    least *= 1.0 + TIE
    best = (square <= least.take(begins.cumsum() - 1)).nonzero()[0]
    which = owner.take(best)
    begins = _begins(which)
    if not begins.all():
        best = best[np.lexsort((triangle.take(best), which))][begins]
        which = owner.take(best)
    return Nearest(which, triangle.take(best), u.take(best), w.take(best))


def _begins(owner: Indices) -> NDArray[np.bool_]:
    """Return whether each is the first of a run of equal values."""
    new = np.empty(owner.size, dtype=bool)
    new[:1] = True
    np.not_equal(owner[1:], owner[:-1], out=new[1:])
    return new

"""Triangles as arrays of numbers, and the exact closest point on each of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices

# A triangle flatter than this (twice its area over its longest edge squared) has no usable normal.
FLAT = 1e-10
# The closest point on one flatter than this is looked for on its edges first: the Gram determinant has few digits left.
SLIVER = 1e-4
# So is that to points nearer than this, squared and over squared edges: squares tell edges apart to half of the digits.
NEAR = 1e-12


@dataclass(frozen=True, eq=False)
class TriangleTable:
    """What distance queries need of each triangle, one row per quantity so that gathers are contiguous.

    Attributes:
        rows: corner a (3), edges ab (3) and ac (3) [m], squared lengths of ab, ac and bc, ab.ac [m^2], and the
            reciprocal of the Gram determinant of ab and ac (0 without area) [m^-4], shape (14, T).
        bounds: centroid (3), unit normal (3), circumscribing radius about the centroid (1), shape (7, T).
        usable: False for triangles without area, shape (T,).
        slivers: True for those that are nearly without, shape (T,); None where there are none.
    """

    rows: Array
    bounds: Array
    usable: NDArray[np.bool_]
    slivers: NDArray[np.bool_] | None = None

    @classmethod
    def build(cls, vertices: Array, triangles: NDArray[np.integer]) -> TriangleTable:
        """Tabulate triangles: vertices [m], shape (V, 3); indices, shape (T, 3)."""
        columns = np.ascontiguousarray(vertices.T)
        a, b, c = (columns[:, triangles[:, k]] for k in range(3))
        ab, ac = b - a, c - a
        rows = np.empty((14, triangles.shape[0]))
        rows[0:3], rows[3:6], rows[6:9] = a, ab, ac
        rows[9], rows[10], rows[12] = _dot(ab, ab), _dot(ac, ac), _dot(ab, ac)
        rows[11] = rows[9] - 2.0 * rows[12] + rows[10]
        bounds = np.empty((7, triangles.shape[0]))
        centre = bounds[0:3]
        np.add(ab, ac, out=centre)
        centre /= 3.0
        bounds[6] = np.sqrt(np.maximum(np.maximum(_square(centre), _square(ab - centre)), _square(ac - centre)))
        centre += a
        normal = bounds[3:6]
        normal[0] = ab[1] * ac[2] - ab[2] * ac[1]
        normal[1] = ab[2] * ac[0] - ab[0] * ac[2]
        normal[2] = ab[0] * ac[1] - ab[1] * ac[0]
        area2 = np.sqrt(_square(normal))
        longest = np.max(rows[9:12], axis=0)
        usable, slivers = area2 > FLAT * longest, area2 < SLIVER * longest
        rows[13] = 0.0
        np.divide(1.0, area2 * area2, out=rows[13], where=usable)
        np.divide(normal, area2, out=normal, where=usable)
        normal[:, ~usable] = 0.0
        return cls(rows, bounds, usable, slivers if slivers.any() else None)

    def closest(self, x: Array, triangle: Indices) -> tuple[Array, Array, Array]:
        """Return squared distances and barycentric weights (of corners b and c) of the closest points.

        Args:
            x: points as columns [m], shape (3, n).
            triangle: the triangle to measure each point against, shape (n,).

        Weights on an edge or a corner are exactly 0, or sum exactly to 1, so the feature can be read off them.
        """
        v, rows, weights = self._projected(x, triangle)
        if self.slivers is not None:
            _measure(self.slivers.take(triangle), v, rows, weights)
        square = _square(_left(v, rows, weights))
        _measure(square < NEAR * (rows[9] + rows[10]), v, rows, weights, square)
        return square, weights[0], weights[1]

    def within(self, x: Array, triangle: Indices) -> Array:
        """Return squared distances within which triangles are of points, but for rounding: mostly the least, (n,).

        Args:
            x, triangle: as for `closest`.
        """
        return _square(_left(*self._projected(x, triangle)))

    def _projected(self, x: Array, triangle: Indices) -> tuple[Array, Array, Array]:
        """Return points seen from corner a [m], shape (3, n), their triangles' rows and the closest points' weights.

        The weights, shape (2, n), have as many digits as squared distances tell edges apart.
        """
        rows = self.rows.take(triangle, axis=1)
        v = x - rows[0:3]
        along = _dot(v, rows[3:9].reshape(2, 3, -1))
        weights = _solved(rows, along)
        off = np.minimum(weights[0], weights[1])
        np.minimum(off, 1.0 - weights[0] - weights[1], out=off)
        outside = (off < 0.0).nonzero()[0]
        if outside.size:
            weights[:, outside] = _closest_on_edges(along.take(outside, axis=1), rows[9:13].take(outside, axis=1))
        return v, rows, weights

    def point(self, triangle: Indices, u: Array, w: Array) -> Array:
        """Return the points with the given weights [m], shape (n, 3)."""
        rows = self.rows[:9].take(triangle, axis=1)
        return (rows[0:3] + u * rows[3:6] + w * rows[6:9]).T


def _closest_on_edges(to: Array, gram: Array) -> Array:
    """Weights on the closest of ab, ac and bc, for points whose projection falls outside the triangle, shape (2, n).

    Args:
        to: products of points, seen from corner a, with ab and ac [m^2], shape (2, n). gram: rows 9 to 12 of a table.
    """
    square = gram[0:3]
    along = np.empty_like(square)
    along[:2] = to
    from_b = square[0] - to[0]
    np.add(to[1], from_b, out=along[2])
    along[2] -= gram[3]
    t = along / square
    np.maximum(t, 0.0, out=t)
    np.minimum(t, 1.0, out=t)
    # squared distances less the common |p - a|^2
    excess = square * t
    along *= 2.0
    excess -= along
    excess *= t
    from_b -= to[0]
    excess[2] += from_b
    first = excess[0] <= np.minimum(excess[1], excess[2])
    second = excess[1] <= excess[2]
    out = np.empty_like(to)
    out[0] = np.where(first, t[0], np.where(second, 0.0, 1.0 - t[2]))
    out[1] = np.where(first, 0.0, np.where(second, t[1], t[2]))
    return out


def _measure(which: NDArray[np.bool_], v: Array, rows: Array, weights: Array, square: Array | None = None) -> None:
    """Measure the ways to all edges and the face of some triangles, and put the closest into weights and square.

    Args:
        v: points seen from corner a [m], shape (3, n). rows: of the triangles. weights: first guess, shape (2, n).
    """
    some = which.nonzero()[0]
    if some.size:
        least, weights[:, some] = _measured(v.take(some, axis=1), rows.take(some, axis=1), weights.take(some, axis=1))
        if square is not None:
            square[some] = least


def _measured(v: Array, rows: Array, weights: Array) -> tuple[Array, Array]:
    """Return squared distances and weights of the closest points, where squares alone would not tell.

    Args:
        v: points seen from corner a [m], shape (3, n). rows: of the triangles. weights: first guess, shape (2, n).
    """
    n = v.shape[1]
    edges, starts = np.empty((3, 3, n)), np.empty((3, 3, n))  # ab, ac, bc, and points seen from where they begin
    edges[:2] = rows[3:9].reshape(2, 3, n)
    np.subtract(edges[1], edges[0], out=edges[2])
    starts[:2] = v
    np.subtract(v, edges[0], out=starts[2])
    share = _dot(starts, edges)
    share /= np.maximum(rows[9:12], 1e-300)
    np.maximum(share, 0.0, out=share)
    np.minimum(share, 1.0, out=share)
    for _ in range(2):  # what a guess leaves along the face tells by how much it is off
        weights = weights + _solved(rows, _dot(_left(v, rows, weights), edges[:2]))
    u, w = weights
    squares = np.empty((4, n))
    squares[:3] = _square(starts - share[:, None] * edges)
    squares[3] = np.where((np.minimum(u, w) > 0.0) & (u + w < 1.0), _square(_left(v, rows, weights)), np.inf)
    of_each = np.zeros((2, 4, n))
    of_each[0, 0], of_each[1, 1], of_each[1, 2] = share
    np.subtract(1.0, share[2], out=of_each[0, 2])
    of_each[:, 3] = weights
    best, column = squares.argmin(axis=0), np.arange(n)
    return squares[best, column], of_each[:, best, column]


def _solved(rows: Array, along: Array) -> Array:
    """Return the weights of points of a plane, from their products with ab and ac [m^2], shape (2, n) each."""
    weights = rows[10:8:-1] * along
    weights -= rows[12] * along[::-1]
    weights *= rows[13]
    return weights


def _left(v: Array, rows: Array, weights: Array) -> Array:
    """Return the ways from points of triangles to points seen from corner a [m], shape (3, n)."""
    part = weights[:, None] * rows[3:9].reshape(2, 3, -1)
    left: Array = v - part[0]
    left -= part[1]
    return left


def _dot(a: Array, b: Array) -> Array:
    """Return products of columns, shapes (..., 3, n)."""
    product = a * b
    out: Array = product[..., 0, :] + product[..., 1, :]
    out += product[..., 2, :]
    return out


def _square(a: Array) -> Array:
    return _dot(a, a)

"""An oracle of closest points: every triangle is tried, by numpy, with the operations of core/kernels/triangle.h.

Their order is the same, and so are the bytes. Exact answers and Ericson's regions in test_gap.py tell if it is right.
"""

from __future__ import annotations

import numpy as np

from core.arrays import Array, Indices
from core.surface.triangles import TriangleTable

# Triangles within this relative squared distance of the best are equally close; the lowest number wins.
TIE = 1e-12
# Points nearer than this, squared and over squared edges, are measured again: squares have half of the digits.
NEAR = 1e-12


def nearest(table: TriangleTable, points: Array, limit: float = np.inf) -> tuple[Indices, Array, Array, Array]:
    """Return the closest triangle of each point, -1 beyond a limit [m], squared distance, weights of b and c."""
    usable = np.flatnonzero(table.usable)
    triangle, square = np.full(len(points), -1), np.full(len(points), np.inf)
    weights = np.zeros((2, len(points)))
    for i, point in enumerate(points):
        squares, u, w = closest(table, np.tile(point[:, None], usable.size), usable)
        least = squares.min()
        if least <= limit * limit:
            k = int(np.flatnonzero(squares <= least * (1.0 + TIE))[0])
            triangle[i], square[i], weights[:, i] = usable[k], squares[k], (u[k], w[k])
    return triangle, square, *weights


def closest(table: TriangleTable, x: Array, triangle: Indices) -> tuple[Array, Array, Array]:
    """Return squared distances and barycentric weights (of corners b and c) of the closest points.

    Args:
        x: points as columns [m], shape (3, n). triangle: the one to measure each point against, shape (n,).
    """
    rows = table.rows.take(triangle, axis=1)
    v = x - rows[0:3]
    along = _dot(v, rows[3:9].reshape(2, 3, -1))
    weights = _solved(rows, along)
    off = np.minimum(weights[0], weights[1])
    np.minimum(off, 1.0 - weights[0] - weights[1], out=off)
    outside = (off < 0.0).nonzero()[0]
    if outside.size:
        weights[:, outside] = _closest_on_edges(along.take(outside, axis=1), rows[9:13].take(outside, axis=1))
    if table.slivers is not None:
        _measure(table.slivers.take(triangle), v, rows, weights)
    square = _square(_left(v, rows, weights))
    _measure(square < NEAR * (rows[9] + rows[10]), v, rows, weights, square)
    return square, weights[0], weights[1]


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


def _measure(which: Array, v: Array, rows: Array, weights: Array, square: Array | None = None) -> None:
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
    for _ in range(2):  # the rest along the face is the error of the guess
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

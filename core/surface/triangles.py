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
        rows = self.rows.take(triangle, axis=1)
        ab, ac = rows[3:6], rows[6:9]
        g11, g22, _, g12, scale = rows[9:14]
        v = x - rows[0:3]
        d1, d2 = _dot(v, ab), _dot(v, ac)
        u = g22 * d1
        u -= g12 * d2
        u *= scale
        w = g11 * d2
        w -= g12 * d1
        w *= scale
        off = np.minimum(u, w)
        np.minimum(off, 1.0 - u - w, out=off)
        outside = (off < 0.0).nonzero()[0]
        if outside.size:
            u[outside], w[outside] = _closest_on_edges(
                d1.take(outside), d2.take(outside), rows[9:13].take(outside, axis=1)
            )
        if self.slivers is not None:
            _measure(self.slivers.take(triangle), v, rows[3:], u, w)
        square = _square(v - u * ab - w * ac)
        _measure(square < NEAR * (g11 + g22), v, rows[3:], u, w, square)
        return square, u, w

    def point(self, triangle: Indices, u: Array, w: Array) -> Array:
        """Return the points with the given weights [m], shape (n, 3)."""
        rows = self.rows[:9].take(triangle, axis=1)
        return (rows[0:3] + u * rows[3:6] + w * rows[6:9]).T


def _closest_on_edges(d1: Array, d2: Array, gram: Array) -> tuple[Array, Array]:
    """Closest of the edges ab, ac and bc, for points whose projection falls outside the triangle."""
    square = gram[0:3]
    along = np.empty_like(square)
    along[0], along[1] = d1, d2
    from_b = square[0] - d1
    np.add(d2, from_b, out=along[2])
    along[2] -= gram[3]
    t = along / square
    np.maximum(t, 0.0, out=t)
    np.minimum(t, 1.0, out=t)
    # squared distances less the common |p - a|^2
    excess = square * t
    along *= 2.0
    excess -= along
    excess *= t
    from_b -= d1
    excess[2] += from_b
    first = excess[0] <= np.minimum(excess[1], excess[2])
    second = excess[1] <= excess[2]
    u = np.where(first, t[0], np.where(second, 0.0, 1.0 - t[2]))
    w = np.where(first, 0.0, np.where(second, t[1], t[2]))
    return u, w


def _measure(which: NDArray[np.bool_], v: Array, rows: Array, u: Array, w: Array, square: Array | None = None) -> None:
    """Measure the ways to all edges and the face of some triangles, and put the closest into u, w and square.

    Args:
        v: points seen from corner a [m], shape (3, n). rows: as those of a table from the third on.
    """
    some = which.nonzero()[0]
    if some.size:
        least, u[some], w[some] = _measured(v[:, some], rows.take(some, axis=1), u[some], w[some])
        if square is not None:
            square[some] = least


def _measured(v: Array, rows: Array, u: Array, w: Array) -> tuple[Array, Array, Array]:
    """Return squared distances and weights of the closest points, where squares alone would not tell.

    Args:
        v: points seen from corner a [m], shape (3, n). rows: as those of a table from the third on. u, w: first guess.
    """
    ab, ac, (g11, g22, g33, g12, scale) = rows[:3], rows[3:6], rows[6:]
    bc, from_b = ac - ab, v - ab
    one, two, three = (
        np.clip(_dot(p, edge) / np.maximum(square, 1e-300), 0.0, 1.0)
        for p, edge, square in ((v, ab, g11), (v, ac, g22), (from_b, bc, g33))
    )
    for _ in range(2):  # what a guess leaves along the face tells by how much it is off
        left = v - u * ab - w * ac
        d1, d2 = _dot(left, ab), _dot(left, ac)
        u, w = u + (g22 * d1 - g12 * d2) * scale, w + (g11 * d2 - g12 * d1) * scale
    within = (np.minimum(u, w) > 0.0) & (u + w < 1.0)
    face = np.where(within, _square(v - u * ab - w * ac), np.inf)
    off = [_square(v - one * ab), _square(v - two * ac), _square(from_b - three * bc), face]
    best, zero = np.argmin(off, axis=0), np.zeros_like(one)
    return (np.choose(best, off), np.choose(best, [one, zero, 1.0 - three, u]), np.choose(best, [zero, two, three, w]))


def _dot(a: Array, b: Array) -> Array:
    product = a * b
    out: Array = product[0] + product[1]
    out += product[2]
    return out


def _square(a: Array) -> Array:
    return _dot(a, a)

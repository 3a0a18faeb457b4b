"""Triangles as arrays of numbers, and the exact closest point on each of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# A triangle flatter than this (twice its area over its longest edge squared) has no usable normal.
FLAT = 1e-10


@dataclass(frozen=True, eq=False)
class TriangleTable:
    """What distance queries need of each triangle, one row per quantity so that gathers are contiguous.

    Attributes:
        rows: corner a (3), edges ab (3) and ac (3), their Gram matrix (3) [m, m^2], shape (12, T).
        bounds: centroid (3), unit normal (3), circumscribing radius about the centroid (1), shape (7, T).
        usable: False for triangles without area, shape (T,).
    """

    rows: Array
    bounds: Array
    usable: NDArray[np.bool_]

    @classmethod
    def build(cls, vertices: Array, triangles: NDArray[np.integer]) -> TriangleTable:
        """Tabulate triangles: vertices [m], shape (V, 3); indices, shape (T, 3)."""
        columns = np.ascontiguousarray(vertices.T)
        a, b, c = (columns[:, triangles[:, k]] for k in range(3))
        ab, ac = b - a, c - a
        rows = np.empty((12, triangles.shape[0]))
        rows[0:3], rows[3:6], rows[6:9] = a, ab, ac
        rows[9], rows[10], rows[11] = _dot(ab, ab), _dot(ab, ac), _dot(ac, ac)
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
        longest = np.maximum(np.maximum(rows[9], rows[11]), rows[9] + rows[11] - 2.0 * rows[10])
        usable = area2 > FLAT * longest
        np.divide(normal, area2, out=normal, where=usable)
        normal[:, ~usable] = 0.0
        return cls(rows, bounds, usable)

    def closest(self, x: Array, triangle: Indices) -> tuple[Array, Array, Array]:
        """Return squared distances and barycentric weights (of corners b and c) of the closest points.

        Args:
            x: points as columns [m], shape (3, n).
            triangle: the triangle to measure each point against, shape (n,).

        Weights on an edge or a corner are exactly 0, or sum exactly to 1, so the feature can be read off them.
        """
        rows = self.rows.take(triangle, axis=1)
        ab, ac = rows[3:6], rows[6:9]
        g11, g12, g22 = rows[9:12]
        v = x - rows[0:3]
        ab_v, ac_v = v * ab, v * ac
        d1 = ab_v[0] + ab_v[1]
        d1 += ab_v[2]
        d2 = ac_v[0] + ac_v[1]
        d2 += ac_v[2]
        det = g11 * g22
        det -= g12 * g12
        u = g22 * d1
        u -= g12 * d2
        u /= det
        w = g11 * d2
        w -= g12 * d1
        w /= det
        off = u < 0.0
        off |= w < 0.0
        off |= u + w > 1.0
        outside = off.nonzero()[0]
        if outside.size:
            edge = np.stack([d1, d2, g11, g12, g22]).take(outside, axis=1)
            u[outside], w[outside] = _closest_on_edges(*edge)
        ab *= u
        v -= ab
        ac *= w
        v -= ac
        v *= v
        square = v[0] + v[1]
        square += v[2]
        return square, u, w

    def disc_bound(self, x: Array, triangle: Indices) -> Array:
        """Return a lower bound of the squared distance: that to the disc about each triangle, in its plane."""
        cx, cy, cz, nx, ny, nz, radius = self.bounds.take(triangle, axis=1)
        cx, cy, cz = x[0] - cx, x[1] - cy, x[2] - cz
        height = cx * nx + cy * ny + cz * nz
        height *= height
        across = cx * cx + cy * cy + cz * cz
        across -= height
        np.maximum(across, 0.0, out=across)
        np.sqrt(across, out=across)
        across -= radius
        np.maximum(across, 0.0, out=across)
        across *= across
        across += height
        return across

    def point(self, triangle: Indices, u: Array, w: Array) -> Array:
        """Return the points with the given weights [m], shape (n, 3)."""
        rows = self.rows[:9].take(triangle, axis=1)
        return (rows[0:3] + u * rows[3:6] + w * rows[6:9]).T


def _closest_on_edges(d1: Array, d2: Array, g11: Array, g12: Array, g22: Array) -> tuple[Array, Array]:
    """Closest of the three edges, for points whose projection falls outside the triangle."""
    g_bc = g11 - 2.0 * g12
    g_bc += g22
    t = np.stack([d1 / g11, d2 / g22, (d2 - d1 + g11 - g12) / g_bc])
    np.maximum(t, 0.0, out=t)
    np.minimum(t, 1.0, out=t)
    t_ab, t_ac, t_bc = t
    # squared distances less the common |p - a|^2
    e_ab = t_ab * (t_ab * g11 - 2.0 * d1)
    e_ac = t_ac * (t_ac * g22 - 2.0 * d2)
    s = 1.0 - t_bc
    e_bc = s * (s * g11 + 2.0 * (t_bc * g12 - d1)) + t_bc * (t_bc * g22 - 2.0 * d2)
    first = (e_ab <= e_ac) & (e_ab <= e_bc)
    second = ~first & (e_ac <= e_bc)
    u = np.where(first, t_ab, np.where(second, 0.0, s))
    w = np.where(first, 0.0, np.where(second, t_ac, t_bc))
    return u, w


def _dot(a: Array, b: Array) -> Array:
    out: Array = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return out


def _square(a: Array) -> Array:
    return _dot(a, a)

"""TriangleTable: data of triangles for distance queries."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array

# Twice a triangle's area, divided by the square of its longest edge. Up to this ratio a triangle has no usable normal.
FLAT = 1e-10
# Below this ratio, the closest point is first searched on the edges, since the Gram determinant has few exact digits.
SLIVER = 1e-4


@dataclass(frozen=True, eq=False)
class TriangleTable:
    """Data of triangles for distance queries.

    There is one row per quantity, so that the data of several triangles are gathered from contiguous memory.

    Attributes:
        rows: corner a (3), edges ab (3) and ac (3) [m]; squared lengths of ab, ac and bc (3) [m^2]; dot product of ab
            and ac (1) [m^2]; reciprocal of the Gram determinant of ab and ac (1), 0 without area [m^-4]. Shape (14, T).
        bounds: centroid (3), unit normal (3), circumscribing radius about the centroid (1), shape (7, T).
        usable: False for triangles without area, shape (T,).
        slivers: True for triangles with nearly no area, shape (T,); None if there are none.
    """

    rows: Array
    bounds: Array
    usable: NDArray[np.bool_]
    slivers: NDArray[np.bool_] | None = None

    @classmethod
    def build(cls, vertices: Array, triangles: NDArray[np.integer]) -> TriangleTable:
        """Return the table of triangles.

        Args:
            vertices: vertices [m], shape (V, 3).
            triangles: indices of vertices, shape (T, 3).
        """
        columns = np.ascontiguousarray(vertices.T)
        a, b, c = (columns[:, triangles[:, k]] for k in range(3))
        ab, ac = b - a, c - a
        rows = np.empty((14, triangles.shape[0]))
        rows[0:3], rows[3:6], rows[6:9] = a, ab, ac
        rows[9], rows[10], rows[12] = column_dots(ab, ab), column_dots(ac, ac), column_dots(ab, ac)
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

    def without(self, ignored: NDArray[np.bool_]) -> TriangleTable:
        """Return the table with some triangles treated as if without area.

        Args:
            ignored: whether each triangle is to be ignored, shape (T,).
        """
        rows, bounds = self.rows.copy(), self.bounds.copy()
        rows[13, ignored] = bounds[3:6, ignored] = 0.0
        return TriangleTable(rows, bounds, self.usable & ~ignored, self.slivers)


def column_dots(a: Array, b: Array) -> Array:
    """Return dot products of columns, from shapes (..., 3, n) to (..., n)."""
    product = a * b
    out: Array = product[..., 0, :] + product[..., 1, :]
    out += product[..., 2, :]
    return out


def _square(a: Array) -> Array:
    return column_dots(a, a)


def column_crosses(a: Array, b: Array) -> Array:
    """Return the cross products of columns, shape (3, n)."""
    out = np.empty_like(a)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.subtract(a[j] * b[k], a[k] * b[j], out=out[i])
    return out

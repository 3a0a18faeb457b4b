"""Signed gaps computed by numpy, if no kernels are available.

They serve devices without a skin. They are exact, but slow to compute. Everything else uses `KernelBody`. The results
of both agree except for rounding.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from .gap_query import GapQuery
from .topology import BOUNDARY, Topology
from .triangles import TriangleTable
from .winding import winding

# These are the values of core/kernels.
# TIE: triangles are equally close if their squared distances differ by less than this share; the lowest index is taken.
# ON_FEATURE: a weight up to this counts as zero, so the point is on an edge or a corner.
# ON_SURFACE: [m] up to this distance, the direction to the surface is not defined.
# STRAIGHT: a point is straight above a rim if its offset along the face is up to this share of its distance.
TIE, ON_FEATURE, ON_SURFACE, STRAIGHT = 1e-12, 1e-9, 1e-9, 1e-6
# Margin for rounding, relative to lengths.
SLACK = 1e-9


class PlainTriangles:
    """Usable triangles of one surface, at least one.

    Args:
        table: the triangles.
        topology: adjacency of the triangles.
        corners: corners of the triangles [m], shape (T, 3, 3).
    """

    def __init__(self, table: TriangleTable, topology: Topology, corners: Array) -> None:
        self._table, self._topology, self._corners = table, topology, corners
        self._usable = np.flatnonzero(table.usable)

    def query(self, points: Array, limit: float) -> GapQuery:
        """Return the signed gap, closest point and normal of each point.

        Arguments are those of `KernelBody.query`.
        """
        n = len(points)
        found = GapQuery(
            np.full(n, np.inf),
            np.zeros((n, 3)),
            np.full((n, 3), np.nan),
            np.full(n, -1),
            np.zeros((n, 3)),
            np.zeros(n, np.bool_),
        )
        centres, radius = self._table.bounds[0:3].take(self._usable, axis=1), self._table.bounds[6].take(self._usable)
        inside = self._inside(points)
        for i, x in enumerate(points):
            reach = np.inf if inside[i] else limit
            away = centres - x[:, None]
            distance = np.sqrt((away * away).sum(axis=0))
            near = min(float((distance + radius).min()), reach) * (1.0 + SLACK) + SLACK * float(np.abs(x).max())
            close = self._usable[distance - radius <= near]
            if not close.size:
                continue
            square, weights = self._measured(x, close)
            least = float(square.min())
            if least > reach * reach:
                continue
            ties = np.flatnonzero(square <= least * (1.0 + TIE))  # the lowest index comes first
            self._put(found, i, x, close[ties], weights[:, ties], bool(inside[i]))
        return found

    def _inside(self, points: Array) -> NDArray[np.bool_]:
        """Return which points are inside, shape (n,); none for an open surface.

        For a closed surface that is inside out, these are the points that it does not enclose.
        """
        if not self._topology.closed or not len(points):
            return np.zeros(len(points), dtype=np.bool_)
        a, b, c = np.moveaxis(self._corners, 1, 0)
        volume = float(np.einsum("ij,ij->", a, np.cross(b, c)))
        return np.asarray(winding(self._corners, points) > (0.5 if volume >= 0.0 else -0.5))

    def _put(self, found: GapQuery, i: int, x: Array, ties: Indices, weights: Array, inside: bool) -> None:
        """Set the result of point i.

        Args:
            found: results of all points.
            i: index of the point.
            x: the point [m], shape (3,).
            ties: indices of the closest triangles, which are equally close, shape (k,).
            weights: barycentric weights of the closest points on these triangles, shape (3, k).
            inside: whether the point is inside a closed surface.
        """
        t, of = ties[0], weights[:, 0]
        a, ab, ac = self._table.rows[:9, t].reshape(3, 3)
        found.triangle[i], found.weights[i], found.point[i] = t, of, a + of[1] * ab + of[2] * ac
        offset, normals = x - found.point[i], self._table.bounds[3:6].take(ties, axis=1)
        distance, heights = float(np.linalg.norm(offset)), offset @ normals
        steepest = heights[np.abs(heights).argmax()]
        sign = (-1.0 if inside else 1.0) if self._topology.closed else -1.0 if steepest < 0.0 else 1.0
        aside = np.sqrt(max(distance**2 - steepest**2, 0.0))
        found.beside[i] = self._on_rim(t, of) and aside > STRAIGHT * distance
        sign = 1.0 if found.beside[i] else sign
        found.gap[i] = sign * distance
        if distance > ON_SURFACE:
            found.normal[i] = offset * (sign / distance)
        else:
            mean = normals.sum(axis=1)
            length = float(np.linalg.norm(mean))
            found.normal[i] = mean / length if length > SLACK else normals[:, 0]

    def _on_rim(self, triangle: int, weights: Array) -> bool:
        """Return whether a point of a triangle lies on the rim of an open surface."""
        zero = weights <= ON_FEATURE
        if zero.sum() == 2:
            vertex = self._topology.corners[triangle, weights.argmax()]
            return bool(self._topology.vertex_kind[vertex] == BOUNDARY)
        return bool(zero.any() and self._topology.edge_kind[triangle, (zero.argmax() + 1) % 3] == BOUNDARY)

    def _measured(self, x: Array, triangle: Indices) -> tuple[Array, Array]:
        """Return squared distances of a point from triangles, and closest points.

        Args:
            x: the point [m], shape (3,).
            triangle: indices of the triangles, shape (k,).

        Returns:
            Squared distances [m^2], shape (k,); barycentric weights of the closest points, shape (3, k).
        """
        rows = self._table.rows.take(triangle, axis=1)
        edges = np.stack([rows[3:6], rows[6:9], rows[6:9] - rows[3:6]])
        v = x[:, None] - rows[0:3]
        starts = np.stack([v, v, v - rows[3:6]])
        share = np.clip((starts * edges).sum(axis=1) / np.maximum(rows[9:12], 1e-300), 0.0, 1.0)
        u, w = np.zeros((2, triangle.size))
        for _ in range(3):  # the offset that is left along the face is the error of u and w
            left = v - u * edges[0] - w * edges[1]
            along = (left * edges[0]).sum(axis=0), (left * edges[1]).sum(axis=0)
            u = u + (rows[10] * along[0] - rows[12] * along[1]) * rows[13]
            w = w + (rows[9] * along[1] - rows[12] * along[0]) * rows[13]
        left = v - u * edges[0] - w * edges[1]
        within = (np.minimum(u, w) > 0.0) & (u + w < 1.0)
        of_edges = starts - share[:, None] * edges
        squares = np.concatenate(
            [(of_edges * of_edges).sum(axis=1), np.where(within, (left * left).sum(axis=0), np.inf)[None]]
        )
        none = np.zeros(triangle.size)
        of_b = np.stack([share[0], none, 1.0 - share[2], u])
        of_c = np.stack([none, share[1], share[2], w])
        best = squares.argmin(axis=0)[None]
        square, b, c = (np.take_along_axis(part, best, axis=0)[0] for part in (squares, of_b, of_c))
        return square, np.stack([np.maximum(1.0 - b - c, 0.0), b, c])

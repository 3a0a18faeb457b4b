"""Normals of the curved surface that a triangle mesh approximates."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..arrays import Array, Indices
from .topology import Topology
from .triangles import TriangleTable

# Cosine of 30 degrees. Faces that meet at a smaller angle approximate a curved surface; at a larger one, they form an
# edge.
SMOOTH = 0.8660254037844387


class SurfaceNormals:
    """Normals of one surface, computed at the first query.

    Args:
        table: the triangles.
        topology: adjacency of the triangles.
        count: number of vertices.
    """

    def __init__(self, table: TriangleTable, topology: Topology, count: int) -> None:
        self._table, self._topology, self._count = table, topology, count

    def smooth(self, triangle: Indices, weights: Array) -> Array:
        """Return unit normals of the curved surface at points, shape (n, 3).

        They are interpolated between normals of the triangle's three corners. A corner's normal is the mean normal of
        the faces around it, weighted by their angles. Faces turned from the triangle by more than 30 degrees do not
        count. On a smooth surface the corners' normals are exact to second order.

        Args:
            triangle: index of the triangle of each point, shape (n,); none may be -1.
            weights: barycentric weights of its corners, shape (n, 3).
        """
        face, corner, start = self._fans
        vertex = self._topology.corners[triangle].reshape(-1)
        count = start[vertex + 1] - start[vertex]
        owner = np.repeat(np.arange(vertex.size), count)
        at = np.arange(owner.size) - np.repeat(np.cumsum(count) - count, count) + np.repeat(start[vertex], count)
        normal = self._table.bounds[3:6]
        own, around = normal[:, triangle[owner // 3]], normal[:, face[at]]
        angle = self._angles[corner[at], face[at]] * (np.einsum("in,in->n", own, around) >= SMOOTH)
        summed: Array = np.stack([np.bincount(owner, angle * n, minlength=vertex.size) for n in around], axis=1)
        corners = summed / np.maximum(np.linalg.norm(summed, axis=1), 1e-300)[:, None]
        out = np.einsum("nk,nki->ni", weights, corners.reshape(-1, 3, 3))
        length = np.linalg.norm(out, axis=1)
        usable = (length > 1e-9)[:, None]
        return np.asarray(np.where(usable, out / np.maximum(length, 1e-300)[:, None], normal[:, triangle].T))

    @cached_property
    def _fans(self) -> tuple[Indices, Indices, Indices]:
        """Faces around each merged vertex, and their corners there.

        The third array has the first place of each vertex in the other two, and finally their length.
        """
        flat = self._topology.corners.reshape(-1)
        order = np.argsort(flat, kind="stable")
        start = np.concatenate([[0], np.cumsum(np.bincount(flat, minlength=self._count))])
        return order // 3, order % 3, start

    @cached_property
    def _angles(self) -> Array:
        """Angle of each triangle at each of its corners [rad], shape (3, T)."""
        g11, g22, _, g12 = self._table.rows[9:13]
        twice_area = np.sqrt(np.maximum(g11 * g22 - g12 * g12, 0.0))
        angle_a = np.arctan2(twice_area, g12)
        angle_b = np.arctan2(twice_area, g11 - g12)
        return np.stack([angle_a, angle_b, np.pi - angle_a - angle_b])

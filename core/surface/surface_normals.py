"""Normals of the curved surface that a triangle mesh stands for."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..arrays import Array, Indices
from .topology import Topology
from .triangles import TriangleTable

# Faces that meet at less than this angle stand for a curved surface; at more, for an edge. Cosine of 30 degrees.
SMOOTH = 0.8660254037844387


class SurfaceNormals:
    """Normals of one surface, computed when first asked for.

    Args:
        table: the triangles. topology: how they hang together. count: number of vertices.
    """

    def __init__(self, table: TriangleTable, topology: Topology, count: int) -> None:
        self._table, self._topology, self._count = table, topology, count

    def smooth(self, triangle: Indices, weights: Array) -> Array:
        """Return the normals of the curved surface that the faces stand for, unit length, shape (n, 3).

        Those of the three corners are interpolated; each corner takes the faces about it, weighted by their angles,
        that turn from the triangle by less than 30 degrees. On a smooth surface they are exact to second order.

        Args:
            triangle: shape (n,), none -1. weights: barycentric, shape (n, 3).
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
        """Faces and their corners about each merged vertex, and where each vertex's begin."""
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

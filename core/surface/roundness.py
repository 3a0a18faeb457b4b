"""Roundness of a triangle surface: the radius of its sharpest convex bend."""

from __future__ import annotations

import numpy as np

from .topology import BOUNDARY, Topology
from .triangles import TriangleTable

# Two faces form an edge if their normals differ by more than this [rad]; below it they approximate a curved surface.
EDGE = 0.5


def roundness(table: TriangleTable, topology: Topology) -> float:
    """Return the smallest radius of a convex bend [m]: 0 with an edge or a rim, inf for a plane.

    Args:
        table: triangles of the surface.
        topology: their neighbours.
    """
    usable = table.usable
    if (usable[:, None] & (topology.edge_kind == BOUNDARY)).any():
        return 0.0
    a, ab, ac = (table.rows[k : k + 3].T for k in (0, 3, 6))
    normals, across = table.bounds[3:6].T, topology.across
    lengths = np.sqrt(np.maximum(table.rows[[9, 11, 10]].T, 1e-300))
    heights = np.sqrt((np.cross(ab, ac) ** 2).sum(axis=1))[:, None] / lengths  # above each edge
    middles = a + (ab + ac) / 3.0
    known = (across >= 0) & usable[:, None] & usable[across]
    triangle, edge = known.nonzero()
    other = across[triangle, edge]
    way = middles[other] - middles[triangle]
    convex = (way * normals[triangle]).sum(axis=1) < 0.0
    triangle, edge, other, way = triangle[convex], edge[convex], other[convex], way[convex]
    if not len(triangle):
        return float("inf")
    cosine = np.clip((normals[triangle] * normals[other]).sum(axis=1), -1.0, 1.0)
    turn = np.arccos(cosine)
    back = (across[other] == triangle[:, None]).argmax(axis=1)
    apart = (heights[triangle, edge] + heights[other, back]) / 3.0  # of the middles, across the edge
    radius = np.where(turn > EDGE, 0.0, apart / np.maximum(turn, 1e-9))
    return float(radius.min())

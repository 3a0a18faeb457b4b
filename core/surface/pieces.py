"""Pieces of a triangle surface.

A piece is a part of the surface that bends gently from triangle to triangle; creases are between pieces.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Indices
from ..components import components
from .topology import Topology
from .triangles import TriangleTable

# [m] Smallest radius of a gentle bend.
# [m] Largest distance between the middles of two neighbours that is used; larger distances count as this one.
RADIUS, LARGE = 5e-3, 1e-3


def pieces(table: TriangleTable, topology: Topology) -> Indices:
    """Return the index of each triangle's piece, shape (T,)."""
    ab, ac = table.rows[3:6].T, table.rows[6:9].T
    lengths = np.sqrt(np.maximum(table.rows[[9, 11, 10]].T, 1e-300))
    heights = np.sqrt((np.cross(ab, ac) ** 2).sum(axis=1))[:, None] / lengths  # above each edge
    back = topology.across[topology.across]  # the neighbours of the neighbour at each edge
    own = (back == np.arange(len(ab))[:, None, None]).argmax(axis=2)
    apart = (heights + heights[topology.across, own]) / 3.0  # distance between the middles, across the edge
    smallest = np.cos(np.minimum(apart, LARGE) / RADIUS)
    normals, across = table.bounds[3:6].T, topology.across
    together = (across >= 0) & (np.einsum("tk,tek->te", normals, normals[across]) > smallest)
    triangle, edge = together.nonzero()
    return components(len(across), triangle, across[triangle, edge])

"""Pieces: parts of a surface within which it bends gently from triangle to triangle; creases lie between them."""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Indices
from .topology import Topology
from .triangles import TriangleTable

# A gentle bend has no radius below this [m]; a fold between large triangles is judged as if they were so small [m].
RADIUS, LARGE = 5e-3, 1e-3


def pieces(table: TriangleTable, topology: Topology) -> Indices:
    """Return which piece of a surface each triangle belongs to, shape (T,)."""
    ab, ac = table.rows[3:6].T, table.rows[6:9].T
    lengths = np.sqrt(np.maximum(table.rows[[9, 11, 10]].T, 1e-300))
    heights = np.sqrt((np.cross(ab, ac) ** 2).sum(axis=1))[:, None] / lengths  # above each edge
    back = topology.across[topology.across]  # of the neighbour across each edge, its own neighbours
    own = (back == np.arange(len(ab))[:, None, None]).argmax(axis=2)
    apart = (heights + heights[topology.across, own]) / 3.0  # of the middles, across the edge
    return joined(table, topology, np.cos(np.minimum(apart, LARGE) / RADIUS))


def joined(table: TriangleTable, topology: Topology, smallest: Array | float) -> Indices:
    """Return which triangles go together, by number, shape (T,).

    Args:
        smallest: cosine of the normals of two that do, of each triangle and edge, shape (T, 3), or of all.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    normals, across = table.bounds[3:6].T, topology.across
    together = (across >= 0) & (np.einsum("tk,tek->te", normals, normals[across]) > smallest)
    triangle, edge = together.nonzero()
    pairs, count = (triangle, across[triangle, edge]), len(across)
    graph = coo_matrix((np.ones(len(triangle), bool), pairs), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])

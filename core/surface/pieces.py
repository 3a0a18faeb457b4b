"""Pieces: parts of a surface within which it bends gently from triangle to triangle; creases lie between them."""

from __future__ import annotations

import numpy as np

from ..arrays import Indices
from .topology import Topology
from .triangles import TriangleTable

# Triangles that meet at a smaller cosine of their normals are divided by a crease.
CREASE = 0.9


def pieces(table: TriangleTable, topology: Topology, smallest: float = CREASE) -> Indices:
    """Return which piece of a surface each triangle belongs to, shape (T,).

    Args:
        smallest: cosine of the normals of two that go together.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    normals, across = table.bounds[3:6].T, topology.across
    together = (across >= 0) & (np.einsum("tk,tek->te", normals, normals[across]) > smallest)
    triangle, edge = together.nonzero()
    pairs = triangle, across[triangle, edge]
    count = len(across)
    joined = coo_matrix((np.ones(len(triangle), bool), pairs), shape=(count, count))
    return np.asarray(connected_components(joined, directed=False)[1])

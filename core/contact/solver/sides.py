"""Correction of gaps of nodes that passed through a surface within one frame.

All points and vectors are in the space of this surface.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Array, Indices
from ...surface.crossing import first_crossing
from ...surface.gap_query import GapQuery
from ...surface.triangles import TriangleTable

# If the cosine between a node's last normal and the present one is below this, the node may have passed to the other
# side of a thin object.
SAME_SIDE = 0.5
# Height above a node's last position on the surface at which its path is tested for a crossing from [m].
ABOVE = 1e-7


def keep_sides(
    answer: GapQuery, table: TriangleTable, side: int, places: Array, nodes: Indices, origins: Array, normals: Array
) -> None:
    """Assign nodes that passed through a surface to the face that they crossed first.

    Args:
        answer: gaps of all nodes; changed in place.
        table: triangles of the surface.
        side: 1 if the surface is touched on the side of its normals, -1 if from behind.
        places: expected positions of all nodes [m], shape (m, 3).
        nodes: indices of the nodes that were above this surface in the last frame, shape (n,).
        origins: positions from which the nodes came [m], shape (m, 3).
        normals: normals of the surfaces above which they were, shape (m, 3).
    """
    # Nodes beyond reach have no normal at present.
    turned = nodes[(dot(normals[nodes], answer.normal[nodes]) < SAME_SIDE) & (answer.triangle[nodes] >= 0)]
    if turned.size == 0:
        return
    start = origins[turned] + ABOVE * normals[turned]
    triangle, share = first_crossing(table, start, places[turned], side)
    through = triangle >= 0
    way = places[turned] - start
    _lay(answer, places, turned[through], table, side, triangle[through], (start + share[:, None] * way)[through])


def _lay(
    answer: GapQuery, places: Array, nodes: Indices, table: TriangleTable, side: int, triangle: Indices, points: Array
) -> None:
    """Set the gaps of nodes to those from points on triangles, in place."""
    normal = side * table.bounds[3:6].take(triangle, axis=1).T
    answer.gap[nodes] = dot(places[nodes] - points, normal)
    answer.normal[nodes], answer.triangle[nodes], answer.point[nodes] = normal, triangle, points
    answer.beside[nodes] = False


def dot(a: Array, b: Array) -> Array:
    """Return the dot product of each pair of rows, shape (n,)."""
    return np.einsum("ij,ij->i", a, b)

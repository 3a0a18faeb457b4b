"""The sides of things that skin lies on are the ones that it came from. All is told in the space of one surface."""

from __future__ import annotations

import numpy as np

from ...arrays import Array, Indices
from ...surface.crossing import first_crossing
from ...surface.gap_query import GapQuery
from ...surface.triangles import TriangleTable

# Normals that turned in a frame by more than this cosine says may belong to the other side of something thin.
SAME_SIDE = 0.5
# Ways through a surface start this far above where a node lay on it [m].
ABOVE = 1e-7


def keep_sides(
    answer: GapQuery, table: TriangleTable, side: int, places: Array, nodes: Indices, origins: Array, normals: Array
) -> None:
    """Give nodes that went through a surface the face that they went through first, in place.

    Args:
        answer: of all nodes. side: 1 where the front is on the side of the normals, -1 where it is behind them.
        places: of all nodes [m], shape (m, 3). nodes: those that were above this surface, shape (n,).
        origins: where nodes came from [m]. normals: of what they were above, shape (m, 3) each.
    """
    # one beyond reach has no normal now
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
    """Put nodes above points of triangles, in place."""
    normal = side * table.bounds[3:6].take(triangle, axis=1).T
    answer.gap[nodes] = dot(places[nodes] - points, normal)
    answer.normal[nodes], answer.triangle[nodes], answer.point[nodes] = normal, triangle, points
    answer.beside[nodes] = False


def dot(a: Array, b: Array) -> Array:
    """Return the products of rows, shape (n,)."""
    return np.einsum("ij,ij->i", a, b)

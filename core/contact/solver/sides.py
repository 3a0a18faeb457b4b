"""The sides of things that skin lies on: the ones that it came from, and the ones that it sees from inside the finger.

All is told in the space of one surface.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from ...surface.crossing import first_crossing
from ...surface.gap_query import GapQuery
from ...surface.triangles import TriangleTable

# Normals that turned in a frame by more than this cosine says may belong to the other side of something thin.
SAME_SIDE = 0.5
# Ways through a surface start this far above where a node lay on it [m].
ABOVE = 1e-7
# Skin hangs on what it does not look at where it is dragged by more than this [m].
HANGS = 0.1e-3
# Skin farther from what it cannot see than this touches nothing there [m].
BESIDE = 1e-3


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


def let_go(
    answer: GapQuery,
    table: TriangleTable,
    side: int,
    places: Array,
    undeformed: Array,
    bone: Array,
    before: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Give nodes that hang on something the face between them and the bone, in place; return which hang.

    Single nodes slide around a ball to where they pull at the finger, and are dragged along a wall far beyond the
    height of it. Skin is held together, and has long come over to what it sees from inside the finger. Once it hangs,
    a node lies there for as long as anything is in its way.

    Args:
        places: where nodes are looked for [m], shape (m, 3). undeformed: nodes [m], shape (m, 3).
        bone: a point inside the finger [m], shape (3,). before: which nodes hung in the last frame, shape (m,).
        For the others see `keep_sides`.
    """
    hung = np.zeros(len(places), dtype=np.bool_)
    inward = bone - places
    facing = dot(answer.normal, inward)
    some = ((before | (facing < 0.0)) & (answer.triangle >= 0)).nonzero()[0]
    if some.size == 0:
        return hung
    gap = answer.gap[some] - dot(places[some] - undeformed[some], answer.normal[some])
    at_once = before[some] | (answer.gap[some] < BESIDE)
    dragged = (at_once | (gap < -HANGS)).nonzero()[0]
    some, gap, at_once = some[dragged], gap[dragged], at_once[dragged]
    if some.size == 0:
        return hung
    start = np.broadcast_to(bone, (some.size, 3))
    triangle, share = first_crossing(table, start, undeformed[some], side)
    entry = start + share[:, None] * (undeformed[some] - start)
    depth = dot(entry - undeformed[some], side * table.bounds[3:6].take(triangle, axis=1).T)
    goes = (triangle >= 0) & (at_once | (depth < -gap))
    _lay(answer, places, some[goes], table, side, triangle[goes], entry[goes])
    hung[some[goes]] = True
    return hung


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

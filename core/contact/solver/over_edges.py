"""Transfer of contact points over edges and over the rims of walls.

Edges: a point that is pressed by one face of an edge remains on this face until the face ends, however far the edge has
moved below it. Real skin is continuous: each part is supported by its neighbours, is hardly deeper than the edge, and
changes to the other face when the edge passes. Without a transfer the skin would be pushed aside, and a finger without
friction would be dragged as if there were friction. A point is therefore transferred half way between the position at
which both faces are equally near and the one at which its own face ends. A neighbour must be on the other face, its own
face must advance more than the other one, and the point must not be deeper below the other face than its cell is wide.
A point that sticks or rests is not transferred.

Rims: skin that sags into a slot or meets a ridge is held by a wall whose normal lies along the skin, however low the
wall is. Linear skin does not turn, so it is never released. Real skin slips over the rim if it is dragged by more than
its depth below the rim. Such a point is transferred to the face behind the rim.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from .bodies import NodeGaps, node_gaps
from .point_gaps import laid_on, some_of
from .sides import dot

# Two faces form an edge if the cosine between their normals is below the first value and above the second. Below the
# second, with 53 degrees between the faces, they are the two sides of a blade.
OTHER, BLADE = 0.9, -0.6
# Position of the transfer without friction, from the end of the point's face (0) to where both faces are equally near
# (1). With friction it is nearer to the end. From this friction coefficient on, points are not transferred.
GOES, HELD = 0.5, 0.25
# A neighbour is on the other face if the cosine between its normal and that of the face is above this.
ALIKE = 0.9
# A face advances more than the other one if the difference exceeds this share of the body's movement.
COMES = 0.2
# Largest depth below the other face, in widths of the cell.
WIDTHS = 1.0


class Freed(NamedTuple):
    """Points that slide beside an edge.

    Attributes:
        nodes: indices of the points, shape (k,).
        beside: indices of the neighbours before and behind each point across the edge, shape (2, k); the point itself
            if there is none.
        places: positions of the points without their own forces [m], shape (k, 3).
        ways: movement of the face below each point since the last frame [m], shape (k, 3).
        widths: width of the cell of each point [m], shape (k,).
        gaps: gaps at `places`; None before they are measured.
    """

    nodes: Indices
    beside: Indices
    places: Array
    ways: Array
    widths: Array
    gaps: NodeGaps | None = None


_NONE: Indices = np.zeros((2, 0), dtype=np.int64)
NOTHING = Freed(_NONE[0], _NONE, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))


def over_edges(gaps: NodeGaps, freed: Freed, loaded: NDArray[np.bool_], points: Array, places: Array) -> NodeGaps:
    """Replace the gaps of points that pass over an edge by those to the face beyond it.

    Args:
        gaps: gaps of all points.
        freed: points that slide beside an edge.
        loaded: whether each point carries force, shape (n,).
        points: positions at rest [m], shape (n, 3).
        places: displaced positions at which the gaps were measured [m], shape (n, 3).
    """
    if freed.gaps is None or not len(freed.nodes):
        return gaps
    mine = ((freed.gaps.body >= 0) & (freed.gaps.body == gaps.body.take(freed.nodes))).nonzero()[0]
    some, free, ways, widths = (v[mine] for v in (freed.nodes, freed.places, freed.ways, freed.widths))
    found, beside, own = some_of(freed.gaps, mine), freed.beside[:, mine], gaps.normal.take(some, axis=0)
    depth = gaps.clearance[some] - dot(places.take(some, axis=0) - free, own)  # negative inside the body
    normal, turned = found.normal, dot(found.normal, own)
    share = GOES * np.maximum(1.0 - gaps.friction.take(some) / HELD, 0.0)
    # The face ends where the distance from the other one is `turned` times the depth.
    goes = found.clearance > np.maximum((turned + share * (1.0 - turned)) * depth, -WIDTHS * widths)
    goes &= (depth < 0.0) & (share > 0.0) & (turned < OTHER) & (turned > BLADE)
    goes &= depth < found.clearance * turned  # excludes concave edges
    goes &= dot(ways, own - normal) > COMES * np.sqrt(dot(ways, ways))
    there = np.zeros(len(some), dtype=np.bool_)
    for next_ in beside:
        there |= loaded[next_] & (gaps.body[next_] == found.body) & (dot(gaps.normal[next_], normal) > ALIKE)
    which = (goes & there).nonzero()[0]
    if not len(which):
        return gaps
    nodes, normal = some[which], normal[which]
    feet = free[which] - found.clearance[which, None] * normal
    return laid_on(gaps, nodes, feet, normal, found.triangle[which], points, places)


# A face is a wall if the cosine between its normal and the direction into the finger is below the first value. A face
# behind a rim has a cosine above the second.
WALL, TOP = 0.45, 0.7
# Skin slips over a rim if its depth below the rim is at most its tangential displacement divided by the first value.
# Smaller depths than the second value are not considered [m].
HOLD, LEAST = 2.0, 0.02e-3
# Distance behind a wall at which the face behind the rim is measured [m].
BEHIND = 0.02e-3


def over_rims(
    gaps: NodeGaps, points: Array, places: Array, inward: Array, search_radius: float, bone: Array
) -> NodeGaps:
    """Replace the gaps of points that slip over the rim of a wall by those to the face behind it.

    Args:
        gaps: gaps of the points.
        points: positions at rest [m], shape (n, 3).
        places: displaced positions at which the gaps were measured [m], shape (n, 3).
        inward: unit vectors into the finger, shape (n, 3).
        search_radius, bone: as for `node_gaps`.
    """
    normal, way = gaps.normal, places - points
    steep = dot(normal, inward)
    drawn = dot(way, normal) - dot(way, inward) * steep  # tangential displacement along the normal of the wall
    hung = ((gaps.clearance < drawn) & (drawn > HOLD * LEAST) & (np.abs(steep) < WALL)).nonzero()[0]
    if not hung.size:
        return gaps
    out = gaps
    for index in np.unique(gaps.body[hung]).tolist():
        own = hung[gaps.body[hung] == index]
        behind = places[own] - (gaps.clearance[own] + BEHIND)[:, None] * normal[own]
        up = inward[own] - steep[own, None] * normal[own]
        above = behind + (drawn[own] / HOLD / np.sqrt(dot(up, up)))[:, None] * up
        found = node_gaps(above, [gaps.bodies[index]], search_radius, bone)
        free = (found.clearance > 0.0) & (dot(found.normal, inward[own]) > TOP)
        own, top = own[free], found.normal[free]
        feet = above[free] - found.clearance[free, None] * top
        out = laid_on(out, own, feet, top, found.triangle[free], points, places)
    return out

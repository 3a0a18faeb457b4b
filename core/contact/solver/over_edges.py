"""Skin that slides over an edge goes over to the face that it would come out of by itself.

A point of skin that is pressed by one face of an edge is held by it until that face ends, however far the edge has
moved on beneath: a single point comes out of a wedge to either side. Points stand for cells, and real skin has no
cells: each bit of it is held up by the next, lies hardly deeper than the edge, and goes over as the edge passes.
Without that skin is ploughed aside, and a finger without friction is dragged along as if there were some.

So a cell goes over half way between where both faces are as near and where its own ends: to a face that skin beside it
lies on, from one that comes on by more, and over a face that is no farther than it is wide. A cell that friction
holds stays, and one that stands still rests.

Skin that hangs on a wall by less than it is dragged slips over the wall's rim. A surface is felt by its faces. Skin
that sags into a slot, or comes against a ridge, is held by a wall that looks along it, however little of the wall there
is; linear skin never turns to let go. Real skin does, where it is drawn aside by more than it lies below the rim: there
it is put onto the face behind the rim.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from .bodies import NodeGaps, node_gaps
from .point_gaps import laid_on, some_of
from .sides import dot

# Faces are others where their normals differ by more than the first cosine says, and by less than the second: beyond
# that, 53 degrees between the faces, they are the two sides of a blade.
OTHER, BLADE = 0.9, -0.6
# A point goes over this share of the way from where its face ends to where the other is as near; the more friction
# holds it, the nearer to the end, and from this coefficient on it stays.
GOES, HELD = 0.5, 0.25
# Skin beside it lies on the other face where normals are alike by this cosine.
ALIKE = 0.9
# A face comes on by more than another where it does by this share of the way that the body goes.
COMES = 0.2
# Deeper below a rim than so many of its widths it is not the cell that catches.
WIDTHS = 1.0


class Freed(NamedTuple):
    """Points that slide beside an edge.

    Attributes:
        nodes: which, shape (k,). beside: the points before and behind each of them, across the edge, itself where there
            is none, shape (2, k).
        places: where each would be, had it no force of its own [m], shape (k, 3).
        ways: movement of the face below each of them since the last frame [m], shape (k, 3).
        widths: width of the cell of each [m], shape (k,).
        gaps: at those places; None until measured.
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
    """Return gaps with those of points that go over an edge taken to the face beyond it.

    Args:
        gaps: gaps of all points.
        freed: the points that slide beside an edge.
        loaded: whether each point carries force, shape (n,).
        points: at rest [m], shape (n, 3). places: where they were looked for [m], shape (n, 3).
    """
    if freed.gaps is None or not len(freed.nodes):
        return gaps
    mine = ((freed.gaps.body >= 0) & (freed.gaps.body == gaps.body.take(freed.nodes))).nonzero()[0]
    some, free, ways, widths = (v[mine] for v in (freed.nodes, freed.places, freed.ways, freed.widths))
    found, beside, own = some_of(freed.gaps, mine), freed.beside[:, mine], gaps.normal.take(some, axis=0)
    depth = gaps.clearance[some] - dot(places.take(some, axis=0) - free, own)  # below zero inside the body that presses
    normal, turned = found.normal, dot(found.normal, own)
    share = GOES * np.maximum(1.0 - gaps.friction.take(some) / HELD, 0.0)
    # a face ends where the other is at `turned` times the depth
    goes = found.clearance > np.maximum((turned + share * (1.0 - turned)) * depth, -WIDTHS * widths)
    goes &= (depth < 0.0) & (share > 0.0) & (turned < OTHER) & (turned > BLADE)
    goes &= depth < found.clearance * turned  # in a hollow faces lie above each other
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


# Faces are walls where their normal and the way to the bone differ by more than this cosine says; faces behind a rim
# differ by less than the second.
WALL, TOP = 0.45, 0.7
# Skin slips over a rim that it lies this many times less deep below than it is drawn aside; not below so little [m].
HOLD, LEAST = 2.0, 0.02e-3
# So far behind a wall its rim is looked for [m].
BEHIND = 0.02e-3


def over_rims(
    gaps: NodeGaps, points: Array, places: Array, inward: Array, search_radius: float, bone: Array
) -> NodeGaps:
    """Return gaps with those of points that slip over a rim taken to the face behind it.

    Args:
        gaps: gaps of the points.
        points: positions at rest [m], shape (n, 3).
        places: displaced positions at which the gaps were measured [m], shape (n, 3).
        inward: directions into the finger, shape (n, 3). search_radius, bone: as for `node_gaps`.
    """
    normal, way = gaps.normal, places - points
    steep = dot(normal, inward)
    drawn = dot(way, normal) - dot(way, inward) * steep  # along the skin: skin that is pressed in is not drawn
    hung = np.flatnonzero((gaps.clearance < drawn) & (drawn > HOLD * LEAST) & (np.abs(steep) < WALL))
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

"""Skin that hangs on a wall by less than it is dragged slips over the wall's rim.

A surface is felt by its faces. Skin that sags into a slot, or comes against a ridge, is held by a wall that looks along
it, however little of the wall there is; linear skin never turns to let go. Real skin does, where it is drawn aside by
more than it lies below the rim: there it is put onto the face behind the rim.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Array
from .bodies import NodeGaps, node_gaps
from .point_gaps import laid_on
from .sides import dot

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

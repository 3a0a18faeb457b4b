"""Skin that slides over an edge goes over to the face that it would come out of by itself.

A point of skin that is pressed by one face of an edge is held by it until that face ends, however far the edge has
moved on beneath: a single point comes out of a wedge to either side. Points stand for cells, and real skin has no
cells: each bit of it is held up by the next, lies hardly deeper than the edge, and goes over as the edge passes. So a
cell goes over half way between where both faces are as near and where its own face ends. Without that skin is ploughed
aside, and a finger without friction is dragged by up to 0.4 of its load. What friction holds stays.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...arrays import Array, Indices
from .bodies import NodeGaps
from .point_gaps import some_of
from .point_map import NONE
from .sides import dot

# Faces are others where their normals differ by more than the first cosine says. Of edges that are sharper than the
# second tells, 75 degrees, the points on either side are drawn far over to the other by each other.
OTHER, SHARP = 0.9, -0.3
# A point goes over this share of the way from where its face ends to where the other is as near; the more friction
# holds it, the nearer to the end, and at this coefficient there.
GOES, HELD = 0.5, 0.5


class Freed(NamedTuple):
    """Points that slide beside an edge, and where each would be, had it no force of its own.

    Attributes:
        nodes: which, shape (k,). places: without their force [m], shape (k, 3). gaps: there; None until measured.
    """

    nodes: Indices
    places: Array
    gaps: NodeGaps | None = None

    def renumbered(self, order: Indices, count: int) -> Freed:
        """Return the same of other points: some of so many old ones in a new order, then new ones."""
        assert self.gaps is not None
        now = np.full(count, NONE)
        now[order] = np.arange(len(order))
        stay = (now[self.nodes] != NONE).nonzero()[0]
        return Freed(now[self.nodes[stay]], self.places[stay], some_of(self.gaps, stay))


NOTHING = Freed(np.zeros(0, dtype=np.int64), np.zeros((0, 3)))


def over_edges(gaps: NodeGaps, freed: Freed, beside: Indices, points: Array, places: Array) -> NodeGaps:
    """Return gaps with those of points that go over an edge taken to what lies beyond it.

    Args:
        gaps: of points. freed: some of them. beside: the points before and behind each of those, across the edge,
            itself where there is none, shape (2, k).
        points: at rest [m], shape (n, 3). places: where they were looked for [m], shape (n, 3).
    """
    some, free, found = freed
    if found is None or not len(some):
        return gaps
    own = gaps.normal.take(some, axis=0)
    depth = gaps.clearance[some] - dot(places.take(some, axis=0) - free, own)  # below zero in what they are pressed by
    turned = dot(found.normal, own)
    # a face ends where the other is at `turned` times the depth
    share = GOES * np.maximum(1.0 - gaps.friction.take(some) / HELD, 0.0)
    goes = found.clearance > (turned + share * (1.0 - turned)) * depth
    goes &= (found.body == gaps.body[some]) & (depth < 0.0) & (turned < OTHER) & (turned > SHARP)
    if not goes.any():
        return gaps
    # two that an edge presses apart, each drawn over to the other's side by it, would change places
    both = np.zeros(len(points), dtype=np.bool_)
    both[some[goes]] = True
    for next_ in beside:
        there = gaps.normal.take(next_, axis=0)
        goes &= ~(both[next_] & (dot(there, found.normal) > dot(there, own)))
    which = goes.nonzero()[0]
    nodes, normal = some[which], found.normal[which]
    foot = free[which] - found.clearance[which, None] * normal
    out = replace(gaps, **{name: getattr(gaps, name).copy() for name in ("gap", "clearance", "normal", "triangle")})
    out.clearance[nodes], out.gap[nodes] = dot(places[nodes] - foot, normal), dot(points[nodes] - foot, normal)
    out.normal[nodes], out.triangle[nodes] = normal, found.triangle[which]
    return out

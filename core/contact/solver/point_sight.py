"""PointSight: what the cells of a pad see of the bodies about a finger, for the tree that cuts them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Indices
from ...surface.gap import Surface
from .bodies import ContactBody, Expected, NodeGaps, node_gaps
from .history import ContactHistory
from .moved_skin import MovedSkin
from .point_map import NONE
from .point_tree import PointTree
from .seen import Seen

# A corner of a cell is reached from this far above it [m].
ABOVE = 0.4e-3
# Normals that differ by more than this cosine says are of the two sides of something thin, or of a needle.
OPPOSITE = -0.7


@dataclass(frozen=True, eq=False)
class PointSight:
    """What is seen in a frame.

    Attributes:
        bodies: what there is to see. skin: that sees it. history: of the skin's points.
        tree: that asks. bone: a point inside the finger [m], shape (3,).
    """

    bodies: tuple[ContactBody, ...]
    skin: MovedSkin
    history: ContactHistory
    tree: PointTree
    bone: Array

    def glance(self, gaps: NodeGaps, cells: Indices) -> tuple[Array, Array, Array, Indices]:
        """Tell of cells what the points under them and beside them see, without measuring: see `seen.Glance`."""
        points = self.skin.points
        five = points.map.around(cells)
        under = five[:, 0].copy()
        under[under == NONE] = points.map.under(cells[under == NONE]).max(axis=1)
        known = (under != NONE) & (gaps.body[under] >= 0)
        none = (five == NONE) | (gaps.body[five] < 0)
        five = np.where(none, under[:, None], five)
        centre = points.pad.cells.positions[cells][:, None]
        places = np.concatenate([centre, self.tree.corner_points(cells).reshape(-1, 4, 3)], axis=1)
        # from where points were undeformed: those that stick have moved along what they see
        way = places + self.skin.raised[under][:, None] - points.positions[five]
        normal = gaps.normal[five]
        gap = gaps.gap[five] + np.einsum("nck,nck->nc", way, normal)
        return gap[:, 0], gap[:, 1:], normal, known + (known & ~none.any(axis=1)).astype(np.int64)

    def look(self, cells: Indices, points: Array, centres: int) -> Seen:
        """Measure points that move with cells, the first so many centres: see `seen.Look`."""
        shift, owner = self.skin.under(cells)
        places = points + shift
        gaps = node_gaps(places, self.bodies, self.tree.search_radius, self.bone)
        self._put_on_their_side(gaps, owner, places)
        flat = np.zeros(centres)
        for index, body in enumerate(self.bodies):
            own = np.flatnonzero(gaps.body[:centres] == index)
            if not isinstance(body.surface, Surface):
                flat[own] = np.inf
            elif len(own) and not body.deforms:
                on = places[own] - gaps.clearance[own, None] * gaps.normal[own]
                flat[own] = body.surface.planes.rim(gaps.triangle[own], (on - body.translation) @ body.rotation)
        return Seen(gaps.clearance, gaps.normal, flat)

    def _put_on_their_side(self, gaps: NodeGaps, owner: Indices, places: Array) -> None:
        """Look again for those that see the other side of something thin: it is not what the skin lies on."""
        own = np.flatnonzero(owner >= 0)
        own = own[self.history.body[owner[own]] == gaps.body[own]]
        if not len(own):
            return
        before = self.history.normals(self.bodies)[owner[own]]
        other = np.flatnonzero(np.einsum("ij,ij->i", before, gaps.normal[own]) < OPPOSITE)
        if not len(other):
            return
        turned, before = own[other], before[other]
        expected = Expected(places[turned], places[turned] + ABOVE * before, before, gaps.body[turned])
        again = node_gaps(places[turned], self.bodies, self.tree.search_radius, self.bone, expected)
        gaps.clearance[turned], gaps.normal[turned] = again.clearance, again.normal
        gaps.triangle[turned] = again.triangle

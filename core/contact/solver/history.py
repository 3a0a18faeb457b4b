"""The anchors of friction: for each node the point of the body's material that it sticks to."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from ...surface.gap import Surface
from ...surface.plane import Plane
from ...surface.topology import cut_otherwise
from .bodies import ContactBody, Expected, NodeGaps, corners_of, from_material, owned, to_material, unplaced

_ARRAYS = ("body", "_material", "_triangle", "_corners", "_local", "_normal", "gap", "sticking", "slip", "swept")

# Bodies are level where the normals of one and the other differ by less than this cosine says.
LEVEL = 0.999


class ContactHistory:
    """Anchors of the nodes, in the material of the bodies, so that they move, turn and stretch with them.

    A sticking node keeps its anchor, so errors of single frames do not add up to creep. A slipping node's anchor
    follows it; an open node's is the material below it, so that a touch between two frames drags from there.

    Attributes:
        body: index of the body that each anchor belongs to, -1 without, shape (m,).
        gap: above it in the last frame [m], shape (m,). sticking: which nodes stuck there, shape (m,).
        slip: slip of each node in the last frame [m], shape (m, 3).
        swept: slip that the nodes would have had if the skin had not moved [m], shape (m, 3).
    """

    def __init__(self, count: int) -> None:
        self.body: Indices = np.full(count, -1)
        self._material = np.zeros((count, 3))
        self._triangle: Indices = np.full(count, -1)
        self._corners: Indices = np.full((count, 3), -1)  # of the triangle, when the anchor was put there
        self._local = np.zeros((count, 3))  # where it was on the body at its first scale, when it was looked at last
        self._faces: dict[int, NDArray[np.integer]] = {}  # triangles of bodies that deform, then
        self._normal = np.zeros((count, 3))  # out of the body, in its axes
        self.gap = np.zeros(count)
        self.sticking = np.zeros(count, dtype=bool)
        self.slip, self.swept = np.zeros((count, 3)), np.zeros((count, 3))
        self._seen: tuple[Sequence[ContactBody], Array] | None = None  # bodies, and where the anchors are on them

    def clear(self) -> None:
        """Forget everything: the next frame starts from rest."""
        self.body[:] = -1
        self.sticking[:] = False
        self._seen = None
        self._faces.clear()

    def copy(self) -> ContactHistory:
        """Return a copy that shares nothing with this one."""
        other = ContactHistory.__new__(ContactHistory)
        for name in _ARRAYS:
            setattr(other, name, getattr(self, name).copy())
        other._faces, other._seen = dict(self._faces), None
        return other

    def rearranged(self, order: Indices, count: int) -> ContactHistory:
        """Return the history of other points: some of these in a new order, then so many without any."""
        other = ContactHistory(len(order) + count)
        for name in _ARRAYS:
            getattr(other, name)[: len(order)] = getattr(self, name)[order]
        other._faces = dict(self._faces)
        return other

    def inherit(
        self, nodes: Indices, source: ContactHistory, sources: Indices, bodies: Sequence[ContactBody], positions: Array
    ) -> None:
        """Give points the history of others in whose place they come, anchored where they are now.

        Args:
            source: history of the former points.
            sources: index of the former point that each new point replaces, shape (n,).
            bodies: the bodies as they were in the last frame.
            positions: positions of the new points in that frame [m], shape (n, 3).
        """
        for name in _ARRAYS:
            getattr(self, name)[nodes] = getattr(source, name)[sources]
        self._put(bodies, nodes, self.body[nodes], self._triangle[nodes], positions)

    def expected(
        self,
        bodies: Sequence[ContactBody],
        deformed: Array,
        search_radius: float,
        ahead: Callable[[Array], Array] | None = None,
    ) -> Expected:
        """Return where nodes are to be looked for in the next frame.

        Args:
            bodies: posed as they are then. deformed: nodes as the last frame left them [m], shape (m, 3).
            search_radius: a body that moved farther than this takes nothing along [m].
            ahead: says how far skin that slips is expected to move [m], shape (3,), for how far the anchors moved.
        """
        anchors, normal = self._anchors(bodies), self.normals(bodies)
        moved = anchors - deformed
        carried = self.sticking & (np.einsum("ij,ij->i", moved, moved) <= search_radius * search_radius)
        places = np.where(carried[:, None], anchors, deformed if ahead is None else deformed + ahead(moved))
        return Expected(places, anchors + self.gap[:, None] * normal, normal, self.body)

    def _anchors(self, bodies: Sequence[ContactBody]) -> Array:
        """Return where the anchors are on bodies [m], shape (m, 3), nan without any: a frame asks for it twice."""
        if self._seen is None or self._seen[0] is not bodies:
            shaped = [(i, own) for i, own in owned(self.body) if bodies[i].deforms or i in self._faces]
            for index, own in shaped:
                self._meet(index, own, bodies[index].surface)
            places = from_material(bodies, self.body, self._material, self._triangle, self._corners)
            for index, own in shaped:
                self._local[own] = unplaced(bodies[index], places[own])
            self._seen = bodies, places
        return self._seen[1]

    def _meet(self, index: int, own: Indices | slice, surface: Surface | Plane) -> None:
        """See a body that deforms; where it has other faces now, its anchors keep their places in its own space.

        How its matter moves from the old faces to the new ones is not known.
        """
        if not isinstance(surface, Surface):
            return
        before, now = self._faces.get(index), surface.triangles
        self._faces[index] = now
        if before is None or before is now or np.array_equal(before, now) or cut_otherwise(before, now):
            return
        nodes = np.arange(len(self.body))[own]
        nodes = nodes[self._corners[nodes, 0] >= 0]
        self._material[nodes], self._triangle[nodes], self._corners[nodes] = self._local[nodes], -1, -1

    def normals(self, bodies: Sequence[ContactBody]) -> Array:
        """Return the normals of the surfaces that points were above, turned with their bodies, shape (m, 3)."""
        normal = np.zeros_like(self._normal)
        for index, own in owned(self.body):
            normal[own] = self._normal[own] @ bodies[index].rotation.T
        return normal

    def offset(self, gaps: NodeGaps, points: Array) -> Array:
        """Return b of the contact problem: the gap along the normal, the slip since the anchor across it.

        Args:
            gaps: present gaps of the nodes.
            points: undeformed nodes [m], shape (m, 3).

        Returns:
            [m], shape (m, 3); the slip is zero where there is no anchor on the closest body, or one level with it.
        """
        normal = gaps.normal
        anchored = (self.body == gaps.body) & (self.body >= 0)
        other = np.flatnonzero((self.body != gaps.body) & (self.body >= 0) & (gaps.body >= 0))
        if other.size:  # over a seam to a level body: friction goes on
            there = np.array([not body.away for body in gaps.bodies])[self.body[other]]
            level = np.einsum("ij,ij->i", self.normals(gaps.bodies)[other], normal[other]) > LEVEL
            anchored[other[there & level]] = True
        if anchored.all():
            moved = points - self._anchors(gaps.bodies)
        else:
            moved = np.where(anchored[:, None], points - self._anchors(gaps.bodies), 0.0)
        gap = np.where(gaps.body >= 0, gaps.gap, 0.0)
        gap = gap - np.einsum("ij,ij->i", moved, normal)
        moved += gap[:, None] * normal
        return moved

    def keep(
        self, gaps: NodeGaps, sticking: NDArray[np.bool_], positions: Array, gap: Array, moved: Sequence[Indices] = ()
    ) -> None:
        """Move the anchors of all nodes that do not stick to where they are now.

        Args:
            positions: positions of the nodes, projected on the bodies' surfaces [m], shape (m, 3).
            gap: gap between node and surface [m], shape (m,).
            moved: nodes whose anchors are moved though they stick, shape (k,) each.
        """
        near = gaps.body >= 0
        renewed = near & ~(sticking & (self.body == gaps.body))
        for some in moved:
            renewed[some] = near[some]
        nodes = np.flatnonzero(renewed)
        if nodes.size:
            body, triangle = gaps.body.take(nodes), gaps.triangle.take(nodes)
            self._put(gaps.bodies, nodes, body, triangle, positions.take(nodes, axis=0))
        self._seen, self.body = None, np.where(near, gaps.body, -1)
        self.sticking = near & sticking
        self.gap = np.maximum(gap, 0.0)
        for index, own in owned(self.body):
            self._normal[own] = gaps.normal[own] @ gaps.bodies[index].rotation

    def _put(
        self, bodies: Sequence[ContactBody], nodes: Indices, body: Indices, triangle: Indices, positions: Array
    ) -> None:
        self._seen = None
        self._material[nodes] = to_material(bodies, body, triangle, positions)
        self._triangle[nodes] = triangle
        self._corners[nodes] = corners_of(bodies, body, triangle)
        for index, own in owned(body):
            posed = bodies[index]
            if posed.deforms and isinstance(posed.surface, Surface):
                self._local[nodes[own]] = unplaced(posed, positions[own])
                self._faces[index] = posed.surface.triangles

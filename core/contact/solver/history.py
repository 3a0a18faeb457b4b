"""ContactHistory: anchors of friction, the points of bodies' material to which nodes stick."""

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

# Two adjacent bodies form one smooth surface if the cosine between their normals is above this.
LEVEL = 0.999


class ContactHistory:
    """Anchors of the nodes in the material of the bodies, with which they move, turn and stretch.

    A sticking node keeps its anchor, so that errors of frames do not add up to creep. The anchor of a slipping node
    follows the node. The anchor of an open node is the material below it. Slip after a contact that begins between two
    frames is then counted from this anchor.

    Args:
        count: number of nodes, m.

    Attributes:
        body: index of the body of each anchor, shape (m,); -1 without an anchor.
        gap: gap of each node above its anchor in the last frame [m], shape (m,).
        sticking: whether each node stuck in the last frame, shape (m,).
        slip: slip of each node in the last frame [m], shape (m, 3).
        swept: slip that each node would have had if the skin had not moved [m], shape (m, 3).
    """

    def __init__(self, count: int) -> None:
        self.body: Indices = np.full(count, -1)
        self._material = np.zeros((count, 3))
        self._triangle: Indices = np.full(count, -1)
        self._corners: Indices = np.full((count, 3), -1)  # vertices of the triangle when the anchor was set
        self._local = np.zeros((count, 3))  # last position on the body at its first scale
        self._faces: dict[int, NDArray[np.integer]] = {}  # triangles of deforming bodies at that time
        self._normal = np.zeros((count, 3))  # out of the body, in its axes
        self.gap = np.zeros(count)
        self.sticking = np.zeros(count, dtype=bool)
        self.slip, self.swept = np.zeros((count, 3)), np.zeros((count, 3))
        self._seen: tuple[Sequence[ContactBody], Array] | None = None  # bodies, and the anchors' positions on them

    def clear(self) -> None:
        """Remove all anchors; the next frame starts from rest."""
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
        """Return the history of other points: points `order` of this one, and `count` points without history."""
        other = ContactHistory(len(order) + count)
        for name in _ARRAYS:
            getattr(other, name)[: len(order)] = getattr(self, name)[order]
        other._faces = dict(self._faces)
        return other

    def inherit(
        self, nodes: Indices, source: ContactHistory, sources: Indices, bodies: Sequence[ContactBody], positions: Array
    ) -> None:
        """Give new points the history of the points that they replace, anchored at their own positions.

        Args:
            nodes: indices of the new points, shape (n,).
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
        """Return the expected positions of the nodes in the next frame.

        Args:
            bodies: bodies in the next frame.
            deformed: positions of the nodes in the last frame [m], shape (m, 3).
            search_radius: sticking nodes do not move with a body that moved farther than this [m].
            ahead: function from the movement of the anchors [m], shape (m, 3), to the expected movement of slipping
                skin [m], shape (3,).
        """
        anchors, normal = self._anchors(bodies), self.normals(bodies)
        moved = anchors - deformed
        carried = self.sticking & (np.einsum("ij,ij->i", moved, moved) <= search_radius * search_radius)
        places = np.where(carried[:, None], anchors, deformed if ahead is None else deformed + ahead(moved))
        return Expected(places, anchors + self.gap[:, None] * normal, normal, self.body)

    def _anchors(self, bodies: Sequence[ContactBody]) -> Array:
        """Return the positions of the anchors on bodies [m], shape (m, 3); nan without an anchor.

        They are kept, because a frame needs them twice.
        """
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
        """Take the present faces of a deforming body.

        If the faces have changed, the movement of the material is not known. The anchors then keep their positions in
        the body's own space.
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
        """Return the normals of the surfaces above which the nodes were, turned with their bodies, shape (m, 3)."""
        normal = np.zeros_like(self._normal)
        for index, own in owned(self.body):
            normal[own] = self._normal[own] @ bodies[index].rotation.T
        return normal

    def offset(self, gaps: NodeGaps, points: Array) -> Array:
        """Return the offset b of the contact problem: the gap along the normal, and the slip across it.

        The slip is counted from the anchor. It is zero if there is no anchor on the closest body, or on one that forms
        a smooth surface with it.

        Args:
            gaps: present gaps of the nodes.
            points: undeformed nodes [m], shape (m, 3).

        Returns:
            b [m], shape (m, 3).
        """
        normal = gaps.normal
        anchored = (self.body == gaps.body) & (self.body >= 0)
        other = ((self.body != gaps.body) & (self.body >= 0) & (gaps.body >= 0)).nonzero()[0]
        if other.size:  # friction continues across the seam to a body that continues the surface
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
        """Move the anchors of all nodes that do not stick to their present positions.

        Args:
            gaps: present gaps of the nodes.
            sticking: whether each node sticks, shape (m,).
            positions: positions of the nodes, projected onto the bodies' surfaces [m], shape (m, 3).
            gap: gap between node and surface [m], shape (m,).
            moved: indices of nodes whose anchors are moved even if they stick, shape (k,) each.
        """
        near = gaps.body >= 0
        renewed = near & ~(sticking & (self.body == gaps.body))
        for some in moved:
            renewed[some] = near[some]
        nodes = renewed.nonzero()[0]
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

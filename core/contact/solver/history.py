"""What friction remembers: for each node the point of the body's material that it sticks to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from .bodies import NodeGaps, from_material, to_material


class ContactHistory:
    """Anchors of the nodes, in the material of the bodies, so that they move, turn and stretch with them.

    A sticking node keeps its anchor, so errors of single frames do not add up to creep. A slipping node's anchor
    follows it; an open node's is the material below it, so that a touch between two frames drags from there.

    Attributes:
        body: index of the body that each anchor belongs to, -1 without, shape (m,).
    """

    def __init__(self, count: int) -> None:
        self.body: Indices = np.full(count, -1)
        self._material = np.zeros((count, 3))
        self._triangle: Indices = np.full(count, -1)

    def clear(self) -> None:
        """Forget everything: the next frame starts from rest."""
        self.body[:] = -1

    def copy(self) -> ContactHistory:
        """Return a copy that shares nothing with this one."""
        other = ContactHistory(len(self.body))
        other.body, other._material, other._triangle = self.body.copy(), self._material.copy(), self._triangle.copy()
        return other

    def offset(self, gaps: NodeGaps, points: Array) -> Array:
        """Return b of the contact problem: the gap along the normal, the slip since the anchor across it.

        Args:
            gaps: of the nodes now.
            points: undeformed nodes [m], shape (m, 3).

        Returns:
            [m], shape (m, 3); the slip is zero where there is no anchor on the closest body.
        """
        normal = gaps.normal
        anchored = (self.body == gaps.body) & (self.body >= 0)
        if anchored.all():
            moved = points - from_material(gaps.bodies, self.body, self._material, self._triangle)
        else:
            moved = np.zeros_like(points)
            at = np.flatnonzero(anchored)
            if at.size:
                anchors = from_material(gaps.bodies, self.body[at], self._material[at], self._triangle[at])
                moved[at] = points[at] - anchors
        gap = np.where(gaps.body >= 0, gaps.gap, 0.0)
        gap = gap - np.einsum("ij,ij->i", moved, normal)
        moved += gap[:, None] * normal
        return moved

    def keep(self, gaps: NodeGaps, sticking: NDArray[np.bool_], positions: Array) -> None:
        """Move the anchors of all nodes that do not stick to where they are now, [m], shape (m, 3)."""
        near = gaps.body >= 0
        renewed = near & ~(sticking & (self.body == gaps.body))
        nodes = np.flatnonzero(renewed)
        if nodes.size:
            self._material[nodes], self._triangle[nodes] = to_material(gaps, nodes, positions[nodes])
        self.body = np.where(near, gaps.body, -1)

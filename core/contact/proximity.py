"""Proximity: how far the bodies are that a finger is near and does not touch, so that they are not asked every sample.

A gap that was measured once bounds the gap at every other pose: no point of a body, seen from the finger, moves
farther than a corner of the body's box does, or, where the body keeps its shape, than a corner of the finger's box
does over it. Until that much was moved, nothing of the body needs to be looked at.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..scene.tactile_scene import Mesh
from .solver.bodies import ContactBody, node_gaps

# Nodes are asked in so many groups at first: far bodies are told by a few points.
GROUPS = 16
# Linear maps that differ by no more than this, relative to their size, keep a body's shape.
SAME_SHAPE = 1e-6


class RelativePoses(NamedTuple):
    """A body seen from a finger over a chunk: linear maps (n, 3, 3) and translations [m] (n, 3)."""

    linear: Array
    place: Array


class _Measured(NamedTuple):
    """A lower bound of the gap [m], and the pose and the surface that it was measured at."""

    gap: float
    linear: Array
    place: Array
    mesh: Mesh
    corners: Array  # of the mesh's box, shape (8, 3)


class Proximity:
    """What is known of the distance of one finger to bodies.

    Args:
        points: the finger's undeformed nodes [m], shape (m, 3).
        bone: a point inside the finger [m], shape (3,).
    """

    def __init__(self, points: Array, bone: Array) -> None:
        self._points, self._bone = points, bone
        self._corners = _corners(points)
        self._centres, self._radii = _groups(points)
        self._known: dict[int, _Measured] = {}
        # over the chunk that these poses are of, how far each body is from where it was measured [m]
        self._moved: dict[int, tuple[RelativePoses, Array]] = {}

    def gap(self, b: int, i: int, poses: RelativePoses, mesh: Mesh) -> float:
        """Return a lower bound of the gap to body `b` at sample `i` [m]; -inf where nothing is known."""
        known = self._known.get(b)
        if known is None or known.mesh is not mesh:
            return -np.inf
        moved = self._moved.get(b)
        if moved is None or moved[0] is not poses:
            moved = self._moved[b] = poses, self._travel(known, poses)
        return known.gap - float(moved[1][i])

    def measure(
        self, b: int, i: int, poses: RelativePoses, mesh: Mesh, body: ContactBody, search_radius: float
    ) -> float:
        """Ask a body itself, and return a lower bound of the gap [m] that is exact below `search_radius`."""
        gap = float((self._ask(self._centres, body, np.inf) - self._radii).min())
        if gap <= search_radius:
            gap = min(float(self._ask(self._points, body, search_radius).min()), search_radius)
        self._known[b] = _Measured(gap, poses.linear[i], poses.place[i], mesh, _corners(mesh.vertices))
        self._moved.pop(b, None)
        return gap

    def _ask(self, points: Array, body: ContactBody, search_radius: float) -> Array:
        return node_gaps(points, [body], search_radius, self._bone).gap

    def _travel(self, known: _Measured, poses: RelativePoses) -> Array:
        """Return how far any point of a body moved from where it was measured, at most [m], shape (n,)."""
        change = poses.linear - known.linear
        moved = known.corners @ np.swapaxes(change, 1, 2) + (poses.place - known.place)[:, None]
        far: Array = np.sqrt((moved * moved).sum(axis=2)).max(axis=1)
        shape = known.linear.T @ known.linear  # the same for all turns of one shape
        shapes = np.swapaxes(poses.linear, 1, 2) @ poses.linear
        kept = np.abs(shapes - shape).max(axis=(1, 2)) <= SAME_SHAPE * np.abs(shape).max()
        inverse, own = np.linalg.inv(known.linear), np.linalg.inv(poses.linear)
        here = (self._corners - poses.place[:, None]) @ np.swapaxes(own, 1, 2)
        over = (here - (self._corners - known.place) @ inverse.T) @ known.linear.T
        across = np.sqrt((over * over).sum(axis=2)).max(axis=1)
        return np.where(kept, np.minimum(far, across), far)


def _corners(points: Array) -> Array:
    low, high = points.min(axis=0), points.max(axis=0)
    return np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(8, 3)


def _groups(points: Array) -> tuple[Array, Array]:
    """Return middles (k, 3) and radii (k,) of groups of points, halved along their longest side."""
    parts = [points]
    while len(parts) < GROUPS:
        halves = []
        for part in parts:
            order = np.argsort(part[:, np.ptp(part, axis=0).argmax()], kind="stable")
            halves += [h for h in np.array_split(part[order], 2) if len(h)]
        if len(halves) == len(parts):
            break
        parts = halves
    centres = np.array([(part.min(axis=0) + part.max(axis=0)) / 2 for part in parts])
    radii = [np.sqrt(((part - c) ** 2).sum(axis=1)).max() for part, c in zip(parts, centres, strict=True)]
    return centres, np.array(radii)

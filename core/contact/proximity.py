"""Proximity: how far the bodies are that a finger is near and does not touch, so that they are not asked every sample.

Most are told by their boxes, in their own axes. Of others, a gap that was measured once bounds the gap at every
other pose: no point of a body, seen from the finger, moves farther than its box does, or, where the body keeps its
shape, than the finger's box does over it. Until that much was moved, nothing of the body needs to be looked at. Gaps
are kept for groups of points: skin comes out where it is pressed, and not elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Indices
from ..motion import singular
from ..scene.tactile_scene import Mesh
from .solver.bodies import ContactBody, node_gaps

# Points are asked in so many groups at first: far bodies are told by a few points.
GROUPS = 32
# Gaps are measured exactly this far out [m]: the larger they are, the longer they are good for.
FAR = 5e-3
# Linear maps that differ by no more than this, relative to their size, keep a body's shape.
SAME_SHAPE = 1e-6


class RelativePoses(NamedTuple):
    """A body seen from a finger over a chunk: linear maps (n, 3, 3) and translations [m] (n, 3)."""

    linear: Array
    place: Array


class _Measured(NamedTuple):
    """Lower bounds of the groups' gaps [m], the pose and the mesh that they were measured at, and the mesh's sphere."""

    gaps: Array
    linear: Array
    place: Array
    inverse: Array  # of the linear map
    mesh: Mesh
    middle: Array
    radius: float


class Proximity:
    """The known distances of one finger to bodies.

    Args:
        points: points of the finger's undeformed skin [m], shape (m, 3).
        bone: a point inside the finger [m], shape (3,).
    """

    def __init__(self, points: Array, bone: Array) -> None:
        self._bone = bone
        groups = _groups(points)
        self._points = [points[group] for group in groups]
        self._order = np.concatenate(groups)
        self._starts = np.cumsum([0, *(group.size for group in groups[:-1])])
        spheres = [_sphere(group) for group in self._points]
        self._centres, self._radii = np.array([s[0] for s in spheres]), np.array([s[1] for s in spheres])
        self._halves = np.array([np.ptp(group, axis=0) for group in self._points]) / 2.0
        self._middle, self._radius = _sphere(points)
        self._known: dict[int, _Measured] = {}
        # over the chunk that these poses are of, how far each body is from where it was measured [m]
        self._chunk: Mapping[int, RelativePoses] = {}
        self._moved: dict[int, Array] = {}
        # over the chunk of those poses, how far the groups are from the bodies' boxes [m]
        self._apart: tuple[Mapping[int, RelativePoses], Array] | None = None

    def grouped(self, values: Array) -> Array:
        """Return the largest of the points' values, shape (m,), in each group, shape (g,)."""
        return np.asarray(np.maximum.reduceat(values.take(self._order), self._starts))

    def within(self, poses: Mapping[int, RelativePoses], boxes: Mapping[int, Array], i: int, reach: Array) -> set[int]:
        """Return the bodies whose boxes are within reach of a group at a sample, [m], shape (g,).

        Args:
            poses: poses of the bodies that are near in the chunk.
            boxes: bounding boxes of the same bodies, see `_boxes_apart`.
        """
        if self._apart is None or self._apart[0] is not poses:
            self._apart = poses, self._boxes_apart([*poses.values()], [boxes[b] for b in poses])
        touched = np.any(self._apart[1][:, i] <= reach, axis=1)
        return {b for b, some in zip(poses, touched.tolist(), strict=True) if some}

    def _boxes_apart(self, poses: Sequence[RelativePoses], boxes: Sequence[Array]) -> Array:
        """Return how far the groups are from the boxes of bodies, at least [m], shape (B, n, g).

        Args:
            boxes: lower and upper corners in the space of each body [m], shape (n, 2, 3) or (1, 2, 3).

        Returns:
            -inf where a body has scale 0.
        """
        linear, place = (np.array([seen[k] for seen in poses]) for k in (0, 1))
        flat = singular(linear.reshape(-1, 3, 3)).reshape(linear.shape[:2])
        inverse = np.linalg.inv(np.where(flat[..., None, None], np.eye(3), linear))
        low, high = (np.array([np.broadcast_to(box[:, k], (len(place[0]), 3)) for box in boxes]) for k in (0, 1))
        middle = ((low + high) / 2.0 - _images(inverse, -place))[:, :, None]
        back = np.swapaxes(inverse, -1, -2)
        off = np.abs(self._centres @ back - middle)
        off -= self._halves @ np.abs(back) + ((high - low) / 2.0)[:, :, None]
        off /= np.sqrt((inverse * inverse).sum(axis=-1))[..., None, :]
        return np.where(flat[..., None], -np.inf, off.max(axis=-1))

    def gaps(self, b: int, i: int, poses: Mapping[int, RelativePoses], mesh: Mesh) -> Array:
        """Return lower bounds of the groups' gaps to body `b` at sample `i` [m], shape (g,).

        Args:
            poses: poses of the bodies that are near in the chunk.
            mesh: mesh of body `b` at the sample.

        Returns:
            -inf where nothing is known.
        """
        if poses is not self._chunk:
            self._chunk = poses
            self._moved = self._travel([b for b in poses if b in self._known])
        known, moved = self._known.get(b), self._moved.get(b)
        if known is None or not _same_faces(known.mesh, mesh):
            return np.full(len(self._radii), -np.inf)
        if moved is None:
            moved = self._moved[b] = self._travel([b])[b]
        far = float(moved[i])
        if mesh is not known.mesh:
            bent = mesh.vertices - known.mesh.vertices
            bent *= bent
            far += float(np.sqrt(bent.sum(axis=1).max()) * np.linalg.norm(poses[b].linear[i]))
        return known.gaps - far

    def measure(self, b: int, i: int, poses: Mapping[int, RelativePoses], mesh: Mesh, body: ContactBody) -> Array:
        """Ask a body itself, and return lower bounds of the groups' gaps [m], exact below `FAR`, shape (g,)."""
        gaps = self._ask(self._centres, body, np.inf) - self._radii
        close = (gaps <= FAR).nonzero()[0]
        if close.size:
            nodes = [self._points[g] for g in close.tolist()]
            exact = np.minimum(self._ask(np.concatenate(nodes), body, FAR), FAR)
            gaps[close] = np.minimum.reduceat(exact, np.cumsum([0, *map(len, nodes[:-1])]))
        linear, place = poses[b].linear[i], poses[b].place[i]
        self._known[b] = _Measured(gaps, linear, place, np.linalg.inv(linear), mesh, *_sphere(mesh.vertices))
        self._moved.pop(b, None)
        return gaps

    def _ask(self, points: Array, body: ContactBody, search_radius: float) -> Array:
        return node_gaps(points, [body], search_radius, self._bone).gap

    def _travel(self, bodies: list[int]) -> dict[int, Array]:
        """Return how far any point of bodies moved over the chunk from where it was measured, at most [m]."""
        if not bodies:
            return {}
        known = [self._known[b] for b in bodies]
        linear, place = (np.array([self._chunk[b][k] for b in bodies]) for k in (0, 1))
        linear0, inverse0 = (np.array([[k[column]] for k in known]) for column in (1, 3))
        place0, middle = (np.array([k[column] for k in known])[:, None] for column in (2, 5))
        radius = np.array([[k.radius] for k in known])
        change = linear - linear0
        moved = _length(_images(change, middle) + place - place0) + _size(change) * radius
        # the finger over a body that keeps its shape, as the body sees it
        turn = linear @ inverse0
        back = np.swapaxes(turn, -1, -2)
        kept = np.abs(back @ turn - np.eye(3)).max(axis=(-2, -1)) <= SAME_SHAPE
        over = _images(back, self._middle - place) - (self._middle - place0)
        across = _length(over) + _size(back - np.eye(3)) * self._radius / np.sqrt(2.0)
        return dict(zip(bodies, np.where(kept, np.minimum(moved, across), moved), strict=True))


def _same_faces(one: Mesh, other: Mesh) -> bool:
    return one is other or (
        one.vertices.shape == other.vertices.shape
        and (one.triangles is other.triangles or np.array_equal(one.triangles, other.triangles))
    )


def _images(linear: Array, points: Array) -> Array:
    return np.asarray((linear @ points[..., None])[..., 0])


def _length(vectors: Array) -> Array:
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=-1)))


def _size(linear: Array) -> Array:
    """Return how long the image of a vector of length 1 is, at most; of turns less a turn, times the root of two."""
    return np.asarray(np.sqrt((linear * linear).sum(axis=(-2, -1))))


def _sphere(points: Array) -> tuple[Array, float]:
    """Return middle (3,) and radius of a sphere about points [m]."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    return middle, float(np.sqrt(((points - middle) ** 2).sum(axis=1).max()))


def _groups(points: Array) -> list[Indices]:
    """Return groups of points, halved along their longest side."""
    groups = [np.arange(len(points))]
    while len(groups) < GROUPS:
        halves = []
        for group in groups:
            order = np.argsort(points[group, np.ptp(points[group], axis=0).argmax()], kind="stable")
            halves += [half for half in np.array_split(group[order], 2) if len(half)]
        if len(halves) == len(groups):
            break
        groups = halves
    return groups

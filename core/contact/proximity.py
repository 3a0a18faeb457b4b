"""Proximity: lower bounds of the gaps between a finger and nearby bodies.

Measuring the gaps of all points of the skin to a body is costly. At most samples a cheap lower bound shows that the
body is out of reach, and the measurement is left out. There are two bounds:

1. The distance to the body's bounding box, in the body's own axes.
2. The last measured gap, less the largest distance that any point of the body has moved since, seen from the finger.
   For a body that keeps its shape, the largest movement of any point of the finger, seen from the body, may be smaller.
   Then this smaller movement is subtracted.

The points of the skin are divided into groups, and each group has bounds of its own. Skin bulges beside a contact and
not elsewhere, so the reach of a group may be larger or smaller than that of others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Indices
from ..motion import singular
from ..scene.tactile_scene import Mesh
from .solver.bodies import ContactBody, least_gaps

# Least number of groups of points. The gap of a group's centre, less the radius of the group, is a lower bound of the
# gaps of its points. This bound is enough for bodies that are far away.
GROUPS = 32
# A gap is measured exactly up to this length [m]. The larger a measured gap, the longer it serves as a bound.
FAR = 5e-3
# A body keeps its shape if the map from its measured pose to another is orthogonal up to this error in each component.
SAME_SHAPE = 1e-6


class RelativePoses(NamedTuple):
    """Poses of a body in a finger's frame at the samples of a chunk.

    Attributes:
        linear: linear maps from the body's space to the finger's, with scale, shape (n, 3, 3).
        place: position of the body's origin [m], shape (n, 3).
    """

    linear: Array
    place: Array


class _Measured(NamedTuple):
    """Lower bounds of a body's gaps, with the pose and mesh measured.

    Attributes:
        gaps: lower bound of each group's gap [m], shape (g,).
        linear, place, inverse: pose of the body, see `RelativePoses`, and the inverse of the linear map.
        mesh: mesh of the body.
        middle, radius: sphere about the mesh, in the body's space [m].
    """

    gaps: Array
    linear: Array
    place: Array
    inverse: Array
    mesh: Mesh
    middle: Array
    radius: float


class Proximity:
    """Lower bounds of the gaps between one finger's skin and bodies.

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
        # Poses of the current chunk. For each body, the largest distance that any of its points has moved from the
        # measured pose, at each sample of the chunk [m].
        self._chunk: Mapping[int, RelativePoses] = {}
        self._moved: dict[int, Array] = {}
        # Poses of a chunk, and the distances of the groups from the bodies' boxes at its samples [m].
        self._apart: tuple[Mapping[int, RelativePoses], Array] | None = None

    def grouped(self, values: Array) -> Array:
        """Return the largest value of each group of points, shape (g,).

        The values of the points have the shape (m,).
        """
        return np.asarray(np.maximum.reduceat(values.take(self._order), self._starts))

    def within(self, poses: Mapping[int, RelativePoses], boxes: Mapping[int, Array], i: int, reach: Array) -> set[int]:
        """Return the bodies whose bounding boxes are within reach at a sample.

        A body is within reach if it is within that of any group.

        Args:
            poses: poses of the nearby bodies at the samples of the chunk, by the bodies' indices.
            boxes: bounding boxes of the same bodies, see `_boxes_apart`.
            i: index of the sample in the chunk.
            reach: reach of each group [m], shape (g,).
        """
        if self._apart is None or self._apart[0] is not poses:
            self._apart = poses, self._boxes_apart([*poses.values()], [boxes[b] for b in poses])
        touched = np.any(self._apart[1][:, i] <= reach, axis=1)
        return {b for b, some in zip(poses, touched.tolist(), strict=True) if some}

    def _boxes_apart(self, poses: Sequence[RelativePoses], boxes: Sequence[Array]) -> Array:
        """Return lower bounds of the distances between groups and boxes.

        The bounds [m] have the shape (B, n, g), for bodies, samples and groups. A group is replaced by its
        bounding box in the finger's axes. Along each face normal of the body's box, the distance between the
        two boxes is a lower bound; the largest of these is returned. It is negative where the boxes overlap
        along all of these normals, and -inf for a body of scale 0.

        Args:
            poses: poses of the bodies.
            boxes: lower and upper corners in the space of each body [m], shape (n, 2, 3) or (1, 2, 3).
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
        """Return lower bounds of the groups' gaps to body `b` at sample `i`.

        The bounds [m] have the shape (g,). They are -inf if the body was not measured yet, or if its mesh had other
        faces then.

        Args:
            b: index of the body.
            i: index of the sample in the chunk.
            poses: poses of the nearby bodies at the samples of the chunk, by the bodies' indices.
            mesh: mesh of body `b` at the sample.
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
        """Measure the groups' gaps to body `b` and return lower bounds.

        The bounds [m] have the shape (g,), are exact below `FAR`, and are kept for `gaps`.

        Args:
            b: index of the body.
            i: index of the sample in the chunk.
            poses: poses of the nearby bodies at the samples of the chunk, by the bodies' indices.
            mesh: mesh of body `b` at the sample.
            body: the same body, posed in the finger's frame.
        """
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
        return least_gaps(points, [body], search_radius, self._bone)

    def _travel(self, bodies: list[int]) -> dict[int, Array]:
        """Return upper bounds of each body's movement since its measurement.

        The bounds [m] have the shape (n,) for each body. The movement is the largest of any point of the body,
        seen from the finger, at each sample of the chunk.
        """
        if not bodies:
            return {}
        known = [self._known[b] for b in bodies]
        linear, place = (np.array([self._chunk[b][k] for b in bodies]) for k in (0, 1))
        linear0, inverse0 = (np.array([[k[column]] for k in known]) for column in (1, 3))
        place0, middle = (np.array([k[column] for k in known])[:, None] for column in (2, 5))
        radius = np.array([[k.radius] for k in known])
        change = linear - linear0
        moved = _length(_images(change, middle) + place - place0) + _size(change) * radius
        # For a body that keeps its shape: the largest movement of any point of the finger, seen from the body.
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
    """Return the Frobenius norm of linear maps.

    It is an upper bound of their spectral norm. For the difference between two rotations, it is the spectral norm
    times the square root of two.
    """
    return np.asarray(np.sqrt((linear * linear).sum(axis=(-2, -1))))


def _sphere(points: Array) -> tuple[Array, float]:
    """Return a sphere that encloses points.

    The results are its centre, shape (3,), and its radius [m].
    """
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    return middle, float(np.sqrt(((points - middle) ** 2).sum(axis=1).max()))


def _groups(points: Array) -> list[Indices]:
    """Divide points into `GROUPS` groups or more.

    Each group is halved along the longest side of its bounding box.

    Returns:
        Indices of each group's points; fewer groups if there are fewer points.
    """
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

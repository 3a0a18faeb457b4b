"""The bodies about a finger at one instant, and the gaps of the finger's nodes to the closest of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from ...errors import DermisError
from ...parameters.material import FRICTION
from ...surface.gap import Surface
from ...surface.plane import Plane
from .cone import along
from .sides import dot, keep_sides

# A node changes to a body that is nearer than its last one by more than this [m], not by rounding where both are level.
TIE = 1e-6
# A point inside a finger [m]: on the side where it lies, the finger is outside an open surface.
BONE = np.array([0.0, 0.0, 0.006])

# Clearance, normal, body, triangle, friction and softness of each node, as in `NodeGaps`.
_PerNode = tuple[Array, Array, Indices, Indices, Array, Array]


@dataclass(frozen=True, eq=False)
class ContactBody:
    """A body that a finger may touch, posed in the finger's frame.

    Attributes:
        surface: in the body's own space, or, where it deforms, in any space with the same faces every frame.
        rotation: from the body's space to the finger's, orthonormal, shape (3, 3).
        translation: of the body's origin in the finger's frame [m], shape (3,).
        friction: Coulomb coefficient against skin.
        softness: compliance of its own surface [m/Pa]: it yields by this times the pressure. 0 is rigid.
        deforms: its surface is another every frame; what sticks to it is then carried by triangles.
        carry: where its scale changed: the linear map from its first stretch to this one, which what sticks to it
            follows, shape (3, 3). None where it kept its scale.
        away: it is nowhere near, and only keeps its place in the order.

    Raises:
        DermisError: a pose that is not finite.
    """

    surface: Surface | Plane
    rotation: Array = field(default_factory=lambda: np.eye(3))
    translation: Array = field(default_factory=lambda: np.zeros(3))
    friction: float = FRICTION
    softness: float = 0.0
    deforms: bool = False
    away: bool = False
    carry: Array | None = None

    def __post_init__(self) -> None:
        if not isfinite(np.vdot(self.rotation, self.rotation) + np.vdot(self.translation, self.translation)):
            raise DermisError("the pose of a body is not finite", value=self.translation)

    def local(self, *points: Array) -> tuple[Array, ...]:
        """Return points of the finger's frame [m], shape (..., 3) each, in the surface's space."""
        return tuple((p - self.translation) @ self.rotation for p in points)

    def same_place(self, other: ContactBody) -> bool:
        """Whether another state of this body has the same surface, pose and properties, or is as far away."""
        if self.away and other.away:
            return True
        return (
            self.surface is other.surface
            and self.friction == other.friction
            and self.softness == other.softness
            and bool(np.array_equal(self.rotation, other.rotation))
            and bool(np.array_equal(self.translation, other.translation))
        )


@dataclass(frozen=True, eq=False)
class NodeGaps:
    """The gaps of a finger's nodes at one instant, in the finger's frame.

    Attributes:
        bodies: what there is to touch.
        gap: of the undeformed nodes, linear about where the deformed ones are expected [m], inf beyond reach,
            shape (m,).
        clearance: of the nodes where they are expected [m], inf beyond reach, shape (m,).
        normal: out of the body, into the finger, shape (m, 3).
        body: index of the closest body, -1 beyond reach, shape (m,).
        triangle: the closest triangle of that body, shape (m,).
        friction: coefficient at each node, shape (m,).
        softness: of the body closest to each node [m/Pa], shape (m,).
    """

    bodies: tuple[ContactBody, ...]
    gap: Array
    clearance: Array
    normal: Array
    body: Indices
    triangle: Indices
    friction: Array
    softness: Array

    @classmethod
    def nothing(cls, bodies: tuple[ContactBody, ...], count: int) -> NodeGaps:
        """Return the gaps of so many nodes that nothing is near."""
        far, none, zero = np.full(count, np.inf), np.full(count, -1), np.zeros(count)
        return cls(bodies, far, far.copy(), np.zeros((count, 3)), none, none.copy(), zero, zero.copy())

    def compliance(self, areas: Array | None, where: str) -> Array:
        """Return the compliance of the bodies' own surfaces at the nodes [m/N], shape (m,).

        Args:
            areas: skin of each node [m^2], shape (m,). where: for errors.

        Raises:
            DermisError: a body is soft, and the areas are not known.
        """
        if not self.softness.any():
            return np.zeros(self.gap.shape[0])
        if areas is None:
            raise DermisError("a soft object needs the areas of the skin's nodes", where=where)
        return self.softness / areas


@dataclass(frozen=True, eq=False)
class Expected:
    """Where a finger's nodes are looked for in a frame: as the last one left them, moved with what they stick to.

    Attributes:
        places: of the nodes [m], shape (m, 3).
        origins: where they would be had all of them moved with their bodies: none of these is behind a surface [m],
            NaN without a body, shape (m, 3).
        normal: of the surface that they were above, turned with its body, shape (m, 3).
        body: that body's index, -1 without, shape (m,).
    """

    places: Array
    origins: Array
    normal: Array
    body: Indices


def paired(one: Sequence[ContactBody], other: Sequence[ContactBody]) -> Iterator[tuple[ContactBody, ContactBody]]:
    """Yield each body at two instants; one that was not there yet was away: when it is first seen changes nothing."""
    return zip_longest(one, other, fillvalue=AWAY)


def same_places(one: Sequence[ContactBody], other: Sequence[ContactBody]) -> bool:
    """Return whether all bodies are where they were, with the same properties."""
    return all(a.same_place(b) for a, b in paired(one, other))


def travel(a: ContactBody, b: ContactBody, points: Array) -> float:
    """Return how far a body's matter at points [m], shape (n, 3), moves from one pose to another [m]."""
    if a.away or b.away:
        return 0.0
    way = moved(a, b, points)
    return float(np.sqrt((way * way).sum(axis=1)).max())


def moved(a: ContactBody, b: ContactBody, points: Array) -> Array:
    """Return how a body's matter at points [m], shape (n, 3), moves from one pose to another [m], shape (n, 3)."""
    return np.asarray(((points - a.translation) @ a.rotation) @ b.rotation.T + b.translation - points)


def node_gaps(
    points: Array, bodies: Sequence[ContactBody], search_radius: float, bone: Array, expected: Expected | None = None
) -> NodeGaps:
    """Measure each node against every body and keep the closest.

    Asked about is the deformed skin, which lies on what it touches and not behind it: so a sheet thinner than the
    finger is pressed is felt as a block is, and the gap is exact to first order where the skin really is. A node
    whose way from the last frame leads through a surface stays on the side that it came from.

    Args:
        points: undeformed nodes in the finger's frame [m], shape (m, 3).
        search_radius: gaps beyond this are of no interest [m].
        bone: a point inside the finger [m], shape (3,): an open surface is touched on the side where it lies.
        expected: where the deformed nodes are; the undeformed ones where None.
    """
    places, m = points if expected is None else expected.places, len(points)
    found: _PerNode | None = None
    for index, body in enumerate(bodies):
        if body.away:
            continue
        local = (places - body.translation) @ body.rotation
        if isinstance(body.surface, Surface) and not boxes_meet(local, body.surface.box, search_radius):
            continue
        answer, side = body.surface.query(local, search_radius), 1
        if isinstance(body.surface, Surface):
            if not body.surface.closed and body.surface.side_of(*body.local(bone)) < 0:
                answer, side = answer.flipped(), -1
            if expected is not None:
                own = (expected.body == index).nonzero()[0]
                origins, before = body.local(expected.origins)[0], expected.normal @ body.rotation
                keep_sides(answer, body.surface.table, side, local, own, origins, before)
        near = answer.triangle >= 0
        owner: Indices = np.where(near, index, -1)
        friction, softness = (np.where(near, value, 0.0) for value in (body.friction, body.softness))
        told = answer.gap, answer.normal @ body.rotation.T, owner, answer.triangle, friction, softness
        if found is None:
            found = told
            continue
        lead = 0.0
        if expected is not None:
            lead = TIE * np.subtract(expected.body == index, expected.body == found[2], dtype=np.float64)
        closer = (near & (answer.gap < found[0] + lead)).nonzero()[0]
        for ours, others in zip(found, told, strict=True):
            ours[closer] = others[closer]
    if found is None:
        return NodeGaps.nothing(tuple(bodies), m)
    clearance, normal = found[:2]  # beyond reach the normal is zero
    gap = clearance.copy() if expected is None else clearance - dot(places - points, normal)
    return NodeGaps(tuple(bodies), gap, *found)


def to_material(bodies: Sequence[ContactBody], owner: Indices, triangle: Indices, positions: Array) -> Array:
    """Return the material coordinates of positions [m], shape (n, 3), on the bodies and triangles they are near.

    On a rigid body they are `unplaced`; on one that deforms, two affine weights in the plane of a triangle and the
    height above it, and `unplaced` without a triangle, -1.
    """
    out = np.empty_like(positions)
    for index, which in owned(owner):
        body = bodies[index]
        local = unplaced(body, positions[which])
        if body.deforms and isinstance(body.surface, Surface):
            known = triangle[which] >= 0
            a, ab, ac, normal = _plane_of(body.surface, triangle[which][known])
            v = body.local(positions[which][known])[0] - a
            g11, g12, g22 = along(ab, ab), along(ab, ac), along(ac, ac)
            d1, d2 = along(v, ab), along(v, ac)
            det = g11 * g22 - g12 * g12
            weights = (g22 * d1 - g12 * d2) / det, (g11 * d2 - g12 * d1) / det, along(v, normal)
            local[known] = np.stack(weights, axis=1)
        out[which] = local
    return out


def unplaced(body: ContactBody, positions: Array) -> Array:
    """Return the local coordinates of positions [m], shape (n, 3); where a body's scale changed, at its first one."""
    local = body.local(positions)[0]
    return local if body.carry is None else local @ np.linalg.inv(body.carry).T


def from_material(
    bodies: Sequence[ContactBody], owner: NDArray[np.integer], material: Array, triangle: Indices, corners: Indices
) -> Array:
    """Return where material points are now, in the finger's frame [m], shape (n, 3); the inverse of `to_material`.

    Args:
        triangle: that `to_material` was asked with. corners: see `corners_of`; faces may be cut otherwise now, but
            not be others.
    """
    out = np.full_like(material, np.nan)
    for index, which in owned(owner):
        body = bodies[index]
        local = material[which] if body.carry is None else material[which] @ body.carry.T
        on = corners[which, 0] >= 0
        if on.any() and isinstance(body.surface, Surface):
            a, ab, ac, normal = _plane_through(body.surface, triangle[which][on], corners[which][on])
            u, w, height = material[which][on].T[:, :, None]
            local = local.copy()
            local[on] = a + u * ab + w * ac + height * normal
        out[which] = local @ body.rotation.T + body.translation
    return out


def corners_of(bodies: Sequence[ContactBody], owner: NDArray[np.integer], triangle: Indices) -> Indices:
    """Return the vertices of triangles of bodies that deform, shape (n, 3); -1 for those of others, and for none."""
    out = np.full((len(triangle), 3), -1)
    for index, which in owned(owner):
        body = bodies[index]
        if body.deforms and isinstance(body.surface, Surface):
            own = triangle[which]
            out[which] = np.where(own[:, None] >= 0, body.surface.triangles[own], -1)
    return out


def owned(owner: NDArray[np.integer]) -> Iterator[tuple[int, Indices | slice]]:
    """Yield the index of each body that owns any, with which those are; a slice, which copies nothing, where all."""
    if owner.size == 0:
        return
    first = int(owner[0])
    if (owner == first).all():
        if first >= 0:
            yield first, slice(None)
        return
    for index in set(owner.tolist()) - {-1}:
        yield index, (owner == index).nonzero()[0]


def _plane_of(surface: Surface, triangle: Indices) -> tuple[Array, Array, Array, Array]:
    rows = surface.table.rows[:9].take(triangle, axis=1).T
    return rows[:, 0:3], rows[:, 3:6], rows[:, 6:9], surface.table.bounds[3:6].take(triangle, axis=1).T


def _plane_through(surface: Surface, triangle: Indices, corners: Indices) -> tuple[Array, Array, Array, Array]:
    """Return the planes of triangles, or through their corners where these belong to other triangles now."""
    planes = _plane_of(surface, triangle)
    others = np.flatnonzero((surface.triangles[triangle] != corners).any(axis=1))
    if others.size:
        a, b, c = surface.vertices[corners[others].T]
        normal = np.cross(b - a, c - a)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        for plane, value in zip(planes, (a, b - a, c - a, normal), strict=True):
            plane[others] = value
    return planes


def boxes_meet(points: Array, box: Array, search_radius: float) -> bool:
    """Whether points come within a radius of a box [m], shapes (n, 3) and (2, 3)."""
    if not len(points):
        return False
    return bool(
        (points.max(axis=0) + search_radius >= box[0]).all() and (points.min(axis=0) - search_radius <= box[1]).all()
    )


AWAY = ContactBody(Plane(np.array([0.0, 0.0, 1.0]), np.zeros(3)), friction=0.0, away=True)

"""Bodies near a finger at one instant, and the gaps of the finger's nodes to them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import zip_longest
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from ...errors import DermisError
from ...kernels import records
from ...parameters.material import FRICTION
from ...surface.gap import Surface
from ...surface.plane import Plane
from .cone import along

# A node changes to another body only if that is nearer by more than this [m]. Between two bodies at the same height,
# rounding then does not decide. It is a step of single precision 8 m from the origin.
TIE = 1e-6
# Faces coincide if they are within TIE and their normals turn by less than this [rad]: over 0.1 mm, the finest cell of
# skin, a larger turn takes them farther apart.
TURN = 0.01
# A point inside a finger [m]. An open surface is touched on the side of this point.
BONE = np.array([0.0, 0.0, 0.006])

_UNSTRETCHED = np.concatenate([np.eye(3).reshape(-1), np.eye(3).reshape(-1)])


@dataclass(frozen=True, eq=False)
class ContactBody:
    """Body that a finger may touch, posed in the finger's frame.

    Attributes:
        surface: surface in the body's own space; for a deforming body, in any space with the same faces in each frame.
        rotation: rotation from the body's space to the finger's, shape (3, 3).
        translation: position of the body's origin in the finger's frame [m], shape (3,).
        friction: Coulomb coefficient against skin.
        softness: compliance of the body's surface: displacement per pressure [m/Pa]; 0 for a rigid body.
        deforms: whether the surface changes from frame to frame. Anchors of friction are then fixed to its triangles.
        carry: linear map from the body's first scale and shear to the present ones, which anchors follow, shape (3, 3);
            None if they have not changed.
        away: whether the body is out of reach. It then only keeps its index.

    Raises:
        DermisError: the pose is not finite.
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

    @cached_property
    def pose(self) -> Array:
        """The pose as kernels take it, see `dermis_friction`, shape (32,); the last number is 0."""
        row = np.zeros(records.POSE)
        row[:9], row[9:12], row[12:30], row[30] = self.rotation.reshape(-1), self.translation, _UNSTRETCHED, self.away
        if self.carry is not None:
            row[12:21], row[21:30] = self.carry.reshape(-1), np.linalg.inv(self.carry).reshape(-1)
        return row

    def side_of(self, bone: Array) -> float:
        """Return the factor on gaps and normals: -1 if the surface is open and `bone` is behind its faces, else 1.

        Args:
            bone: a point inside the finger [m], shape (3,). The result for the last one is kept.
        """
        if not isinstance(self.surface, Surface) or self.surface.closed:
            return 1.0
        known = self.__dict__.get("_side")
        if known is None or known[0] is not bone:
            known = bone, -1.0 if self.surface.side_of(*self.local(bone)) < 0 else 1.0
            self.__dict__["_side"] = known
        return float(known[1])

    def local(self, *points: Array) -> tuple[Array, ...]:
        """Transform points [m], shape (..., 3) each, from the finger's frame to the surface's space."""
        return tuple((p - self.translation) @ self.rotation for p in points)

    def placed(self, points: Array) -> Array:
        """Transform points [m], shape (..., 3), from the surface's space to the finger's frame."""
        return np.asarray(points @ self.rotation.T + self.translation)

    def same_place(self, other: ContactBody) -> bool:
        """Return whether another state of this body has the same surface, pose and properties, or both are away."""
        if self is other or (self.away and other.away):
            return True
        return (
            self.surface is other.surface
            and self.friction == other.friction
            and self.softness == other.softness
            and bool((self.translation == other.translation).all())
            and bool((self.rotation == other.rotation).all())
        )


@dataclass(frozen=True, eq=False)
class NodeGaps:
    """Gaps of a finger's nodes at one instant, in the finger's frame.

    Attributes:
        bodies: bodies that may be touched.
        gap: gap of the undeformed nodes, linearised about the expected positions of the deformed ones [m], shape (m,);
            inf beyond reach.
        clearance: gap of the nodes at their expected positions [m], shape (m,); inf beyond reach.
        normal: unit normal out of the body, shape (m, 3).
        body: index of the closest body, shape (m,); -1 beyond reach.
        triangle: closest triangle of that body, shape (m,).
        friction: friction coefficient at each node, shape (m,).
        softness: softness of the closest body [m/Pa], shape (m,).
        where: displacement of the points at which a gap that follows them was measured [m], shape (m, 3); else None.
    """

    bodies: tuple[ContactBody, ...]
    gap: Array
    clearance: Array
    normal: Array
    body: Indices
    triangle: Indices
    friction: Array
    softness: Array
    where: Array | None = None

    @classmethod
    def nothing(cls, bodies: tuple[ContactBody, ...], count: int) -> NodeGaps:
        """Return the gaps of `count` nodes that are beyond reach of all bodies."""
        far, none, zero = np.full(count, np.inf), np.full(count, -1, dtype=np.int64), np.zeros(count)
        return cls(bodies, far, far.copy(), np.zeros((count, 3)), none, none.copy(), zero, zero.copy())

    def compliance(self, areas: Array) -> Array:
        """Return the compliance of the bodies' own surfaces at the nodes [m/N], shape (m,).

        Args:
            areas: area of skin of each node [m^2], shape (m,).
        """
        return self.softness / areas if self.softness.any() else np.zeros(len(self.softness))


def paired(one: Sequence[ContactBody], other: Sequence[ContactBody]) -> Iterator[tuple[ContactBody, ContactBody]]:
    """Yield each body at two instants; a body that is in one list alone counts as away in the other."""
    return zip_longest(one, other, fillvalue=AWAY)


def by_precedence(bodies: Sequence[ContactBody]) -> list[int]:
    """Return the indices of bodies in the order in which they prevail where their faces coincide.

    Their own order does not matter: it is the body with most friction that prevails, since it holds skin that slips on
    all others; of bodies with the same friction the stiffest, and of these the one whose surface begins lower.
    """
    if len(bodies) < 2:
        return [*range(len(bodies))]

    def key(index: int) -> tuple[float, float, list[float]]:
        body = bodies[index]
        box = body.surface.box.ravel().tolist() if isinstance(body.surface, Surface) else []
        return -body.friction, body.softness, box

    return sorted(range(len(bodies)), key=key)


def same_places(one: Sequence[ContactBody], other: Sequence[ContactBody]) -> bool:
    """Return whether all bodies have the same surfaces, poses and properties at two instants."""
    return all(a.same_place(b) for a, b in paired(one, other))


def travel(a: ContactBody, b: ContactBody, points: Array) -> float:
    """Return the largest movement from one pose to another of a body's material at points [m], shape (n, 3)."""
    if a.away or b.away:
        return 0.0
    way = moved(a, b, points)
    return float(np.sqrt((way * way).sum(axis=1)).max())


def moved(a: ContactBody, b: ContactBody, points: Array) -> Array:
    """Return the movement of a body's material at points from one pose to another [m], shape (n, 3)."""
    return b.placed(*a.local(points)) - points


def least_gaps(points: Array, bodies: Sequence[ContactBody], reach: float, bone: Array) -> Array:
    """Return the gap of each point of undeformed skin to its closest body [m], shape (m,); inf beyond reach.

    Args:
        points: in the finger's frame [m], shape (m, 3).
        bodies: bodies in the same frame.
        reach: larger gaps are not measured [m].
        bone: a point inside the finger [m], shape (3,); an open surface is touched on the side of this point.
    """
    least = np.full(len(points), np.inf)
    for body in bodies:
        if body.away:
            continue
        surface, (local,) = body.surface, body.local(points)
        if isinstance(surface, Surface) and not (surface.table.usable.any() and boxes_meet(local, surface.box, reach)):
            continue  # far away no tree is built, and no side is determined
        found = surface.query(local, reach)
        if body.side_of(bone) < 0.0:
            found = found.flipped()
        np.minimum(least, found.gap, out=least)
    return least


def to_material(bodies: Sequence[ContactBody], owner: Indices, triangle: Indices, positions: Array) -> Array:
    """Return the material coordinates of positions on bodies, shape (n, 3).

    On a rigid body, and without a triangle, they are those of `unplaced`. On a triangle of a deforming body they are
    two affine weights in its plane and the height above it [m].

    Args:
        bodies: the bodies.
        owner: index of the body of each position, shape (n,).
        triangle: index of the triangle of each position, shape (n,); -1 for none.
        positions: positions in the finger's frame [m], shape (n, 3).
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
    """Return positions in a body's own space at its first scale and shear [m], shape (n, 3)."""
    local = body.local(positions)[0]
    return local if body.carry is None else local @ np.linalg.inv(body.carry).T


def from_material(
    bodies: Sequence[ContactBody], owner: NDArray[np.integer], material: Array, triangle: Indices, corners: Indices
) -> Array:
    """Return the present positions of material points in the finger's frame [m], shape (n, 3).

    This is the inverse of `to_material`.

    Args:
        bodies: the bodies at present.
        owner: index of the body of each point, shape (n,).
        material: material coordinates, shape (n, 3).
        triangle: triangles that were given to `to_material`, shape (n,).
        corners: vertices of those triangles at that time, see `corners_of`, shape (n, 3). The surface must have the
            same faces, but these may be divided into other triangles.
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
        out[which] = body.placed(local)
    return out


def corners_of(bodies: Sequence[ContactBody], owner: NDArray[np.integer], triangle: Indices) -> Indices:
    """Return the vertices of triangles of deforming bodies, shape (n, 3); -1 for other bodies or no triangle."""
    out = np.full((len(triangle), 3), -1)
    for index, which in owned(owner):
        body = bodies[index]
        if body.deforms and isinstance(body.surface, Surface):
            own = triangle[which]
            out[which] = np.where(own[:, None] >= 0, body.surface.triangles[own], -1)
    return out


def owned(owner: NDArray[np.integer]) -> Iterator[tuple[int, Indices | slice]]:
    """Yield the index of each body that occurs in `owner`, with the indices at which it occurs.

    If it owns all, they are a slice, which avoids copies.
    """
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
    """Return corner, two edges and normal of triangles' planes, computed from `corners` if a triangle has changed."""
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
    """Return whether the bounding box of points, shape (n, 3), is within a radius of a box, shape (2, 3) [m]."""
    if not len(points):
        return False
    low, high = box.tolist()
    columns = points.T.copy()  # along rows of three, NumPy's `max` takes eight times as long
    least, most = (end.reduce(columns, axis=1).tolist() for end in (np.minimum, np.maximum))
    return all(most[k] + search_radius >= low[k] and least[k] - search_radius <= high[k] for k in range(3))


AWAY = ContactBody(Plane(np.array([0.0, 0.0, 1.0]), np.zeros(3)), friction=0.0, away=True)

"""The shapes of the references: exact gaps to press on, and triangles for the product to press on. Lengths in mm.

Every shape's highest point is the origin and +Z leads out of it; edges, ribs and rods run along Y. Solids of revolution
are in `turned_shapes.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from core.surface.gap import Surface

Array = NDArray[np.float64]

ROUNDING = 0.2  # of edges [mm]
PERIOD, RIB, RIB_ROUNDING, RIB_HEIGHT, RIBS = 1.5, 0.75, 0.1, 3.0, 6  # of ribs [mm]; so many to either side
ARC = np.radians(3.0)  # of roundings, between triangles
LONG = 40.0  # of what runs along Y [mm]
DEEP = 20.0  # of pillars, from the top to the foot [mm]
MM = 1e-3


class Shape(Protocol):
    """A solid with an exact gap."""

    def gap(self, points: Array) -> tuple[Array, Array]:
        """Return the signed distance of points [mm], shape (n,), and its gradient, out of the solid, shape (n, 3)."""

    def surface(self) -> Surface:
        """Return the same solid as triangles [m]."""


@dataclass(frozen=True)
class Flat:
    """Everything below z = 0."""

    def gap(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances and gradients."""
        return points[:, 2].copy(), np.tile([0.0, 0.0, 1.0], (len(points), 1))

    def surface(self) -> Surface:
        """Return a block."""
        return Surface.block(0.1, 0.1)


@dataclass(frozen=True)
class Ball:
    """A ball of a radius [mm]."""

    radius: float

    def gap(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances and gradients."""
        out = points + [0.0, 0.0, self.radius]
        far = np.linalg.norm(out, axis=1)
        return far - self.radius, out / far[:, None]

    def surface(self) -> Surface:
        """Return a ball of 82 thousand triangles."""
        return Surface.sphere(self.radius * MM, 80_000)


@dataclass(frozen=True)
class Edge:
    """A wedge of an angle [degrees], rounded along its edge, which runs at x = 0."""

    angle: float

    def gap(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances and gradients."""
        return along_y(points[:, 0], *wedge(np.abs(points[:, 0]), points[:, 2], self.angle, ROUNDING))

    def surface(self) -> Surface:
        """Return a wedge."""
        return Surface.edge(np.radians(self.angle), ROUNDING * MM)


@dataclass(frozen=True)
class Rod:
    """A cylinder of a radius [mm] that lies along Y."""

    radius: float

    def gap(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances and gradients."""
        x, z = points[:, 0], points[:, 2] + self.radius
        far = np.maximum(np.hypot(x, z), 1e-12)
        return far - self.radius, np.stack([x / far, np.zeros_like(x), z / far], axis=1)

    def surface(self) -> Surface:
        """Return a prism of a turn in steps of a degree."""
        turn = np.radians(np.arange(360.0))
        vertices, triangles = drawn_out(self.radius * np.stack([np.cos(turn), np.sin(turn) - 1.0], axis=1))
        return Surface.build(vertices * MM, triangles)


@dataclass(frozen=True)
class Ribs:
    """Upright plates with rounded tops, a period apart, one of them in the middle at x = 0."""

    def gap(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances and gradients to the nearest plate (their feet are out of reach)."""
        x = points[:, 0] - PERIOD * np.clip(np.round(points[:, 0] / PERIOD), -RIBS, RIBS)
        return along_y(x, *rounded_corner(np.abs(x) - 0.5 * RIB, points[:, 2], RIB_ROUNDING))

    def surface(self) -> Surface:
        """Return plates that are closed each for itself."""
        half = _upper_half(RIB, RIB_ROUNDING, RIB_HEIGHT)
        vertices, triangles = drawn_out(np.vstack([half, half[::-1] * [-1.0, 1.0]])[::-1])
        each = range(-RIBS, RIBS + 1)
        return Surface.build(
            np.vstack([vertices + [k * PERIOD, 0.0, 0.0] for k in each]) * MM,
            np.vstack([triangles + (k + RIBS) * len(vertices) for k in each]),
        )


@dataclass(frozen=True)
class Plate:
    """An upright plate with a flat top and rounded rims.

    Attributes:
        width: between its walls [mm]. rim: radius of its rims [mm]. turned: it runs along X in place of Y.
    """

    width: float
    rim: float
    turned: bool = False

    def gap(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances and gradients (the foot is out of reach)."""
        x = points[:, 1 if self.turned else 0]
        gap, normal = along_y(x, *rounded_corner(np.abs(x) - 0.5 * self.width, points[:, 2], self.rim))
        return gap, normal[:, [1, 0, 2]] if self.turned else normal

    def surface(self) -> Surface:
        """Return a prism."""
        half = _upper_half(self.width, self.rim, DEEP)
        vertices, triangles = drawn_out(np.vstack([half, half[::-1] * [-1.0, 1.0]])[::-1])
        if self.turned:
            vertices, triangles = vertices[:, [1, 0, 2]], triangles[:, ::-1]
        return Surface.build(np.ascontiguousarray(vertices) * MM, np.ascontiguousarray(triangles))


@dataclass(frozen=True)
class Pillar:
    """An upright square pillar with a flat top; its rims and its upright edges are rounded.

    Attributes:
        width: between opposite walls [mm]. rim: radius of its edges [mm].
    """

    width: float
    rim: float

    def gap(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances and gradients (the foot is out of reach)."""
        inner = 0.5 * self.width - self.rim  # a point is as far outside as from the pillar that is smaller by the rim
        beyond = np.column_stack([np.abs(points[:, :2]) - inner, points[:, 2] + self.rim])
        sign = np.column_stack([np.where(points[:, :2] < 0.0, -1.0, 1.0), np.ones(len(points))])
        out = np.maximum(beyond, 0.0)
        far = np.linalg.norm(out, axis=1)
        outside = far > 0.0
        gap = np.where(outside, far, beyond.max(axis=1)) - self.rim
        face = np.eye(3)[beyond.argmax(axis=1)]
        return gap, sign * np.where(outside[:, None], out / np.where(outside, far, 1.0)[:, None], face)

    def surface(self) -> Surface:
        """Return the convex hull of its corners, which are parts of balls."""
        from scipy.spatial import ConvexHull

        turns = np.linspace(0.0, np.pi / 2, round(np.pi / 2 / ARC) + 1)
        up, round_ = (a.ravel() for a in np.meshgrid(turns[:-1], turns))
        corner = np.stack([np.cos(up) * np.cos(round_), np.cos(up) * np.sin(round_), np.sin(up)], axis=1)
        corner = self.rim * np.vstack([corner, [[0.0, 0.0, 1.0]]])
        foot = np.where(corner[:, 2:] == 0.0, corner - [0.0, 0.0, DEEP], np.nan)
        corner = np.vstack([corner, foot[np.isfinite(foot).all(axis=1)]])
        corner += [0.5 * self.width - self.rim, 0.5 * self.width - self.rim, -self.rim]
        vertices = np.vstack([corner * [x, y, 1.0] for x in (-1.0, 1.0) for y in (-1.0, 1.0)])
        hull = ConvexHull(vertices)
        a, b, c = vertices[hull.simplices].transpose(1, 0, 2)
        inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
        triangles = np.where(inwards[:, None], hull.simplices[:, ::-1], hull.simplices)
        return Surface.build(vertices * MM, triangles)


def _upper_half(width: float, rim: float, height: float) -> Array:
    """Return half the profile of an upright plate with rounded rims, from the middle of its top [mm], shape (k, 2)."""
    turns = np.linspace(np.pi / 2, 0.0, round(np.pi / 2 / ARC) + 1)
    arc = rim * np.stack([np.cos(turns), np.sin(turns) - 1.0], axis=1) + [0.5 * width - rim, 0.0]
    return np.vstack([arc, [[0.5 * width, -height]]])


def wedge(across: Array, z: Array, angle: float, rounding: float) -> tuple[Array, Array, Array]:
    """Return the gap to a rounded tip of an angle [degrees], and its gradient across and along z: each shape (n,).

    Args:
        across: distance from the plane or axis of symmetry, not negative. z: height over the top of the tip.
    """
    half, up = np.radians(angle) / 2.0, z + rounding
    face = np.cos(half), np.sin(half)
    far = np.hypot(across, up)
    on_arc = (far > 0.0) & (across * face[1] - up * face[0] < 0.0)
    safe = np.where(on_arc, far, 1.0)
    nx, nz = np.where(on_arc, across / safe, face[0]), np.where(on_arc, up / safe, face[1])
    return nx * across + nz * up - rounding, nx, nz


def rounded_corner(beyond: Array, z: Array, rounding: float) -> tuple[Array, Array, Array]:
    """Return the gap to an upright wall under a flat top at z = 0, and its gradient across and along z: shape (n,).

    Args:
        beyond: distance outwards from the wall.
    """
    across, up = beyond + rounding, z + rounding
    corner, top = (across > 0.0) & (up > 0.0), up >= across
    safe = np.where(corner, np.hypot(across, up), 1.0)
    nx = np.where(corner, across / safe, np.where(top, 0.0, 1.0))
    nz = np.where(corner, up / safe, np.where(top, 1.0, 0.0))
    return nx * across + nz * up - rounding, nx, nz


def along_y(x: Array, gap: Array, across: Array, up: Array) -> tuple[Array, Array]:
    """Return gaps and gradients of what is symmetric about x = 0, from those at its positive side."""
    return gap, np.stack([np.where(x < 0.0, -across, across), np.zeros_like(x), up], axis=1)


def drawn_out(profile: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return vertices and triangles of a prism along Y.

    Args:
        profile: convex, counter-clockwise seen from -Y, shape (k, 2).
    """
    n = len(profile)
    i, j = np.arange(n), (np.arange(n) + 1) % n
    fan = np.array([(0, k, k + 1) for k in range(1, n - 1)])
    sides = np.vstack([np.stack([i, i + n, j], axis=1), np.stack([j, i + n, j + n], axis=1)])
    vertices = np.vstack([np.insert(profile, 1, y, axis=1) for y in (-0.5 * LONG, 0.5 * LONG)])
    return vertices, np.vstack([fan, fan[:, ::-1] + n, sides])

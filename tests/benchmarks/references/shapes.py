"""The shapes of the references: exact gaps to press on, and triangles for the product to press on. Lengths in mm.

Every shape's highest point is the origin and +Z leads out of it; edges and ribs run along Y.
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
        """Return signed distances and gradients: to the arc where a point is above its ends, else to a face."""
        half = np.radians(self.angle) / 2.0
        face = np.array([np.cos(half), np.sin(half)])  # normal of the face at positive x
        side = np.where(points[:, 0] < 0.0, -1.0, 1.0)
        x, z = np.abs(points[:, 0]), points[:, 2] + ROUNDING
        far = np.hypot(x, z)
        on_arc = (far > 0.0) & (x * face[1] - z * face[0] < 0.0)
        safe = np.where(on_arc, far, 1.0)
        nx, nz = np.where(on_arc, x / safe, face[0]), np.where(on_arc, z / safe, face[1])
        return nx * x + nz * z - ROUNDING, np.stack([side * nx, np.zeros_like(x), nz], axis=1)

    def surface(self) -> Surface:
        """Return a wedge of 40 mm along its edge."""
        return Surface.edge(np.radians(self.angle), ROUNDING * MM)


@dataclass(frozen=True)
class Ribs:
    """Upright plates with rounded tops, a period apart, one of them in the middle at x = 0."""

    def gap(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances and gradients to the nearest plate (their feet are out of reach)."""
        rib = np.clip(np.round(points[:, 0] / PERIOD), -RIBS, RIBS)
        x, z = points[:, 0] - rib * PERIOD, points[:, 2]
        side = np.where(x < 0.0, -1.0, 1.0)
        across, up = np.abs(x) - (0.5 * RIB - RIB_ROUNDING), z + RIB_ROUNDING
        far = np.hypot(across, up)
        corner, top = (across > 0.0) & (up > 0.0), up >= across
        safe = np.where(corner, far, 1.0)
        nx = np.where(corner, across / safe, np.where(top, 0.0, 1.0))
        nz = np.where(corner, up / safe, np.where(top, 1.0, 0.0))
        return nx * across + nz * up - RIB_ROUNDING, np.stack([side * nx, np.zeros_like(x), nz], axis=1)

    def surface(self) -> Surface:
        """Return plates that are closed each for itself, 40 mm long."""
        turns = np.linspace(np.pi / 2, 0.0, round(np.pi / 2 / ARC) + 1)
        arc = RIB_ROUNDING * np.stack([np.cos(turns), np.sin(turns) - 1.0], axis=1) + [0.5 * RIB - RIB_ROUNDING, 0.0]
        half = np.vstack([arc, [[0.5 * RIB, -RIB_HEIGHT]]])
        profile = np.vstack([half, half[::-1] * [-1.0, 1.0]])[::-1]  # counter-clockwise seen from -Y
        n = len(profile)
        i, j = np.arange(n), (np.arange(n) + 1) % n
        fan = np.array([(0, k, k + 1) for k in range(1, n - 1)])
        sides = np.vstack([np.stack([i, i + n, j], axis=1), np.stack([j, i + n, j + n], axis=1)])
        triangles = np.vstack([fan, fan[:, ::-1] + n, sides])
        vertices = np.vstack([np.insert(profile, 1, y, axis=1) for y in (-20.0, 20.0)])
        each = range(-RIBS, RIBS + 1)
        return Surface.build(
            np.vstack([vertices + [k * PERIOD, 0.0, 0.0] for k in each]) * MM,
            np.vstack([triangles + (k + RIBS) * 2 * n for k in each]),
        )

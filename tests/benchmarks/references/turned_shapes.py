"""Solids of revolution among the shapes of the references. Lengths in mm; their axes are upright, at x = 0."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.surface.gap import Surface
from tests.stress.solids import arc, moved, peg, revolved, torus

from .shapes import MM, rounded_corner, wedge

Array = NDArray[np.float64]
AROUND = 240  # triangles about an axis
TALL = 20.0  # of what stands upright [mm]
WIDE, THICK = 20.0, 10.0  # of a dot's plate: radius, height [mm]


@dataclass(frozen=True)
class Peg:
    """An upright cylinder with a rounded upper rim: a punch, or a coin that lies flat.

    Attributes:
        radius, rim: of the cylinder and of its rounding. y: of its axis.
    """

    radius: float
    rim: float
    y: float = 0.0

    def gap(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances and gradients (the foot is out of reach)."""
        far, out = _about(points, self.y)
        return _turned(out, *rounded_corner(far - self.radius, points[:, 2], self.rim))

    def surface(self) -> Surface:
        """Return a body of revolution."""
        return Surface.build(*moved(peg(self.radius * MM, self.rim * MM, TALL * MM, AROUND), y=self.y * MM))


@dataclass(frozen=True)
class Torus:
    """A ring that lies flat.

    Attributes:
        minor, major: radii of the tube, and of the circle that its middle follows. y: of its axis.
    """

    minor: float
    major: float
    y: float = 0.0

    def gap(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances and gradients."""
        far, out = _about(points, self.y)
        across, up = far - self.major, points[:, 2] + self.minor
        apart = np.maximum(np.hypot(across, up), 1e-12)
        return _turned(out, apart - self.minor, across / apart, up / apart)

    def surface(self) -> Surface:
        """Return a body of revolution."""
        return Surface.build(*moved(torus(self.minor * MM, self.major * MM, AROUND, AROUND // 2), y=self.y * MM))


@dataclass(frozen=True)
class Cone:
    """An upright cone of an opening angle [degrees] with a rounded tip."""

    angle: float
    rounding: float

    def gap(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances and gradients (the foot is out of reach)."""
        far, out = _about(points, 0.0)
        return _turned(out, *wedge(far, points[:, 2], self.angle, self.rounding))

    def surface(self) -> Surface:
        """Return a body of revolution."""
        half = 0.5 * self.angle
        tip = arc(self.rounding, (0.0, -self.rounding), 90.0, half, 3.0)
        foot = tip[-1, 0] + (tip[-1, 1] + TALL) * np.tan(np.radians(half))
        profile = np.vstack([tip, [[foot, -TALL], [0.0, -TALL]]])
        return Surface.build(*revolved(profile * MM, AROUND))


@dataclass(frozen=True)
class Dot:
    """A cap of a ball on a wide plate, as in Braille.

    Attributes:
        half_width, height: of the cap.
    """

    half_width: float
    height: float

    @property
    def radius(self) -> float:
        """Of the ball."""
        return (self.half_width**2 + self.height**2) / (2.0 * self.height)

    def gap(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances and gradients: to the nearer of cap and plate."""
        far, out = _about(points, 0.0)
        up = points[:, 2] + self.radius
        apart = np.maximum(np.hypot(far, up), 1e-12)
        plate = points[:, 2] + self.height
        cap = apart - self.radius < plate
        gap = np.where(cap, apart - self.radius, plate)
        return _turned(out, gap, np.where(cap, far / apart, 0.0), np.where(cap, up / apart, 1.0))

    def surface(self) -> Surface:
        """Return a body of revolution."""
        reach = float(np.degrees(np.arcsin(self.half_width / self.radius)))
        cap = arc(self.radius, (0.0, -self.radius), 90.0, 90.0 - reach, 2.0)
        foot = -self.height - THICK
        profile = np.vstack([cap, [[WIDE, -self.height], [WIDE, foot], [0.0, foot]]])
        return Surface.build(*revolved(profile * MM, AROUND))


def _about(points: Array, y: float) -> tuple[Array, Array]:
    """Return the distance of points from an axis, shape (n,), and the directions away from it, shape (n, 2)."""
    apart = points[:, :2] - [0.0, y]
    far = np.linalg.norm(apart, axis=1)
    safe = np.where(far > 0.0, far, 1.0)
    return far, np.where(far[:, None] > 0.0, apart / safe[:, None], [1.0, 0.0])


def _turned(out: Array, gap: Array, across: Array, up: Array) -> tuple[Array, Array]:
    """Return gaps and gradients, from those in the plane of a point and the axis."""
    return gap, np.column_stack([across[:, None] * out, up])

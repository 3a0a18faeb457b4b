"""Solids by their distance, to press skin with: what is seen of them does not depend on a mesh's facets.

The top of each is at the origin, +Z out of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..surface.gap import GapQuery
from ..surface.plane import Plane

Distance = Callable[[Array], tuple[Array, Array]]  # of points, shape (n, 3), to signed gaps and outward normals


@dataclass(frozen=True, eq=False)
class Solid(Plane):
    """A solid.

    Attributes:
        distance: signed gap [m] and normal of points.
    """

    distance: Distance

    def query(self, points: Array, search_radius: float = np.inf) -> GapQuery:
        """Return the signed gap, closest point and normal of each point, as `Surface.query` does."""
        gap, normal = self.distance(points)
        near = gap <= search_radius
        count = len(gap)
        return GapQuery(
            np.where(near, gap, np.inf),
            np.where(near[:, None], normal, 0.0),
            np.where(near[:, None], points - gap[:, None] * normal, np.nan),
            np.where(near, 0, -1),
            np.zeros((count, 3)),
            np.zeros(count, bool),
        )


def flat() -> Plane:
    """Return the half-space below z = 0."""
    return Plane(np.array([0.0, 0.0, 1.0]), np.zeros(3))


def ball(radius: float) -> Solid:
    """Return a ball."""

    def distance(points: Array) -> tuple[Array, Array]:
        from_centre = points + np.array([0.0, 0.0, radius])
        far = np.linalg.norm(from_centre, axis=1)
        return far - radius, from_centre / np.maximum(far, 1e-12)[:, None]

    return _solid(distance)


def rod(radius: float) -> Solid:
    """Return an endless round rod along X."""

    def distance(points: Array) -> tuple[Array, Array]:
        from_axis = points + np.array([0.0, 0.0, radius])
        from_axis[:, 0] = 0.0
        far = np.linalg.norm(from_axis, axis=1)
        return far - radius, from_axis / np.maximum(far, 1e-12)[:, None]

    return _solid(distance)


def edge(rounding: float, half_angle: float) -> Solid:
    """Return an endless wedge whose rounded edge runs along X: a block's edge, or with a small angle a rib."""
    sine, cosine = np.sin(half_angle), np.cos(half_angle)

    def distance(points: Array) -> tuple[Array, Array]:
        y, z = points[:, 1], points[:, 2] + rounding  # from the axis of the rounding
        side, out = np.where(y >= 0.0, 1.0, -1.0), np.hypot(y, z)
        rounded = (np.abs(y) * sine < z * cosine) & (out > 0.0)
        gap = np.where(rounded, out, np.abs(y) * cosine + z * sine) - rounding
        over = np.maximum(out, 1e-12)
        normal = np.stack(
            [np.zeros_like(y), np.where(rounded, y / over, side * cosine), np.where(rounded, z / over, sine)], axis=1
        )
        return gap, normal

    return _solid(distance)


def _solid(distance: Distance) -> Solid:
    return Solid(np.array([0.0, 0.0, 1.0]), np.zeros(3), distance)

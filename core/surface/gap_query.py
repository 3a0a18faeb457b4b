"""The answer to how far points are from a surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices


@dataclass(frozen=True)
class GapQuery:
    """The closest points of a surface.

    Attributes:
        gap: signed distance [m], positive outside, inf beyond reach, shape (n,).
        normal: unit gradient of the gap, pointing outward; zero beyond reach, shape (n, 3).
        point: the closest point of the surface [m], NaN beyond reach, shape (n, 3).
        triangle: the triangle it lies on, -1 beyond reach, shape (n,).
        weights: barycentric weights of the three corners at the closest point, shape (n, 3).
        beside: the point has passed beside the rim of an open surface and is outside of either side, shape (n,).
    """

    gap: Array
    normal: Array
    point: Array
    triangle: Indices
    weights: Array
    beside: NDArray[np.bool_]

    def flipped(self) -> GapQuery:
        """Return the same answer for the other side of the surface."""
        turned = np.isfinite(self.gap) & ~self.beside
        gap = np.where(turned, -self.gap, self.gap)
        normal = np.where(turned[:, None], -self.normal, self.normal)
        return GapQuery(gap, normal, self.point, self.triangle, self.weights, self.beside)

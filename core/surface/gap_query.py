"""GapQuery: closest points of a surface, with signed gaps and normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices


@dataclass(frozen=True)
class GapQuery:
    """Closest points of a surface to n points.

    Attributes:
        gap: signed distance, positive outside [m], shape (n,); inf beyond reach.
        normal: gradient of the gap, a unit vector outwards, shape (n, 3); zero beyond reach.
        point: closest point of the surface [m], shape (n, 3); NaN beyond reach.
        triangle: index of the triangle of the closest point, shape (n,); -1 beyond reach.
        weights: barycentric weights of the triangle's corners at the closest point, shape (n, 3).
        beside: whether the point lies beyond the rim of an open surface and is therefore outside on both sides, (n,).
    """

    gap: Array
    normal: Array
    point: Array
    triangle: Indices
    weights: Array
    beside: NDArray[np.bool_]

    def flipped(self) -> GapQuery:
        """Return the result for contact on the other side of the surface."""
        turned = np.isfinite(self.gap) & ~self.beside
        gap = np.where(turned, -self.gap, self.gap)
        normal = np.where(turned[:, None], -self.normal, self.normal)
        return GapQuery(gap, normal, self.point, self.triangle, self.weights, self.beside)

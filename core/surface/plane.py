"""Plane: an infinite plane as a surface for contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from .gap import GapQuery
from .kernel_body import KernelBody


@dataclass(frozen=True, eq=False)
class Plane:
    """Half-space below a plane.

    Attributes:
        normal: unit normal out of the half-space, shape (3,); it may be given with any length above zero.
        point: any point on the plane [m], shape (3,).

    Raises:
        DermisError: the normal is zero or not finite.
    """

    normal: Array
    point: Array

    def __post_init__(self) -> None:
        normal = np.asarray(self.normal, dtype=np.float64)
        length = float(np.linalg.norm(normal))
        if normal.shape != (3,) or not np.isfinite(length) or length == 0.0:
            raise DermisError("a plane needs a normal", value=self.normal)
        object.__setattr__(self, "normal", normal / length)
        object.__setattr__(self, "point", np.asarray(self.point, dtype=np.float64))

    closed = True
    box = np.array([[-np.inf] * 3, [np.inf] * 3])

    @property
    def rim(self) -> tuple[float, float]:
        """Radii of the flat face and of the rounded rim of a disc [m], (0, 0) for an infinite plane."""
        return 0.0, 0.0

    @property
    def kernel_body(self) -> KernelBody | None:
        """None, because the kernels take a plane by its normal and point."""
        return None

    def query(self, points: Array, search_radius: float = np.inf) -> GapQuery:
        """Return signed gaps, closest points and normals, see `Surface.query`.

        Args:
            points: points to query [m], shape (n, 3).
            search_radius: largest gap [m]. Points with a larger gap have an infinite gap in the result.
        """
        gap = (points - self.point) @ self.normal
        n = gap.shape[0]
        normal = np.broadcast_to(self.normal, (n, 3))
        point = points - gap[:, None] * self.normal
        triangle = np.zeros(n, dtype=np.int64)
        far = gap > search_radius
        if far.any():
            gap = np.where(far, np.inf, gap)
            normal = np.where(far[:, None], 0.0, normal)
            point = np.where(far[:, None], np.nan, point)
            triangle[far] = -1
        return GapQuery(gap, normal, point, triangle, np.zeros((n, 3)), np.zeros(n, dtype=bool))

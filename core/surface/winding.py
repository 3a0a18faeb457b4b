"""Winding number: determines the side of a point where no normal does."""

from __future__ import annotations

import numpy as np

from ..arrays import Array


def winding(corner: Array, points: Array) -> Array:
    """Return the winding number of a surface around points, shape (n,).

    It is the sum of the triangles' solid angles, divided by 4 pi. For a closed surface whose normals point
    outwards, it is 1 inside and 0 outside.

    Args:
        corner: corners of the triangles [m], shape (T, 3, 3).
        points: the points [m], shape (n, 3).
    """
    out = np.empty(points.shape[0])
    step = max(1, 1_000_000 // corner.shape[0])
    for start in range(0, points.shape[0], step):
        r = corner[None] - points[start : start + step, None, None, :]
        length = np.sqrt((r * r).sum(axis=-1))
        a, b, c = r[:, :, 0], r[:, :, 1], r[:, :, 2]
        triple = (a * np.cross(b, c)).sum(axis=-1)
        la, lb, lc = length[..., 0], length[..., 1], length[..., 2]
        denominator = la * lb * lc + (a * b).sum(axis=-1) * lc + (b * c).sum(axis=-1) * la + (c * a).sum(axis=-1) * lb
        out[start : start + step] = np.arctan2(triple, denominator).sum(axis=1) / (2.0 * np.pi)
    return out

"""The mirror image of a fingertip, which is its own: its left side is its right one."""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Indices

MIRROR = np.array([-1.0, 1.0, 1.0])
EVEN = 1e-6  # of its size, to which a fingertip is its own mirror image


def mirrored(points: Array) -> Indices | None:
    """Return which point is each one's mirror image in x, shape (n,); None of points that are not their own image."""
    from scipy.spatial import cKDTree

    away, image = cKDTree(points).query(points * MIRROR)
    return np.asarray(image) if away.max() <= EVEN * np.ptp(points) else None

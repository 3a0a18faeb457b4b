"""Weight of a held object: its acceleration, and gravity.

Source: [S3] eq. 4.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..errors import DermisError

SIGNS = {"paper": 1.0, "inertia": -1.0}


def displacement(
    acceleration: Array, gravity: Array, alpha_a: float | Array, alpha_g: float | Array, sign: str = "paper"
) -> Array:
    """Return the displacement d = alpha_a a + alpha_g g, shape (n, 3).

    It is a fraction of the device's range.

    Args:
        acceleration: a, acceleration of the object's centre of gravity [m/s^2], shape (n, 3).
        gravity: g [m/s^2], shape (3,).
        alpha_a, alpha_g: [1/(m/s^2)], one number or shape (n,).
        sign: 'paper' for +alpha_a a as printed; 'inertia' for -alpha_a a, the direction in which a real mass pulls.

    Raises:
        DermisError: `sign` is none of these.

    Source: [S3] eq. 4
    """
    if sign not in SIGNS:
        raise DermisError("unknown sign of the acceleration", value=sign, limit=", ".join(SIGNS))
    alpha_a, alpha_g = (v[:, None] if isinstance(v, np.ndarray) else v for v in (alpha_a, alpha_g))
    return SIGNS[sign] * alpha_a * acceleration + alpha_g * np.asarray(gravity)


def fitting(peak: float) -> float:
    """Return the factor that fits the displacements of a bake to the range.

    The factor is at most 1. It is the same for all weights of a scene, which keeps their ratios. Two different weights
    that would both saturate therefore remain different.

    Args:
        peak: largest length of any weight's displacement in the plane of a pad, as a fraction of the range.
    """
    return 1.0 if peak <= 1.0 else 1.0 / peak

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
    """Return d = alpha_a a + alpha_g g, as a fraction of the device's range, shape (n, 3).

    Args:
        acceleration: acceleration of the object's centre of gravity [m/s^2], shape (n, 3).
        gravity: [m/s^2], shape (3,).
        alpha_a, alpha_g: [1/(m/s^2)], one number or shape (n,).
        sign: 'paper' as printed; 'inertia' drags by -alpha_a a, as a real mass would.

    Raises:
        DermisError: an unknown sign.

    Source: [S3] eq. 4
    """
    if sign not in SIGNS:
        raise DermisError("unknown sign of the acceleration", value=sign, limit=", ".join(SIGNS))
    inertia = np.reshape(SIGNS[sign] * np.asarray(alpha_a), (-1, 1)) * acceleration
    return inertia + np.reshape(np.asarray(alpha_g), (-1, 1)) * np.asarray(gravity)


def fitting(peak: float) -> float:
    """Return the factor that brings the largest displacement of a whole bake into the range, at most 1.

    One factor for every weight of a scene keeps their ratios, so that two that would both saturate stay apart.

    Args:
        peak: largest length of any weight's displacement in a pad's plane, as a fraction of the range.
    """
    return 1.0 if peak <= 1.0 else 1.0 / peak

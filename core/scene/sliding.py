"""How the sliding plane of [S1] moves: pressed into the pad to a depth and then drawn along.

Source: [S1] IV.A and eq. 19
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from ..arrays import Array

STROKE = 0.02  # R [m]. Source: [S1] IV.A
ANGULAR_VELOCITY = np.pi / 4  # omega [rad/s], a period of 8 s. Source: [S1] IV.A
FPS = Fraction(24)
SETTLE = 0.5  # [s] pressing and coming to rest before the plane moves; [S1] waits for 0.42 s
PRESS = 0.25  # [s] of it, in which the plane comes in
SLIDE = 2.0  # [s] of movement that is presented. Source: [S1] IV.A


def plane_offset(times: Array, depth: float, direction: float) -> Array:
    """Return where the plane's origin, on its upper face, is at each time [m], shape (n, 3).

    The coordinate along `direction` is l(t) - l(0) with l = -R cos(wt) and t counted from the end of `SETTLE`.
    """
    share = np.clip(times / PRESS, 0.0, 1.0)
    height = -0.2e-3 + (depth + 0.2e-3) * share * share * (3.0 - 2.0 * share)  # from just below the pad
    along = STROKE * (1.0 - np.cos(ANGULAR_VELOCITY * np.maximum(times - SETTLE, 0.0)))
    return np.column_stack([along * np.cos(direction), along * np.sin(direction), height])

"""An actuator that is a mass on a spring with a damper: its frequency response, and what drives it along a movement."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from core.arrays import Array
from core.devices.frequency_response import Points

NATURAL, DAMPING = 120.0, 0.25  # [Hz], [1]
RATE = 8000.0  # [Hz]


def answer(hertz: Array) -> NDArray[np.complex128]:
    """Return what it reaches for a unit of what it is driven to."""
    ratio = hertz / NATURAL
    return 1.0 / (1.0 - ratio**2 + 2j * DAMPING * ratio)


def measured(hertz: Array) -> Points:
    """Return its response as somebody would measure it."""
    found = answer(hertz)
    rows = zip(hertz.tolist(), np.abs(found).tolist(), np.angle(found).tolist(), strict=True)
    return tuple((a, b, c) for a, b, c in rows)


def movement(times: Array, centre: float, middle: float = 0.5, width: float = 0.03) -> tuple[Array, Array]:
    """Return a burst of vibration, and exactly what drives the actuator along it: y + 2 z y' / w + y'' / w^2.

    Args:
        times: [s]. centre: frequency of the burst [Hz]; 0: a bump. middle, width: of the bell around it [s].
    """
    turn, natural = 2j * math.pi * centre, 2.0 * math.pi * NATURAL
    after = times - middle
    burst = np.exp(-0.5 * (after / width) ** 2 + turn * after)
    slope = turn - after / width**2  # of the exponent
    first, second = burst * slope, burst * (slope**2 - 1.0 / width**2)
    driven = burst + 2.0 * DAMPING / natural * first + second / natural**2
    return burst.real, driven.real

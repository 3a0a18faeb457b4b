"""A finger sliding over a slope: direction of motion, and the friction that the slope asks for."""

from __future__ import annotations

from itertools import chain, pairwise

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError
from ..memory import Carry
from ..parameters.device import DEVICE
from .heading import Heading

MAX_FRICTION = 100.0  # the strongest friction of [S4]'s scale of 0 to 100
MIN_FRICTION = 1.0  # the weakest that Table 1 renders
STEEPEST_NORMAL = 0.05  # n_z below this (steeper than 87 degrees) is limited


def directions(
    x: Array,
    y: Array,
    touching: NDArray[np.bool_],
    rate: float,
    window: float,
    resting: NDArray[np.bool_] | None = None,
    radius: float = 0.0,
    carry: Carry | None = None,
) -> Array:
    """Return the unit direction of motion in contact, shape (n, 2); zero before the first movement of a touch.

    What `Heading` says of each sample. Every touch begins anew.

    Args:
        x, y: position on the screen [m], shape (n,).
        touching: shape (n,).
        rate: samples a second [Hz].
        window: length of the moving average [s]; 0 is eq. 4 itself.
        resting: where the finger is known to be at rest at the end of a step, whatever x and y say, shape (n,).
        radius: radius of the position noise to ignore [m], as a live panel does; 0 for exact positions.
        carry: how it goes on from a window of times before, and into the next; None: there was no touch.

    Source: [S4] eq. 4
    """
    count, result = len(x), [(0.0, 0.0)] * len(x)
    still = np.zeros(count, bool) if resting is None else resting
    carry = carry or Carry()
    heading, down, first = carry.start or (Heading(window, radius), False, 0)
    heading, period = heading.copied(), 1.0 / rate
    times, xs, ys, rests = [(first + i) * period for i in range(count)], x.tolist(), y.tolist(), still.tolist()
    changes = (touching[1:] != touching[:-1]).nonzero()[0] + 1
    bounds = sorted({0, *changes.tolist(), min(carry.index, count), count})
    for start, end in pairwise(bounds):
        if start == carry.index:
            carry.found = heading.copied(), down, first + start
        if touching[start]:
            result[start:end] = heading.along(times[start:end], xs[start:end], ys[start:end], rests[start:end])
        elif down:
            heading.lift()
        down = bool(touching[start])
    return np.fromiter(chain.from_iterable(result), np.float64, 2 * count).reshape(-1, 2)


def friction_of_slope(slope_x: Array, slope_y: Array, direction: Array, scale: float | Array) -> Array:
    """Return f = f0 grad F . v, signed: above zero uphill.

    Args:
        slope_x, slope_y: gradient of the height towards the viewer [m/m], shape (n,).
        direction: unit vectors of the motion, shape (n, 2).
        scale: f0, friction for a slope of 1.

    Source: [S4] eq. 5
    """
    return np.asarray(scale * (slope_x * direction[..., 0] + slope_y * direction[..., 1]))


def friction_of_normal(normal: Array, direction: Array, scale: float) -> tuple[Array, int]:
    """Return f = -f0 n_xy . v / n_z, which equals eq. 5 on the same surface, and how many normals were limited.

    A surface seen from the side has n_z = 0 and an infinite slope; n_z is held at 0.05 or above.

    Args:
        normal: unit normals of the mesh in the screen's axes, towards the viewer, shape (n, 3).
        direction: unit vectors of the motion, shape (n, 2).

    Source: [S4] eq. 6, with the sign and the division that make it equal to eq. 5
    """
    limited = int(np.count_nonzero(normal[:, 2] < STEEPEST_NORMAL))
    upward = np.maximum(normal[:, 2], STEEPEST_NORMAL)
    along = normal[:, 0] * direction[:, 0] + normal[:, 1] * direction[:, 1]
    return -scale * along / upward, limited


def friction_of_normal_printed(normal: Array, direction: Array, scale: float) -> Array:
    """Return f = f0 n . [v, 0] as printed: the opposite sign of eq. 5, and compressed to within -f0 .. f0.

    Source: [S4] eq. 6
    """
    return np.asarray(scale * (normal[:, 0] * direction[:, 0] + normal[:, 1] * direction[:, 1]))


def without_downhill(friction: Array, way: str) -> Array:
    """Return friction as a screen can show it, which cannot push.

    Args:
        friction: signed, above zero uphill.
        way: 'rectify' (downhill is free), 'offset' (flat ground lies at half of the range, downhill below it) or
            'absolute' (downhill resists like uphill).

    Raises:
        DermisError: another way.
    """
    if way == "rectify":
        return np.maximum(friction, 0.0)
    if way == "offset":
        return np.maximum(0.5 * (MAX_FRICTION + friction), 0.0)
    if way == "absolute":
        return np.abs(friction)
    raise DermisError("unknown downhill", value=way, limit=DEVICE["downhill"].allowed)

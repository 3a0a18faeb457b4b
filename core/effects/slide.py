"""Sliding on a relief: direction of motion, and friction of the slope."""

from __future__ import annotations

from itertools import chain, pairwise

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError
from ..memory import Carry
from ..parameters.device import DEVICE
from .heading import Heading

MAX_FRICTION = 100.0  # largest friction on the scale of [S4], 0 to 100
MIN_FRICTION = 1.0  # smallest friction that Table 1 of [S4] renders
STEEPEST_NORMAL = 0.05  # smallest n_z; a smaller one (a slope above 87 degrees) is set to this


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
    """Return the unit direction of motion in contact, shape (n, 2).

    It is computed by `Heading`. It is zero without contact, and before the first movement of a touch.

    Args:
        x, y: position on the screen [m], shape (n,).
        touching: whether the finger touches the screen, shape (n,).
        rate: samples per second [Hz].
        window: length of the moving average [s]; with 0, the result is eq. 4 itself.
        resting: whether the finger is known to rest during the step that ends at each sample, although x and y may
            change, shape (n,); None if nothing is known.
        radius: radius of the noise of positions that is ignored [m], for a live panel; 0 for exact positions.
        carry: state of the heading at the first sample, in which the state for the next span of times is stored;
            None if no touch continues from or into another span.

    Source: [S4] eq. 4
    """
    count, result = len(x), [(0.0, 0.0)] * len(x)
    still = np.zeros(count, bool) if resting is None else resting
    carry = carry or Carry()
    heading, down, first = carry.start or (Heading(window, radius), False, 0)
    heading, period = heading.copied(), 1.0 / rate
    times = (np.arange(first, first + count) * period).tolist()
    xs, ys, rests = x.tolist(), y.tolist(), still.tolist()
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
    """Return the friction of a slope, f = f0 grad F . v, shape (n,).

    It is positive uphill and negative downhill.

    Args:
        slope_x, slope_y: gradient of the height towards the viewer [m/m], shape (n,).
        direction: unit vectors of the motion, shape (n, 2).
        scale: f0, friction for a slope of 1; one number or shape (n,).

    Source: [S4] eq. 5
    """
    return np.asarray(scale * (slope_x * direction[..., 0] + slope_y * direction[..., 1]))


def friction_of_normal(normal: Array, direction: Array, scale: float) -> tuple[Array, int]:
    """Return the friction of a mesh, f = -f0 n_xy . v / n_z, shape (n,).

    The number of limited normals is returned too. The friction equals eq. 5 on the same surface. A surface that is seen
    from the side has n_z = 0 and an infinite slope, so n_z is limited to at least 0.05.

    Args:
        normal: unit normals of the mesh in the screen's axes, towards the viewer, shape (n, 3).
        direction: unit vectors of the motion, shape (n, 2).
        scale: f0, friction for a slope of 1.

    Source: [S4] eq. 6, with the sign and the division that make it equal to eq. 5
    """
    limited = int(np.count_nonzero(normal[:, 2] < STEEPEST_NORMAL))
    upward = np.maximum(normal[:, 2], STEEPEST_NORMAL)
    along = normal[:, 0] * direction[:, 0] + normal[:, 1] * direction[:, 1]
    return -scale * along / upward, limited


def friction_of_normal_printed(normal: Array, direction: Array, scale: float) -> Array:
    """Return the friction of eq. 6 as printed, f = f0 n . [v, 0], shape (n,).

    Its sign is opposite to that of eq. 5, and its values are between -f0 and f0. The arguments are those of
    `friction_of_normal`.

    Source: [S4] eq. 6
    """
    return np.asarray(scale * (normal[:, 0] * direction[:, 0] + normal[:, 1] * direction[:, 1]))


def without_downhill(friction: Array, way: str) -> Array:
    """Return friction without negative values: a screen cannot push.

    Args:
        friction: friction, positive uphill and negative downhill.
        way: 'rectify' (no friction downhill), 'offset' (flat ground has half of the largest friction, downhill has
            less) or 'absolute' (downhill resists like uphill).

    Raises:
        DermisError: `way` is none of these.
    """
    if way == "rectify":
        return np.maximum(friction, 0.0)
    if way == "offset":
        return np.maximum(0.5 * (MAX_FRICTION + friction), 0.0)
    if way == "absolute":
        return np.abs(friction)
    raise DermisError("unknown treatment of downhill slopes", value=way, limit=DEVICE["downhill"].allowed)

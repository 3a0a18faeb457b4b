"""Texture: a displacement along the direction of movement that depends on the place.

Source: [S3] eq. 2 and 3, after Campion et al. 2008.
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from ..motion.vectors import dot, scaled


def displacement(
    place: Array,
    direction: Array,
    friction: float | Array,
    amplitude: tuple[float | Array, float | Array],
    period: tuple[float | Array, float | Array],
) -> Array:
    """Return d = -mu (alpha_x sin(2 pi x_x / f_x) + alpha_y sin(2 pi x_y / f_y)) sigma(v_t).

    Args:
        place: coordinates on the surface (x_x, x_y) [m], shape (n, 2).
        direction: sigma, see `held_direction`, shape (n, k).
        friction: mu. amplitude: alpha_x and alpha_y, fractions of the device's range.
        period: f_x and f_y, which are spatial periods [m]: the paper divides by them.

    Returns:
        displacement as a fraction of the device's range, shape (n, k).

    Raises:
        DermisError: a period that is not above 0.

    Source: [S3] eq. 2
    """
    wave: Array | float = 0.0
    for axis, (alpha, length) in enumerate(zip(amplitude, period, strict=True)):
        if not np.all(alpha == 0.0):
            if not np.all(np.asarray(length) > 0.0):
                raise DermisError("a texture's period must be above 0", value=float(np.min(length)), limit="> 0 m")
            wave = wave + alpha * np.sin(place[:, axis] * (2.0 * math.pi / length))
    return scaled(direction, np.broadcast_to(-friction * wave, len(place)))


def held_direction(velocity: Array, threshold: float | Array, before: Array | None = None) -> Array:
    """Return sigma: the direction of movement, or that of the last movement while the speed is below the threshold.

    It is zero before the first movement. At threshold 0 a speed of exactly 0 is no movement either.

    Args:
        velocity: tangential velocity [m/s], shape (n, k).
        threshold: k [m/s].
        before: sigma of the time before, shape (k,); None: there was no movement.

    Source: [S3] eq. 3
    """
    speed = np.sqrt(dot(velocity, velocity))
    moves = (speed >= threshold) & (speed > 0.0)
    if moves.all():
        return scaled(velocity, 1.0 / speed)
    last = np.maximum.accumulate(np.where(moves, np.arange(len(speed)), -1))
    held = np.maximum(last, 0)
    scale = np.where(last >= 0, 1.0 / np.where(speed[held] > 0.0, speed[held], 1.0), 0.0)
    direction = scaled(velocity[held], scale)
    if before is not None:
        direction[last < 0] = before
    return direction


def tangential(velocity: Array, normal: Array) -> Array:
    """Return the part of velocities (n, 3) that is perpendicular to unit normals (n, 3)."""
    return velocity - scaled(normal, dot(velocity, normal))


def coordinates(point: Array, normal: Array) -> Array:
    """Return where points lie on a surface, in a tangent frame [m], shape (n, 2).

    The frame's first axis is the body's X axis laid onto the tangent plane (its Y axis where the normal is mostly
    along X), the second is normal x first. The point is first moved along the axis that the normal is nearest to,
    onto the parallel plane through the body's origin: without that a sphere about the origin would have the same
    coordinates everywhere. On a plane of any orientation the coordinates are lengths, and the same place always has
    the same coordinates.

    Args:
        point: in the body's own, metric space [m], shape (n, 3).
        normal: unit, shape (n, 3).

    Source: x_x and x_y of [S3] eq. 2; the frame is a decision of Dermis
    """
    out = np.empty((len(point), 2))
    size = np.abs(normal)
    main = np.argmax(size, axis=1)
    if (main == main[0]).all():
        return _along(point, normal, int(main[0]))
    for axis in range(3):
        chosen = np.flatnonzero(main == axis)
        if chosen.size:
            out[chosen] = _along(point[chosen], normal[chosen], axis)
    return out


def _along(point: Array, normal: Array, main: int) -> Array:
    """Coordinates where the normal is nearest to one body axis."""
    a, b = {0: (1, 2), 1: (0, 2), 2: (0, 1)}[main]
    # Laying axis a onto the tangent plane shortens it to `length`; e1 = (axis a - n_a n) / length.
    n_a, n_b, n_m = normal[:, a], normal[:, b], normal[:, main]
    length = np.sqrt(1.0 - n_a * n_a)
    first = point[:, a] / length
    # e2 = n x e1 has the components (along b) +-n_main / length; the point in the plane has x_b = e1_b u + e2_b w.
    handed = -1.0 if (main, a, b) == (1, 0, 2) else 1.0
    second = (point[:, b] + n_a * n_b / length * first) * length / (handed * n_m)
    return np.stack([first, second], axis=1)

"""Texture: a displacement along the direction of movement that depends on the place.

Source: [S3] eq. 2 and 3, after Campion et al. 2008.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
        if alpha.any() if isinstance(alpha, np.ndarray) else alpha != 0.0:
            if not ((length > 0.0).all() if isinstance(length, np.ndarray) else length > 0.0):
                raise DermisError("a texture's period must be above 0", value=float(np.min(length)), limit="> 0 m")
            wave = wave + alpha * np.sin(place[:, axis] * (2.0 * math.pi / length))
    return scaled(direction, -friction * wave)


@dataclass(frozen=True)
class Eased:
    """A texture that sets in and fades, up to some sample.

    Attributes:
        values: the last ones, shape (2 * samples,). felt: whether the last was felt. since: samples since that changed.
    """

    values: Array
    felt: bool
    since: int


def eased(
    values: Array, felt: NDArray[np.bool_], samples: int, before: Eased | None, index: int
) -> tuple[Array, Eased]:
    """Return a texture that sets in and fades over some samples, for a device that would knock where it jumps.

    It sets in as the rise of a cosine. Where it ends it goes on as its own reflection in its last point, and falls as
    that cosine: neither the displacement nor its speed jumps.

    Args:
        values: displacements along one axis, 0 where nothing is felt, shape (n,). felt: shape (n,).
        samples: how long it takes. before: the time before; None where nothing was felt.
        index: sample at which the state is wanted.

    Returns:
        shape (n,), and the state before the sample at `index`.
    """
    if before is None:
        before = Eased(np.zeros(2 * samples), False, samples)
    start = 2 * samples
    out = np.concatenate([before.values, values])
    edges = np.flatnonzero(np.diff(np.r_[before.felt, felt])).tolist()
    fall = 0.5 + 0.5 * np.cos(np.pi * np.arange(1, samples + 1) / samples)
    for k, end in zip([-before.since, *edges], [*edges, len(values)], strict=True):
        first, last = start + max(k, 0), start + min(k + samples, end)
        if first >= last:
            continue
        part = fall[max(-k, 0) :][: last - first]
        if felt[first - start]:
            out[first:last] *= 1.0 - part
        else:
            point = start + k - 1
            back = np.arange(first, last) - point
            out[first:last] = (2.0 * out[point] - out[point - back]) * part
    changed = [-before.since, *(k for k in edges if k < index)][-1]
    was = bool(felt[index - 1]) if index else before.felt
    return out[start:], Eased(out[index : index + start].copy(), was, min(index - changed, samples))


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

"""Texture: a displacement along the direction of movement.

The size of the displacement depends on the position on the surface.

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
    """Return the displacement of a texture.

    d = -mu (alpha_x sin(2 pi x_x / f_x) + alpha_y sin(2 pi x_y / f_y)) sigma(v_t)

    Args:
        place: coordinates on the surface (x_x, x_y) [m], shape (n, 2).
        direction: sigma, see `held_direction`, shape (n, k).
        friction: mu, one number or shape (n,).
        amplitude: alpha_x and alpha_y, fractions of the device's range, each one number or shape (n,).
        period: f_x and f_y [m], each one number or shape (n,). The paper divides by them, so they are spatial periods.

    Returns:
        displacement as a fraction of the device's range, shape (n, k).

    Raises:
        DermisError: a period is not above 0 although its amplitude is not 0.

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
    """State of a texture that is faded in and out, before some sample.

    Attributes:
        values: the last values before the sample, shape (2 * samples,).
        felt: whether the texture was felt at the last of them.
        since: number of samples since `felt` changed, at most `samples`.
    """

    values: Array
    felt: bool
    since: int


def eased(
    values: Array, felt: NDArray[np.bool_], samples: int, before: Eased | None, index: int
) -> tuple[Array, Eased]:
    """Return a texture that is faded in and out, and a state of it.

    A device would knock at a jump of the texture. The texture is therefore faded in by half a period of a cosine.
    Beyond its end, it is continued by its reflection in its last point and faded out by the same cosine. Neither the
    displacement nor its speed jumps.

    Args:
        values: displacements along one axis, 0 where nothing is felt, shape (n,).
        felt: whether the texture is felt, shape (n,).
        samples: duration of a fade in samples.
        before: state before the first sample; None if nothing was felt.
        index: sample before which the state is returned.

    Returns:
        the faded texture, shape (n,), and the state before the sample `index`.
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
    """Return sigma, the direction of movement, shape (n, k).

    While the speed is below the threshold, sigma is the direction of the last movement. It is zero before the first
    movement. With a threshold of 0, a speed of exactly 0 is still no movement.

    Args:
        velocity: tangential velocity [m/s], shape (n, k).
        threshold: smallest speed of a movement, k in the paper [m/s], one number or shape (n,).
        before: sigma before the first sample, shape (k,); None if there was no movement.

    Source: [S3] eq. 3
    """
    speed = np.sqrt(dot(velocity, velocity))
    moves = (speed >= threshold) & (speed > 0.0)
    if np.count_nonzero(moves) == moves.size:
        return scaled(velocity, 1.0 / speed)
    last = np.maximum.accumulate(np.where(moves, np.arange(len(speed)), -1))
    held = np.maximum(last, 0)
    scale = np.where(last >= 0, 1.0 / np.where(speed[held] > 0.0, speed[held], 1.0), 0.0)
    direction = scaled(velocity[held], scale)
    if before is not None:
        direction[last < 0] = before
    return direction


def tangential(velocity: Array, normal: Array) -> Array:
    """Return the part of velocities that is perpendicular to unit normals.

    Velocities, normals and the result have the shape (n, 3).
    """
    return velocity - scaled(normal, dot(velocity, normal))


def coordinates(point: Array, normal: Array) -> Array:
    """Return coordinates of points on a surface [m], shape (n, 2).

    They are coordinates in a frame of the tangent plane. Its first axis is the projection of the body's X axis onto the
    tangent plane, or of the body's Y axis if the normal is nearest to X. The second axis is normal x first axis.

    Each point is first moved along the body's axis that is nearest to the normal, until it is on the plane through the
    body's origin that is parallel to the tangent plane. Otherwise a sphere about the origin would have the same
    coordinates everywhere. On a plane of any orientation the coordinates are lengths, and a point always has the same
    coordinates.

    Args:
        point: points in the space of the body, in metres [m], shape (n, 3).
        normal: unit normals of the surface at the points, shape (n, 3).

    Source: x_x and x_y of [S3] eq. 2; the frame is a decision of Dermis
    """
    out = np.empty((len(point), 2))
    size = np.abs(normal)
    main = np.argmax(size, axis=1)
    if np.count_nonzero(main == main[0]) == main.size:
        return _along(point, normal, int(main[0]))
    for axis in range(3):
        chosen = np.flatnonzero(main == axis)
        if chosen.size:
            out[chosen] = _along(point[chosen], normal[chosen], axis)
    return out


def _along(point: Array, normal: Array, main: int) -> Array:
    """Return coordinates of points whose normals are nearest to axis `main`."""
    a, b = {0: (1, 2), 1: (0, 2), 2: (0, 1)}[main]
    # The projection of axis a onto the tangent plane has the length `length`; e1 = (axis a - n_a n) / length.
    n_a, n_b, n_m = normal[:, a], normal[:, b], normal[:, main]
    length = np.sqrt(1.0 - n_a * n_a)
    first = point[:, a] / length
    # Along b, e2 = n x e1 has the component +-n_main / length. The point e1 u + e2 w has x_b = e1_b u + e2_b w.
    handed = -1.0 if (main, a, b) == (1, 0, 2) else 1.0
    second = (point[:, b] + n_a * n_b / length * first) * length / (handed * n_m)
    return np.array([first, second]).T

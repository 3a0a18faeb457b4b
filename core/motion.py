"""Motion: poses sampled over time, made smooth enough to be differentiated twice.

Position is a cubic spline with not-a-knot ends, so a parabola (a falling body) keeps its acceleration to the very
first sample. Rotation is a cubic spline through the four components of the unit quaternions (signs made continuous),
normalised where it is read. Both are twice continuously differentiable and exact at the samples; velocity,
acceleration and angular velocity are the exact derivatives of what is interpolated, not differences.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .errors import DermisError
from .vectors import cross, dot, scaled

Array = NDArray[np.float64]

# Columns of a matrix count as orthogonal if the cosine between them is below this (Blender's matrices are float32).
ORTHOGONAL = 1e-5
# A matrix whose determinant is below this fraction of the product of its columns' lengths has no rotation.
SINGULAR = 1e-9


class Spline:
    """Cubic spline through samples of several values, with not-a-knot ends.

    Two samples give a straight line, three a parabola, one a constant. Beyond its ends it goes on as the end pieces.

    Args:
        times: strictly rising, shape (n,).
        values: shape (n, k).

    Raises:
        DermisError: no sample, times that do not rise, or values that are not finite.
    """

    def __init__(self, times: Array, values: Array) -> None:
        self.times = np.asarray(times, dtype=np.float64)
        self.values = np.asarray(values, dtype=np.float64)
        if len(self.times) == 0 or len(self.times) != len(self.values):
            raise DermisError("motion needs one pose per sample and at least one sample",
                              value=f"{len(self.times)} times, {len(self.values)} poses")  # fmt: skip
        if not np.isfinite(self.values).all():
            raise DermisError("motion has values that are not finite numbers")
        if len(self.times) > 1 and not (np.diff(self.times) > 0.0).all():
            raise DermisError("the times of a motion must rise")
        self.still = bool((self.values == self.values[0]).all())

    @cached_property
    def _pieces(self) -> tuple[Array, Array, Array, Array]:
        """Values, and coefficients of (t - t_i), its square and its cube, shape (k, n - 1) each: by component."""
        step = np.diff(self.times)[:, None]
        second = second_derivatives(self.times, self.values)
        slope = np.diff(self.values, axis=0) / step - step * (2.0 * second[:-1] + second[1:]) / 6.0
        parts = self.values[:-1], slope, second[:-1] / 2.0, np.diff(second, axis=0) / (6.0 * step)
        value, slope, square, cube = (np.ascontiguousarray(p.T) for p in parts)
        return value, slope, square, cube

    def piece(self, t: Array) -> tuple[NDArray[np.intp], Array]:
        """Return for each time the index of its piece, and the time since that piece began, shapes (m,)."""
        last = max(len(self.times) - 2, 0)
        index = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, last)
        return index, t - self.times[index]

    def at(self, t: Array, order: int = 0, piece: tuple[NDArray[np.intp], Array] | None = None) -> Array:
        """Return the values (`order` 0), or their first or second derivative, at times [s], shape (m, k)."""
        if self.still:
            shape = (len(t), self.values.shape[1])
            return np.broadcast_to(self.values[0] if order == 0 else np.zeros(shape[1]), shape)
        if order not in (0, 1, 2):
            raise ValueError("a spline has two derivatives")
        index, u = self.piece(t) if piece is None else piece
        # Horner, with the factors that differentiation brings down
        out = self._pieces[3].take(index, axis=1)
        out *= (1.0, 3.0, 6.0)[order]
        for power in range(2, order - 1, -1):
            out *= u
            out += ((1.0, 1.0, 1.0), (0.0, 1.0, 2.0), (0.0, 0.0, 2.0))[order][power] * self._pieces[power].take(
                index, axis=1
            )
        return out.T


class Motion:
    """A smooth motion through sampled poses.

    Args:
        times: [s], strictly rising, shape (n,). One sample means at rest, two mean uniform speed.
        poses: object-to-world matrices of any invertible scale, shape (n, 4, 4).

    Raises:
        DermisError: see `Spline` and `rotations`.
    """

    def __init__(self, times: Array, poses: Array) -> None:
        self.times = np.asarray(times, dtype=np.float64)
        self.positions = Spline(self.times, poses[:, :3, 3])
        self._linear = poses[:, :3, :3]

    @cached_property
    def rotations(self) -> Spline:
        """The spline through the unit quaternions (w, x, y, z)."""
        if (self._linear == self._linear[0]).all():
            one = quaternions(rotations(self._linear[:1]))
            return Spline(self.times, np.repeat(one, len(self.times), axis=0))
        return Spline(self.times, continuous(quaternions(rotations(self._linear))))

    def at(self, t: Array) -> MotionSamples:
        """Return the motion at times [s], shape (m,); each quantity is computed when it is first read."""
        return MotionSamples(self, np.asarray(t, dtype=np.float64))


class MotionSamples:
    """A motion at given times: position, rotation and their rates, each computed when first read.

    Attributes:
        times: [s], shape (m,).
    """

    def __init__(self, motion: Motion, times: Array) -> None:
        self.times = times
        self._motion = motion
        self._piece = motion.positions.piece(times)

    @cached_property
    def position(self) -> Array:
        """[m], shape (m, 3)."""
        return self._motion.positions.at(self.times, 0, self._piece)

    @cached_property
    def velocity(self) -> Array:
        """[m/s], shape (m, 3)."""
        return self._motion.positions.at(self.times, 1, self._piece)

    @cached_property
    def acceleration(self) -> Array:
        """[m/s^2], shape (m, 3)."""
        return self._motion.positions.at(self.times, 2, self._piece)

    @cached_property
    def turns(self) -> bool:
        """Whether the rotation changes at all."""
        return not self._motion.rotations.still

    @cached_property
    def rotation(self) -> Array:
        """Object-to-world rotation matrices, shape (m, 3, 3)."""
        if not self.turns:
            return np.broadcast_to(matrices(self._motion.rotations.values[:1])[0], (len(self.times), 3, 3))
        return matrices(self._quaternion)

    @cached_property
    def angular_velocity(self) -> Array:
        """In world axes [rad/s], shape (m, 3)."""
        if not self.turns:
            return np.zeros((len(self.times), 3))
        # For q not of unit length the vector part of q' q* / |q|^2 is that of its normalised form.
        q = self._quaternion
        p = self._motion.rotations.at(self.times, 1, self._piece)
        w, v = q[:, 0], q[:, 1:]
        rate = scaled(p[:, 1:], w) - scaled(v, p[:, 0]) - cross(p[:, 1:], v)
        return scaled(rate, 2.0 / dot(q, q))

    @cached_property
    def _quaternion(self) -> Array:
        return self._motion.rotations.at(self.times, 0, self._piece)


def second_derivatives(times: Array, values: Array) -> Array:
    """Return the second derivatives of the not-a-knot cubic spline at its knots, shape (n, k)."""
    n = len(times)
    second = np.zeros_like(values)
    if n < 3:
        return second
    step = np.diff(times)
    slope = np.diff(values, axis=0) / step[:, None]
    if n == 3:
        second[:] = 2.0 * (slope[1] - slope[0]) / (times[2] - times[0])
        return second
    lower, diagonal, upper = step[:-1].copy(), 2.0 * (step[:-1] + step[1:]), step[1:].copy()
    # Not-a-knot: the third derivative does not jump at the second and the last but one sample.
    first, next_, last, before = step[0], step[1], step[-1], step[-2]
    diagonal[0] += first * (first + next_) / next_
    upper[0] -= first * first / next_
    diagonal[-1] += last * (last + before) / before
    lower[-1] -= last * last / before
    second[1:-1] = solve_tridiagonal(lower, diagonal, upper, 6.0 * np.diff(slope, axis=0))
    second[0] = second[1] + (second[1] - second[2]) * (first / next_)
    second[-1] = second[-2] + (second[-2] - second[-3]) * (last / before)
    return second


def solve_tridiagonal(lower: Array, diagonal: Array, upper: Array, right: Array) -> Array:
    """Solve a diagonally dominant tridiagonal system by parallel cyclic reduction.

    Each step couples rows twice as far apart and squares the couplings, which therefore vanish after about six
    steps: whole-array operations instead of a loop over rows.

    Args:
        lower, diagonal, upper: shape (n,); lower[0] and upper[-1] are not used.
        right: right-hand sides, shape (n, k).
    """
    a, c, x = -lower / diagonal, -upper / diagonal, right / diagonal[:, None]
    a[0] = c[-1] = 0.0
    shift = 1
    while shift < len(a) and max(np.abs(a).max(), np.abs(c).max()) > 1e-18:
        ahead, behind = a[shift:], c[:-shift]
        scale = np.ones_like(a)
        scale[shift:] -= ahead * behind
        scale[:-shift] -= behind * ahead
        summed = x.copy()
        summed[shift:] += ahead[:, None] * x[:-shift]
        summed[:-shift] += behind[:, None] * x[shift:]
        a_next, c_next = np.zeros_like(a), np.zeros_like(c)
        a_next[shift:] = ahead * a[:-shift]
        c_next[:-shift] = behind * c[shift:]
        a, c, x = a_next / scale, c_next / scale, summed / scale[:, None]
        shift *= 2
    return x


def rotations(linear: Array) -> Array:
    """Return the rotations nearest to linear maps, shape (n, 3, 3).

    A mirrored map (negative determinant) gives the rotation that is left after a mirror through the origin.

    Raises:
        DermisError: a map without an inverse, such as one of scale 0.
    """
    columns, volume = _columns(linear)
    if not (np.abs(volume) > SINGULAR).all():
        raise DermisError("a pose of scale 0 has no direction", limit="a scale other than 0")
    x, y, z = columns
    skew = np.maximum(np.maximum(np.abs(dot(x, y)), np.abs(dot(y, z))), np.abs(dot(z, x)))
    out = np.empty((3, 3, len(linear)))
    side = np.sign(volume)
    for j, column in enumerate(columns):
        np.multiply(column.T, side, out=out[:, j])
    unit = np.moveaxis(out, -1, 0)
    sheared = np.flatnonzero(skew > ORTHOGONAL)
    if sheared.size:
        left, _, right = np.linalg.svd(linear[sheared])
        unit[sheared] = left @ right * side[sheared, None, None]
    return unit


def singular(linear: Array) -> NDArray[np.bool_]:
    """Return which of the linear maps (n, 3, 3) have no inverse to speak of, shape (n,)."""
    return ~(np.abs(_columns(linear)[1]) > SINGULAR)


def _columns(linear: Array) -> tuple[list[Array], Array]:
    """Unit columns, (n, 3) each, and the signed volume that they span, shape (n,); NaN at scale 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        columns = [scaled(linear[:, :, j], 1.0 / np.sqrt(dot(linear[:, :, j], linear[:, :, j]))) for j in range(3)]
    return columns, dot(columns[0], cross(columns[1], columns[2]))


def quaternions(matrix: Array) -> Array:
    """Return unit quaternions (w, x, y, z) of rotation matrices (n, 3, 3), shape (n, 4)."""
    xx, yy, zz = matrix[:, 0, 0], matrix[:, 1, 1], matrix[:, 2, 2]
    squares = np.stack([1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz], axis=1)
    largest = np.argmax(squares, axis=1)  # dividing by the largest component loses no digits
    products = np.empty((len(matrix), 4, 4))
    for i in range(4):
        products[:, i, i] = squares[:, i]
    for i, j, k in ((1, 3, 2), (2, 1, 3), (3, 2, 1)):
        products[:, 0, i] = products[:, i, 0] = matrix[:, j - 1, k - 1] - matrix[:, k - 1, j - 1]
    for i, j in ((1, 2), (2, 3), (3, 1)):
        products[:, i, j] = products[:, j, i] = matrix[:, i - 1, j - 1] + matrix[:, j - 1, i - 1]
    row = products[np.arange(len(matrix)), largest]
    return row / np.sqrt(np.einsum("ij,ij->i", row, row))[:, None]


def continuous(quaternion: Array) -> Array:
    """Return the quaternions with signs such that each is nearest to the one before."""
    turns = np.einsum("ij,ij->i", quaternion[1:], quaternion[:-1]) < 0.0
    sign = np.cumprod(np.concatenate([[1.0], np.where(turns, -1.0, 1.0)]))
    return quaternion * sign[:, None]


def matrices(quaternion: Array) -> Array:
    """Return rotation matrices (n, 3, 3) of quaternions (w, x, y, z) of any length above zero, shape (n, 4)."""
    w, x, y, z = scaled(quaternion, math.sqrt(2.0) / np.sqrt(dot(quaternion, quaternion))).T
    out = np.empty((3, 3, len(w)))
    xx, yy, zz = x * x, y * y, z * z
    out[0, 0], out[1, 1], out[2, 2] = 1.0 - (yy + zz), 1.0 - (xx + zz), 1.0 - (xx + yy)
    for i, j, a, b in ((0, 1, x * y, w * z), (1, 2, y * z, w * x), (2, 0, x * z, w * y)):
        np.subtract(a, b, out=out[i, j])
        np.add(a, b, out=out[j, i])
    return np.moveaxis(out, -1, 0)

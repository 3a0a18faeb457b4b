"""Cubic splines through samples, twice differentiable, without a loop over samples."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError


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
            raise DermisError(
                "motion needs one pose per sample and at least one sample",
                value=f"{len(self.times)} times, {len(self.values)} poses",
            )
        if not np.isfinite(self.values).all():
            raise DermisError("motion has values that are not finite numbers")
        if not (self.times[1:] > self.times[:-1]).all():
            raise DermisError("the times of a motion must rise")
        self.still = bool((self.values == self.values[0]).all())
        self._within: tuple[Spline, slice] | None = None  # the one that it is solved with, and its columns there

    def part(self, columns: slice) -> Spline:
        """Return the spline through some of the columns; it is solved with all of them, where it is needed."""
        part = Spline.__new__(Spline)
        part.times, part.values = self.times, self.values[:, columns]
        part.still = bool((part.values == part.values[0]).all())
        part._within = self, columns
        return part

    @cached_property
    def _pieces(self) -> tuple[Array, Array, Array, Array]:
        """Values, and coefficients of (t - t_i), its square and its cube, shape (k, n - 1) each: by component."""
        if self._within is not None:
            whole, columns = self._within
            value, slope, square, cube = (part[columns] for part in whole._pieces)
            return value, slope, square, cube
        times, values = self.times, self.values
        step = (times[1:] - times[:-1])[:, None]
        second = second_derivatives(times, values)
        slope = (values[1:] - values[:-1]) / step - step * (2.0 * second[:-1] + second[1:]) / 6.0
        parts = values[:-1], slope, second[:-1] / 2.0, (second[1:] - second[:-1]) / (6.0 * step)
        value, slope, square, cube = (np.ascontiguousarray(p.T) for p in parts)
        return value, slope, square, cube

    def piece(self, t: Array) -> tuple[NDArray[np.intp], Array]:
        """Return for each time the index of its piece, and the time since that piece began, shapes (m,)."""
        index = np.searchsorted(self.times[1:-1], t, side="right")
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


def second_derivatives(times: Array, values: Array) -> Array:
    """Return the second derivatives of the not-a-knot cubic spline at its knots, shape (n, k)."""
    n = len(times)
    second = np.zeros_like(values)
    if n < 3:
        return second
    step = times[1:] - times[:-1]
    slope = (values[1:] - values[:-1]) / step[:, None]
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
    second[1:-1] = solve_tridiagonal(lower, diagonal, upper, 6.0 * (slope[1:] - slope[:-1]))
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

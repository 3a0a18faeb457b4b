"""Cubic splines through samples, twice continuously differentiable."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError

# By the order of a derivative: factors of the coefficients that remain.
FACTORS = tuple(np.array(row)[:, None, None] for row in ((1.0, 1.0, 1.0, 1.0), (1.0, 2.0, 3.0), (2.0, 6.0)))
READ = 3  # number of arrays of times whose pieces are stored: times of the samples, and of devices at two rates


class Knots:
    """Times of the samples of one or more splines.

    All that depends on these times alone is computed once for all splines.

    Args:
        times: strictly rising, shape (n,).

    Raises:
        DermisError: the times do not rise.
    """

    def __init__(self, times: Array) -> None:
        self.times = np.asarray(times, dtype=np.float64)
        if not (self.times[1:] > self.times[:-1]).all():
            raise DermisError("the times of a motion must rise")
        self._known: list[tuple[Array, tuple[NDArray[np.intp], Array]]] = []

    def piece(self, t: Array) -> tuple[NDArray[np.intp], Array]:
        """Return the piece of each time, and the time since the piece began.

        A piece is given by its index. Both results have shape (m,). The results for the last few arrays `t` are stored,
        because several splines are evaluated at the same times. They are found by the identity of the array.
        """
        for known, found in self._known:
            if known is t:
                return found
        index = np.searchsorted(self.times[1:-1], t, side="right")
        made = index, t - self.times[index]
        self._known.append((t, made))
        del self._known[:-READ]
        return made

    @cached_property
    def steps(self) -> Array:
        """Time from each sample to the next [s], shape (n - 1,)."""
        return np.asarray(self.times[1:] - self.times[:-1])

    @cached_property
    def system(self) -> Tridiagonal:
        """Equations of the inner second derivatives of a not-a-knot spline.

        They exist for four samples or more.
        """
        step = self.steps
        lower, diagonal, upper = step[:-1].copy(), 2.0 * (step[:-1] + step[1:]), step[1:].copy()
        # Not-a-knot: the third derivative does not jump at the second and the last but one sample.
        first, next_, last, before = step[0], step[1], step[-1], step[-2]
        diagonal[0] += first * (first + next_) / next_
        upper[0] -= first * first / next_
        diagonal[-1] += last * (last + before) / before
        lower[-1] -= last * last / before
        return Tridiagonal.of(lower, diagonal, upper)


class Spline:
    """Cubic spline through samples of several values, with not-a-knot ends.

    One sample gives a constant, two give a straight line, and three a parabola. Beyond the ends, the first and the last
    piece are continued.

    Args:
        times: strictly rising, shape (n,), or the knots of other splines.
        values: values at the samples, shape (n, k).

    Raises:
        DermisError: there is no sample, the times do not rise, or values are not finite.
    """

    def __init__(self, times: Array | Knots, values: Array) -> None:
        self.values = np.asarray(values, dtype=np.float64)
        count = len(times.times if isinstance(times, Knots) else times)
        if count == 0 or count != len(self.values):
            raise DermisError(
                "motion needs one pose per sample and at least one sample",
                value=f"{count} times, {len(self.values)} poses",
            )
        if np.count_nonzero(np.isfinite(self.values)) < self.values.size:
            raise DermisError("motion has values that are not finite numbers")
        self.knots = times if isinstance(times, Knots) else Knots(times)
        self._stay: list[bool] = (self.values == self.values[0]).all(axis=0).tolist()  # whether each column is constant
        self.still = all(self._stay)
        self._within: tuple[Spline, slice] | None = None  # spline of which this is a part, and its columns there

    @property
    def times(self) -> Array:
        """Times of the samples, shape (n,)."""
        return self.knots.times

    def part(self, columns: slice) -> Spline:
        """Return the spline through some of the columns.

        All columns are solved together when one of them is first evaluated.
        """
        part = Spline.__new__(Spline)
        part.knots, part.values, part._stay = self.knots, self.values[:, columns], self._stay[columns]
        part.still = all(part._stay)
        part._within = self, columns
        return part

    @cached_property
    def _pieces(self) -> Array:
        """Values, and coefficients of (t - t_i), its square and its cube, shape (4, k, n - 1)."""
        if self._within is not None:
            whole, columns = self._within
            return whole._pieces[:, columns]
        values, step = self.values, self.knots.steps[:, None]
        second = second_derivatives(self.knots, values)
        slope = (values[1:] - values[:-1]) / step - step * (2.0 * second[:-1] + second[1:]) / 6.0
        out = np.empty((4, values.shape[1], len(step)))
        out[0], out[1] = values[:-1].T, slope.T
        np.divide(second[:-1].T, 2.0, out=out[2])
        np.divide((second[1:] - second[:-1]).T, (6.0 * step).T, out=out[3])
        return out

    def piece(self, t: Array) -> tuple[NDArray[np.intp], Array]:
        """Return the piece of each time, and the time since the piece began.

        See `Knots.piece`.
        """
        return self.knots.piece(t)

    def at(self, t: Array, order: int = 0, piece: tuple[NDArray[np.intp], Array] | None = None) -> Array:
        """Return the spline or a derivative at given times, shape (m, k).

        Args:
            t: the times, shape (m,).
            order: 0 for the values, 1 and 2 for the first and second derivative.
            piece: result of `piece` for these times, if it is known.
        """
        if self.still:
            shape = (len(t), self.values.shape[1])
            return np.broadcast_to(self.values[0] if order == 0 else np.zeros(shape[1]), shape)
        if order not in (0, 1, 2):
            raise ValueError("a spline has two derivatives")
        index, u = self.piece(t) if piece is None else piece
        # Horner's scheme, with the factors that come from differentiation.
        *parts, out = self._factored(order).take(index, axis=2)
        for part in reversed(parts):
            out *= u
            out += part
        return np.asarray(out.T)

    def _factored(self, order: int) -> Array:
        """Return the coefficients of a derivative, from the constant one on, shape (4 - order, k, n - 1)."""
        return self._pieces[order:] * FACTORS[order] if order else self._pieces


def second_derivatives(times: Array | Knots, values: Array) -> Array:
    """Return the second derivatives of the not-a-knot spline at its knots.

    Args:
        times: strictly rising, shape (n,), or the knots.
        values: values at the knots, shape (n, k).

    Returns:
        Second derivatives, shape (n, k).
    """
    knots = times if isinstance(times, Knots) else Knots(times)
    n, second = len(knots.times), np.zeros(values.shape)
    if n < 3:
        return second
    step = knots.steps
    slope = (values[1:] - values[:-1]) / step[:, None]
    if n == 3:
        second[:] = 2.0 * (slope[1] - slope[0]) / (knots.times[2] - knots.times[0])
        return second
    second[1:-1] = knots.system.solved(6.0 * (slope[1:] - slope[:-1]))
    second[0] = second[1] + (second[1] - second[2]) * (step[0] / step[1])
    second[-1] = second[-2] + (second[-2] - second[-3]) * (step[-1] / step[-2])
    return second


class Tridiagonal(NamedTuple):
    """Diagonally dominant tridiagonal system, ready for repeated solution.

    It is solved by parallel cyclic reduction. Each step doubles the distance between coupled rows, and squares the
    couplings. The couplings therefore vanish after about six steps. The steps are operations on whole arrays, in place
    of a loop over rows.

    Attributes:
        diagonal: main diagonal, shape (n, 1).
        steps: for each step: distance `shift` between coupled rows; couplings to the row before and to the row after,
            shape (n - shift, 1) each; scale, shape (n, 1).
    """

    diagonal: Array
    steps: tuple[tuple[int, Array, Array, Array], ...]

    @classmethod
    def of(cls, lower: Array, diagonal: Array, upper: Array) -> Tridiagonal:
        """Prepare a system.

        Args:
            lower, diagonal, upper: the diagonals, shape (n,); lower[0] and upper[-1] are not used.
        """
        a, c = -lower / diagonal, -upper / diagonal
        a[0] = c[-1] = 0.0
        steps, shift = [], 1
        while shift < len(a) and max(np.abs(a).max(), np.abs(c).max()) > 1e-18:
            ahead, behind = a[shift:], c[:-shift]
            scale = np.ones(len(a))
            scale[shift:] -= ahead * behind
            scale[:-shift] -= behind * ahead
            steps.append((shift, ahead[:, None], behind[:, None], scale[:, None]))
            a_next, c_next = np.zeros(len(a)), np.zeros(len(c))
            a_next[shift:] = ahead * a[:-shift]
            c_next[:-shift] = behind * c[shift:]
            a, c = a_next / scale, c_next / scale
            shift *= 2
        return cls(diagonal[:, None], tuple(steps))

    def solved(self, right: Array) -> Array:
        """Return the solutions for right-hand sides, shape (n, k) each."""
        x: Array = right / self.diagonal
        for shift, ahead, behind, scale in self.steps:
            summed = x.copy()
            summed[shift:] += ahead * x[:-shift]
            summed[:-shift] += behind * x[shift:]
            x = summed / scale
        return x


def solve_tridiagonal(lower: Array, diagonal: Array, upper: Array, right: Array) -> Array:
    """Solve a diagonally dominant tridiagonal system.

    Args:
        lower, diagonal, upper: shape (n,); lower[0] and upper[-1] are not used.
        right: right-hand sides, shape (n, k).
    """
    return Tridiagonal.of(lower, diagonal, upper).solved(right)

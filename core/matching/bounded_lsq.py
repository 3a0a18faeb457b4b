"""Bounded least squares: min 1/2 x'Hx - c'x with low <= x <= high, warm along a track, with a certificate.

Block principal pivoting keeps a guess of which variables sit on a bound and flips every one whose sign is wrong.
Along a track the guess of the frame before is nearly always right, and then a solve is one triangular
back-substitution and one matrix-vector product. Where flipping all at once stops reducing the number of wrong
signs, a primal active set takes over: it walks through feasible points of falling cost and therefore ends.

Source: Judice & Pires 1994, block principal pivoting for strictly monotone LCPs; Stark & Parker 1995, BVLS.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError

Array = NDArray[np.float64]

SIGN_TOLERANCE = 1e-13  # of the largest gradient or bound: below it a sign counts as right
MAX_BLOCK_TRIES = 6  # block exchanges without progress before the primal active set takes over
MAX_PIVOTS = 3000
FACTORS_KEPT = 64
PROXIMAL_WEIGHT = 1e-7  # of the mean diagonal: makes a singular H definite; removed again by proximal steps
MAX_PROXIMAL_STEPS = 200
PROXIMAL_TOLERANCE = 1e-13


@dataclass(frozen=True, slots=True)
class BoundedSolution:
    """A solution with what is needed to verify it.

    Attributes:
        x: the minimiser, shape (n,).
        gradient: Hx - c, shape (n,).
        status: -1 at the lower bound, 0 free, +1 at the upper bound, shape (n,), int8.
        pivots: how often the guess of the active bounds was changed.
        converged: False where the pivots ran out; x is then feasible but not optimal.
        scale: what a gradient is compared with, max |c| + max |H| max |x|.
    """

    x: Array
    gradient: Array
    status: NDArray[np.int8]
    pivots: int
    converged: bool
    scale: float

    def optimality(self, low: Any, high: Any) -> float:
        """Return the KKT residual relative to the problem's scale: 0 at an exact minimum.

        It is the largest of: gradient of free variables, gradient of the wrong sign at a bound, and bound violation.
        A variable counts as free where it lies strictly between its bounds, whatever `status` says.
        """
        x, g = self.x, self.gradient
        low, high = np.broadcast_to(low, x.shape), np.broadcast_to(high, x.shape)
        at_low, at_high = x <= low, x >= high
        wrong = np.where(at_low & at_high, 0.0, np.where(at_low, -g, np.where(at_high, g, np.abs(g))))
        violation = np.maximum(low - x, x - high).max(initial=0.0)
        span = max(float(np.abs(low).max(initial=0.0)), float(np.abs(high).max(initial=0.0)), 1e-300)
        return float(max(wrong.max(initial=0.0) / max(self.scale, 1e-300), violation / span))


@dataclass(frozen=True, slots=True)
class _Factor:
    free: NDArray[np.intp]
    cholesky: Array  # upper factor of H[free, free], Fortran order
    columns: Array  # H[:, free], Fortran order
    sign: Array  # +1 at the lower bound, -1 at the upper, 0 free
    fixed: Array  # x at the bounds, 0 where free
    base: Array  # H @ fixed
    low: Array  # bounds of the free variables
    high: Array


class BoundedLeastSquares:
    """One Gram matrix and its bounds, solved for many right-hand sides.

    Args:
        gram: H, symmetric and positive semi-definite, shape (n, n).
        low, high: bounds, numbers or shape (n,), low <= high, finite.

    Raises:
        DermisError: H is not square, symmetric, finite and positive semi-definite, or the bounds are crossed.
    """

    def __init__(self, gram: Array, low: Any, high: Any) -> None:
        from scipy.linalg import lapack

        self._potrf, self._potrs = lapack.dpotrf, lapack.dpotrs
        gram = np.array(gram, dtype=np.float64, order="F")
        if gram.ndim != 2 or gram.shape[0] != gram.shape[1]:
            raise DermisError("the Gram matrix must be square", where="bounded least squares", value=gram.shape)
        if not np.isfinite(gram).all():
            raise DermisError("the Gram matrix has values that are not finite", where="bounded least squares")
        self._size = float(np.abs(gram).max(initial=0.0))
        if np.abs(gram - gram.T).max(initial=0.0) > 1e-9 * self._size:
            raise DermisError(
                "the Gram matrix is not symmetric",
                where="bounded least squares",
                value=float(np.abs(gram - gram.T).max()),
                limit=f"{1e-9 * self._size:.3g}",
            )
        self.gram = gram
        self.n = len(gram)
        self._set_bounds(low, high)
        self._proximal = 0.0
        if self.n and self._potrf(gram)[1] != 0:
            self._proximal = PROXIMAL_WEIGHT * max(float(np.trace(gram)) / self.n, 1e-300)
            if self._potrf(self._definite())[1] != 0:
                raise DermisError(
                    "the Gram matrix is not positive semi-definite",
                    where="bounded least squares",
                    value=float(np.linalg.eigvalsh(gram)[0]),
                    limit=">= 0",
                )
        self._solved = self._definite() if self._proximal else gram
        self._status = np.full(self.n, -1, dtype=np.int8)
        self._factors: OrderedDict[bytes, _Factor] = OrderedDict()

    def solve(
        self, c: Array, *, low: Any = None, high: Any = None, start: NDArray[np.int8] | None = None
    ) -> BoundedSolution:
        """Minimise 1/2 x'Hx - c'x within the bounds, starting from the active bounds of the call before.

        Args:
            c: right-hand side, shape (n,).
            low, high: bounds for this and later calls, where they change (slew limits).
            start: active bounds to start from, as in `BoundedSolution.status`.

        Raises:
            DermisError: c has another shape or values that are not finite.
        """
        c = np.asarray(c, dtype=np.float64)
        if c.shape != (self.n,):
            raise DermisError(
                "the right-hand side does not fit", where="bounded least squares", value=c.shape, limit=f"({self.n},)"
            )
        largest = float(np.abs(c).max(initial=0.0))
        if not largest < np.inf:
            raise DermisError("the right-hand side is not finite", where="bounded least squares")
        if low is not None or high is not None:
            self._set_bounds(self.low if low is None else low, self.high if high is None else high)
            self._factors.clear()
        if start is not None:
            self._status = np.array(start, dtype=np.int8)
        scale = largest + self._size * self._span
        if not self._proximal:
            return self._pivot(c, scale)
        return self._proximal_steps(c, scale)

    def _pivot(self, c: Array, scale: float) -> BoundedSolution:
        status, tolerance, slack = self._status, SIGN_TOLERANCE * scale, SIGN_TOLERANCE * self._span
        fewest, tries, pivots = self.n + 1, MAX_BLOCK_TRIES, 0
        while True:
            factor = self._factor(status)
            inner, gradient = self._stationary(factor, c)
            below, above = inner - factor.low, factor.high - inner
            signed = gradient * factor.sign
            if (
                not below.min(initial=0.0) < -slack
                and not above.min(initial=0.0) < -slack
                and not signed.min(initial=0.0) < -tolerance
            ):
                break
            if tries == 0:
                return self._primal(c, scale, factor, inner, pivots)
            pivots += 1
            wrong = signed < -tolerance
            to_low, to_high = factor.free[below < -slack], factor.free[above < -slack]
            count = int(wrong.sum()) + len(to_low) + len(to_high)
            fewest, tries = (count, MAX_BLOCK_TRIES) if count < fewest else (fewest, tries - 1)
            status = status.copy()
            status[wrong], status[to_low], status[to_high] = 0, -1, 1
        self._status = status
        x = factor.fixed.copy()
        # a free variable may lie past its bound by no more than the tolerance of its sign
        x[factor.free] = np.minimum(np.maximum(inner, factor.low), factor.high)
        return BoundedSolution(x, gradient, status, pivots, True, scale)

    def _stationary(self, factor: _Factor, c: Array) -> tuple[Array, Array]:
        """Minimise over the free variables alone; return them and the gradient of all."""
        if not len(factor.free):
            return _EMPTY, factor.base - c
        inner = self._potrs(factor.cholesky, c.take(factor.free) - factor.base.take(factor.free))[0]
        gradient = factor.columns @ inner
        gradient += factor.base
        gradient -= c
        return inner, gradient

    def _primal(self, c: Array, scale: float, factor: _Factor, inner: Array, pivots: int) -> BoundedSolution:
        """Walk through feasible points of falling cost, one bound at a time, until every sign is right."""
        x = factor.fixed.copy()
        x[factor.free] = np.clip(inner, factor.low, factor.high)
        status = np.where(x <= self.low, -1, np.where(x >= self.high, 1, 0)).astype(np.int8)
        converged, blocked = False, np.zeros(self.n, dtype=bool)
        while pivots < MAX_PIVOTS:
            pivots += 1
            factor = self._factor(status)
            inner, gradient = self._stationary(factor, c)
            step = inner - x[factor.free]
            with np.errstate(divide="ignore", invalid="ignore"):
                bound = np.where(step < 0, factor.low, factor.high)
                reach = np.where(step != 0.0, (bound - x[factor.free]) / step, np.inf)
            length = float(reach.min(initial=np.inf))
            if length < 1.0:  # the first bound on the way becomes active
                hit = reach <= length
                x[factor.free] += length * step
                x[factor.free[hit]] = bound[hit]
                status = status.copy()
                status[factor.free[hit]] = np.where(step[hit] < 0, -1, 1)
                blocked[factor.free[hit]] = True
                if length > 0.0:
                    blocked[:] = False
                    blocked[factor.free[hit]] = True
                continue
            x[factor.free] = inner
            signed = np.where(blocked, 0.0, gradient * factor.sign)
            if not signed.min(initial=0.0) < -SIGN_TOLERANCE * scale:
                converged = not (gradient * factor.sign).min(initial=0.0) < -10 * SIGN_TOLERANCE * scale
                if converged or not blocked.any():
                    break
                blocked[:] = False
                continue
            status = status.copy()
            status[int(np.argmin(signed))] = 0
        self._status = status
        return BoundedSolution(x, self._solved @ x - c, status, pivots, converged, scale)

    def _proximal_steps(self, c: Array, scale: float) -> BoundedSolution:
        """Solve with H + w I and c + w x until x stands still: the minimiser for H itself, which is singular."""
        x, pivots = np.clip(np.zeros(self.n), self.low, self.high), 0
        for _ in range(MAX_PROXIMAL_STEPS):
            inner = self._pivot(c + self._proximal * x, scale)
            pivots += inner.pivots
            step = float(np.abs(inner.x - x).max(initial=0.0))
            x = inner.x
            if self._proximal * step <= PROXIMAL_TOLERANCE * scale:
                break
        gradient = self.gram @ x - c
        converged = inner.converged and self._proximal * step <= PROXIMAL_TOLERANCE * scale
        return BoundedSolution(x, gradient, inner.status, pivots, converged, scale)

    def _factor(self, status: NDArray[np.int8]) -> _Factor:
        key = status.tobytes()
        factor = self._factors.get(key)
        if factor is not None:
            return factor
        free = np.flatnonzero(status == 0)
        columns = self._solved.take(free, axis=1)
        cholesky, info = self._potrf(columns.take(free, axis=0), overwrite_a=0)
        if len(free) and info != 0:
            raise DermisError(
                "the Gram matrix is not positive definite on the free variables", where="bounded least squares"
            )
        fixed = np.where(status < 0, self.low, np.where(status > 0, self.high, 0.0))
        factor = _Factor(
            free,
            cholesky,
            np.asfortranarray(columns),
            -status.astype(np.float64),
            fixed,
            self._solved @ fixed,
            self.low[free],
            self.high[free],
        )
        self._factors[key] = factor
        if len(self._factors) > FACTORS_KEPT:
            self._factors.popitem(last=False)
        return factor

    def _set_bounds(self, low: Any, high: Any) -> None:
        self.low = np.array(np.broadcast_to(low, (self.n,)), dtype=np.float64)
        self.high = np.array(np.broadcast_to(high, (self.n,)), dtype=np.float64)
        bad = np.flatnonzero(~(self.low <= self.high) | ~np.isfinite(self.low) | ~np.isfinite(self.high))
        if len(bad):
            i = int(bad[0])
            raise DermisError(
                "bounds must be finite and not crossed",
                where=f"bounded least squares, variable {i}",
                value=f"{self.low[i]} to {self.high[i]}",
            )
        self._span = max(float(np.abs(self.low).max(initial=0.0)), float(np.abs(self.high).max(initial=0.0)))

    def _definite(self) -> Array:
        definite = self.gram.copy(order="F")
        definite[np.diag_indices(self.n)] += self._proximal
        return definite


_EMPTY = np.zeros(0)


def bounded_least_squares(gram: Array, c: Array, low: Any, high: Any) -> BoundedSolution:
    """Minimise 1/2 x'Hx - c'x with low <= x <= high once.

    Args and errors: as `BoundedLeastSquares` and its `solve`.
    """
    return BoundedLeastSquares(gram, low, high).solve(c)

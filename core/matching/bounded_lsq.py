"""Bounded least squares: min 1/2 x'Hx - c'x with low <= x <= high.

Block principal pivoting starts from a guess of the active set and exchanges all variables whose sign is wrong at once.
Along a track, the active set of the previous frame is nearly always right. A solve is then one triangular
back-substitution and one matrix-vector product. After an exchange, the free variables are solved for the step from the
previous point. If exchanges no longer reduce the number of wrong signs, a primal active-set method takes over. It
passes through feasible points of falling cost and therefore terminates.

Source: Judice & Pires 1994, block principal pivoting for strictly monotone LCPs; Stark & Parker 1995, BVLS.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError
from ..recent import Recent
from .active_bounds import ActiveBounds, Box
from .bounded_input import WHERE, statuses_of

__all__ = ["BoundedLeastSquares", "BoundedSolution"]


class BoundedSolution(NamedTuple):
    """Minimiser of 1/2 x'Hx - c'x within bounds, with the quantities that verify it.

    Attributes:
        x: the minimiser, shape (n,).
        gradient: Hx - c, shape (n,).
        status: -1 at the lower bound, 0 free, +1 at the upper bound, shape (n,), int8.
        pivots: number of changes of the active set.
        converged: False if the solver reached its largest number of pivots or steps; x is then feasible, not optimal.
        scale: reference of the gradient, max |c| + max |H| max |x|.
    """

    x: Array
    gradient: Array
    status: NDArray[np.int8]
    pivots: int
    converged: bool
    scale: float

    def optimality(self, low: Any, high: Any) -> float:
        """Return the KKT residual relative to the problem's scale; 0 at an exact minimum.

        It is the largest of three values: the gradient of a free variable, a gradient of the wrong sign at a bound, and
        the violation of a bound. A variable counts as free if it lies strictly between its bounds, whatever its
        `status` is.

        Args:
            low, high: bounds, numbers or shape (n,).
        """
        x, g = self.x, self.gradient
        low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        # At a minimum, the cost of a variable below its upper bound does not fall if the variable rises. The same holds
        # for one above its lower bound if it falls.
        rise = float(((x < high) * g).min(initial=0.0))
        fall = float(((x > low) * g).max(initial=0.0))
        violation = max(float((low - x).max(initial=0.0)), float((x - high).max(initial=0.0)))
        if violation:
            violation /= max(float(np.abs(low).max(initial=0.0)), float(np.abs(high).max(initial=0.0)), 1e-300)
        return max(max(-rise, fall) / max(self.scale, 1e-300), violation)


SIGN_TOLERANCE = 1e-13  # a sign counts as right below this share of the gradient's scale, or of the largest bound
MAX_BLOCK_TRIES = 6  # block exchanges without progress before the primal active-set method takes over
MAX_PIVOTS = 3000
# If a variable exceeds a bound by more than this many times the largest bound, the gradient is computed anew. Its
# update for the way back to the bound would lose its last digits.
FAR = 10.0
FACTORS_KEPT = 8  # with more factors than the processor's cache holds, every new one is slower
# Solves with one factor before its inverse is computed. That takes as long as thirty solves, and halves the time of
# each further solve.
USES_BEFORE_INVERSE = 16
PROXIMAL_WEIGHT = 1e-7  # share of the mean diagonal element that makes a singular H definite
MAX_PROXIMAL_STEPS = 200
PROXIMAL_TOLERANCE = 1e-13  # largest change of the gradient by a proximal step at the end, relative to its scale


class _Singular(Exception):
    """Block of H is singular, although H as a whole passed as definite by rounding."""


class BoundedLeastSquares:
    """Solver for one Gram matrix and its bounds, and many right-hand sides.

    Args:
        gram: H, symmetric and positive semi-definite, shape (n, n).
        low, high: bounds, numbers or shape (n,), low <= high, finite.

    Raises:
        DermisError: H is not square, symmetric, finite and positive semi-definite, or the bounds have another shape or
            are crossed.
    """

    def __init__(self, gram: Array, low: Any, high: Any) -> None:
        from scipy.linalg import blas, lapack  # a frame makes a dozen calls, which cost a fifth of NumPy's

        self._potrf, self._potrs, self._gemv, self._asum = lapack.dpotrf, lapack.dpotrs, blas.dgemv, blas.dasum
        self._symv, self._axpy = blas.dsymv, blas.daxpy
        self._idamax, self._potri, self._posv = blas.idamax, lapack.dpotri, lapack.dposv
        gram = np.array(gram, dtype=np.float64, order="C")
        if gram.ndim != 2 or gram.shape[0] != gram.shape[1]:
            raise DermisError("the Gram matrix must be square", where=WHERE, value=gram.shape)
        if not np.isfinite(gram).all():
            raise DermisError("the Gram matrix has values that are not finite", where=WHERE)
        self._size = float(np.abs(gram).max(initial=0.0))
        if np.abs(gram - gram.T).max(initial=0.0) > 1e-9 * self._size:
            raise DermisError(
                "the Gram matrix is not symmetric",
                where=WHERE,
                value=float(np.abs(gram - gram.T).max()),
                limit=f"{1e-9 * self._size:.3g}",
            )
        self.gram = gram
        self.n = len(gram)
        self.box = Box(low, high, self.n)
        self._proximal = 0.0
        self._solved = gram
        self._status = np.full(self.n, -1, dtype=np.int8)
        self._latest: ActiveBounds | None = None
        self._factors: Recent[bytes, ActiveBounds] = Recent(FACTORS_KEPT)
        if self.n and self._potrf(gram)[1] != 0:
            self._make_definite()

    def solve(
        self, c: Array, *, low: Any = None, high: Any = None, start: NDArray[np.int8] | None = None
    ) -> BoundedSolution:
        """Minimise 1/2 x'Hx - c'x within the bounds, starting from the active set of the previous call.

        Args:
            c: right-hand side, shape (n,).
            low, high: new bounds for this and later calls, as with slew limits; None keeps them.
            start: active set to start from, as in `BoundedSolution.status`, shape (n,).

        Raises:
            DermisError: c, the bounds or the start have another shape or values that are not allowed.
        """
        c = np.asarray(c, dtype=np.float64)
        if c.shape != (self.n,):
            raise DermisError("the right-hand side does not fit", where=WHERE, value=c.shape, limit=f"({self.n},)")
        if not self.n:
            return BoundedSolution(_EMPTY, _EMPTY, self._status, 0, True, 1.0)
        if not self._asum(c) < np.inf:
            raise DermisError("the right-hand side is not finite", where=WHERE)
        if low is not None or high is not None:
            self.box = Box(self.box.low if low is None else low, self.box.high if high is None else high, self.n)
            self._factors.clear()
            self._latest = None
        if start is not None:
            self._status, self._latest = statuses_of(start, self.n), None
        scale = abs(c.item(self._idamax(c))) + self._size * self.box.span
        if not self._proximal:
            try:
                return self._pivot(c, scale)
            except _Singular:
                self._make_definite()
        return self._proximal_steps(c, scale)

    def _pivot(self, c: Array, scale: float) -> BoundedSolution:
        tolerance, slack = -SIGN_TOLERANCE * scale, SIGN_TOLERANCE * self.box.span
        factor = self._latest or self._factor(self._status)
        inner, gradient = self._stationary(factor, c)
        fewest, tries, pivots = self.n + 1, MAX_BLOCK_TRIES, 0
        while True:
            signed = gradient * factor.sign
            below, above = factor.beyond(inner)
            beyond = below if below > above else above
            rising = signed.item(signed.argmin()) >= tolerance
            if rising and beyond <= slack:
                break
            if tries == 0:
                return self._primal(c, scale, factor, inner, pivots)
            pivots += 1
            x, status, count = factor.fixed.copy(), factor.status.copy(), 0
            x[factor.free] = inner
            if not rising:
                wrong = (signed < tolerance).nonzero()[0]
                status[wrong], count = 0, len(wrong)
            if below > slack:
                count += self._onto(factor, inner < factor.low - slack, -1, status, x, gradient)
            if above > slack:
                count += self._onto(factor, inner > factor.high + slack, 1, status, x, gradient)
            fewest, tries = (count, MAX_BLOCK_TRIES) if count < fewest else (fewest, tries - 1)
            factor = self._factor(status)
            near = beyond <= FAR * self.box.span
            inner, gradient = self._onward(factor, x, gradient) if near else self._stationary(factor, c)
        self._latest, self._status = factor, factor.status
        x = factor.fixed.copy()
        if beyond > 0.0:  # by no more than the tolerance
            inner = np.minimum(np.maximum(inner, factor.low), factor.high)
        x[factor.free] = inner
        return BoundedSolution(x, gradient, factor.status, pivots, True, scale)

    def _onto(
        self,
        factor: ActiveBounds,
        past: NDArray[np.bool_],
        side: int,
        status: NDArray[np.int8],
        x: Array,
        gradient: Array,
    ) -> int:
        """Move the free variables that exceed a bound onto it; return their number.

        Args:
            factor: the active set.
            past: free variables that exceed the bound, shape (k,).
            side: -1 for the lower bound, 1 for the upper one.
            status, x, gradient: changed in place, shape (n,).
        """
        ends = self.box.low if side < 0 else self.box.high
        moved = factor.free.take(past.nonzero()[0]).tolist()
        for i in moved:  # one or two, for which a loop is faster than arrays
            end = ends.item(i)
            self._axpy(self._solved[i], gradient, a=end - x.item(i))
            x[i], status[i] = end, side
        return len(moved)

    def _onward(self, factor: ActiveBounds, x: Array, gradient: Array) -> tuple[Array, Array]:
        """Minimise over the free variables from a point x and its gradient; return them and the new gradient."""
        if not len(factor.free):
            return _EMPTY, gradient
        step = self._back(factor, gradient.take(factor.free))
        return x.take(factor.free) - step, self._gemv(-1.0, factor.columns, step, 1.0, gradient)

    def _stationary(self, factor: ActiveBounds, c: Array) -> tuple[Array, Array]:
        """Minimise over the free variables; return them, shape (k,), and the gradient, shape (n,)."""
        if factor.base is None:
            base = self._symv(1.0, self._solved.T, factor.fixed)
            factor.base = base, base.take(factor.free)
        base, inner_base = factor.base
        rest = base - c
        if not len(factor.free):
            return _EMPTY, rest
        factor.uses += 1
        if factor.uses == USES_BEFORE_INVERSE:
            factor.invert(self._potri(factor.block)[0])
        if factor.inverse is not None:
            inner = self._gemv(1.0, factor.inverse, c.take(factor.free), 1.0, factor.offset)
        else:
            inner = self._back(factor, c.take(factor.free) - inner_base)
        return inner, self._gemv(1.0, factor.columns, inner, 1.0, rest)

    def _back(self, factor: ActiveBounds, side: Array) -> Array:
        """Solve H[free, free] y = side."""
        if factor.factored:
            solved: Array = self._potrs(factor.block, side)[0]
            return solved
        factor.block, solved, info = self._posv(factor.block, side, overwrite_a=1)
        if info != 0:
            self._factors.clear()  # the failed factorisation overwrote a part of this block
            self._latest = None
            if not self._proximal:
                raise _Singular
            raise DermisError("the Gram matrix is not positive definite on the free variables", where=WHERE)
        factor.factored = True
        return solved

    def _primal(self, c: Array, scale: float, factor: ActiveBounds, inner: Array, pivots: int) -> BoundedSolution:
        """Walk through feasible points of falling cost, one bound at a time, until every sign is right."""
        x = factor.fixed.copy()
        x[factor.free] = np.clip(inner, factor.low, factor.high)
        status = np.where(x <= self.box.low, -1, np.where(x >= self.box.high, 1, 0)).astype(np.int8)
        converged, blocked = False, np.zeros(self.n, dtype=bool)
        while pivots < MAX_PIVOTS:
            pivots += 1
            factor = self._factor(status)
            inner, gradient = self._stationary(factor, c)
            step = inner - x[factor.free]
            with np.errstate(divide="ignore", invalid="ignore"):
                bound = np.where(step < 0, self.box.low[factor.free], self.box.high[factor.free])
                reach = np.where(step != 0.0, (bound - x[factor.free]) / step, np.inf)
            length = float(reach.min(initial=np.inf))
            if length < 1.0:  # the first bound that the step meets becomes active
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
        self._status, self._latest = status, None
        return BoundedSolution(x, self._solved @ x - c, status, pivots, converged, scale)

    def _proximal_steps(self, c: Array, scale: float) -> BoundedSolution:
        """Solve with H + w I and c + w x until x no longer changes; this is a minimiser for the singular H."""
        x, pivots = np.clip(np.zeros(self.n), self.box.low, self.box.high), 0
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

    def _factor(self, status: NDArray[np.int8]) -> ActiveBounds:
        return self._factors.make(status.tobytes(), lambda: ActiveBounds.of(self._solved, status, self.box))

    def _make_definite(self) -> None:
        """Replace H by H + w I; proximal steps then remove the effect of w."""
        self._proximal = PROXIMAL_WEIGHT * max(float(np.trace(self.gram)) / self.n, 1e-300)
        self._solved = self.gram.copy()
        self._solved[np.diag_indices(self.n)] += self._proximal
        if self._potrf(self._solved)[1] != 0:
            raise DermisError(
                "the Gram matrix is not positive semi-definite",
                where=WHERE,
                value=float(np.linalg.eigvalsh(self.gram)[0]),
                limit=">= 0",
            )
        self._factors.clear()
        self._latest = None


_EMPTY = np.zeros(0)

"""Bounded least squares: min 1/2 x'Hx - c'x with low <= x <= high, warm along a track, with a certificate.

Block principal pivoting keeps a guess of which variables sit on a bound and flips every one whose sign is wrong.
Along a track the guess of the frame before is nearly always right, and then a solve is one triangular
back-substitution and one matrix-vector product. Where flipping all at once stops reducing the number of wrong
signs, a primal active set takes over: it walks through feasible points of falling cost and therefore ends.

Source: Judice & Pires 1994, block principal pivoting for strictly monotone LCPs; Stark & Parker 1995, BVLS.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError
from ..recent import Recent
from .bounded_input import WHERE, bounds_of, statuses_of
from .bounded_solution import BoundedSolution

__all__ = ["BoundedLeastSquares", "BoundedSolution"]


SIGN_TOLERANCE = 1e-13  # of the largest gradient or bound: below it a sign counts as right
MAX_BLOCK_TRIES = 6  # block exchanges without progress before the primal active set takes over
MAX_PIVOTS = 3000
FACTORS_KEPT = 64
USES_BEFORE_INVERSE = 16  # of a factor: its inverse takes as long as thirty solves, and then saves half of each
MAX_CONDITION = 1e4  # of the free variables' H, for its inverse to be used instead of its factor
PROXIMAL_WEIGHT = 1e-7  # of the mean diagonal: makes a singular H definite; removed again by proximal steps
MAX_PROXIMAL_STEPS = 200
PROXIMAL_TOLERANCE = 1e-13


@dataclass(slots=True)
class _Factor:
    """What one guess of the active bounds needs again in every frame that shares it."""

    status: NDArray[np.int8]
    free: NDArray[np.intp]
    block: Array  # H[free, free], Fortran order; once it is solved with, its upper factor
    columns: Array  # H[:, free], Fortran order
    sign: Array  # +1 at the lower bound, -1 at the upper, 0 free
    fixed: Array  # x at the bounds, 0 where free
    base: Array  # H @ fixed
    inner_base: Array  # of the free variables
    low: Array  # bounds of the free variables
    high: Array
    uses: int = 0
    factored: bool = False
    inverse: Array | None = None  # of H[free, free], where it is used again and well conditioned
    offset: Array | None = None  # -inverse @ inner_base


class _Singular(Exception):
    """Some free variables show that H is singular, although rounding let all of it pass as definite."""


class BoundedLeastSquares:
    """One Gram matrix and its bounds, solved for many right-hand sides.

    Args:
        gram: H, symmetric and positive semi-definite, shape (n, n).
        low, high: bounds, numbers or shape (n,), low <= high, finite.

    Raises:
        DermisError: H is not square, symmetric, finite and positive semi-definite, or the bounds do not fit or are
            crossed.
    """

    def __init__(self, gram: Array, low: Any, high: Any) -> None:
        from scipy.linalg import blas, lapack  # a frame is a dozen calls: these cost a fifth of numpy's own

        self._potrf, self._potrs, self._gemv, self._asum = lapack.dpotrf, lapack.dpotrs, blas.dgemv, blas.dasum
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
        self._set_bounds(low, high)
        self._none = np.zeros(self.n)
        self._proximal = 0.0
        self._solved = gram
        self._status = np.full(self.n, -1, dtype=np.int8)
        self._latest: _Factor | None = None
        self._factors: Recent[bytes, _Factor] = Recent(FACTORS_KEPT)
        if self.n and self._potrf(gram)[1] != 0:
            self._make_definite()

    def solve(
        self, c: Array, *, low: Any = None, high: Any = None, start: NDArray[np.int8] | None = None
    ) -> BoundedSolution:
        """Minimise 1/2 x'Hx - c'x within the bounds, starting from the active bounds of the call before.

        Args:
            c: right-hand side, shape (n,).
            low, high: bounds for this and later calls, where they change (slew limits).
            start: active bounds to start from, as in `BoundedSolution.status`.

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
            self._set_bounds(self.low if low is None else low, self.high if high is None else high)
            self._factors.clear()
            self._latest = None
        if start is not None:
            self._status, self._latest = statuses_of(start, self.n), None
        scale = abs(c.item(self._idamax(c))) + self._size * self._span
        if not self._proximal:
            try:
                return self._pivot(c, scale)
            except _Singular:
                self._make_definite()
        return self._proximal_steps(c, scale)

    def _pivot(self, c: Array, scale: float) -> BoundedSolution:
        tolerance, slack = -SIGN_TOLERANCE * scale, SIGN_TOLERANCE * self._span
        factor = self._latest or self._factor(self._status)
        fewest, tries, pivots = self.n + 1, MAX_BLOCK_TRIES, 0
        while True:
            inner, gradient = self._stationary(factor, c)
            signed = gradient * factor.sign
            beyond = self._beyond(factor, inner)
            if beyond <= slack and signed.item(signed.argmin()) >= tolerance:
                break
            if tries == 0:
                return self._primal(c, scale, factor, inner, pivots)
            pivots += 1
            wrong = (signed < tolerance).nonzero()[0]
            to_low = factor.free[inner < factor.low - slack]
            to_high = factor.free[inner > factor.high + slack]
            count = len(wrong) + len(to_low) + len(to_high)
            fewest, tries = (count, MAX_BLOCK_TRIES) if count < fewest else (fewest, tries - 1)
            status = factor.status.copy()
            status[wrong], status[to_low], status[to_high] = 0, -1, 1
            factor = self._factor(status)
        self._latest, self._status = factor, factor.status
        x = factor.fixed.copy()
        if beyond > 0.0:  # past a bound by no more than the tolerance of its sign
            inner = np.minimum(np.maximum(inner, factor.low), factor.high)
        x[factor.free] = inner
        return BoundedSolution(x, gradient, factor.status, pivots, True, scale)

    def _beyond(self, factor: _Factor, inner: Array) -> float:
        """Return how far the free variables are beyond their bounds; not above 0 where none is."""
        if not len(inner):
            return 0.0
        if self._uniform is not None:
            low, high = self._uniform
            below: float = low - inner.item(inner.argmin())
            above: float = inner.item(inner.argmax()) - high
            return below if below > above else above
        return max(float((factor.low - inner).max()), float((inner - factor.high).max()))

    def _stationary(self, factor: _Factor, c: Array) -> tuple[Array, Array]:
        """Minimise over the free variables alone; return them and the gradient of all."""
        rest = factor.base - c
        if not len(factor.free):
            return _EMPTY, rest
        factor.uses += 1
        if factor.uses == USES_BEFORE_INVERSE:
            self._invert(factor)
        if factor.inverse is not None:
            inner = self._gemv(1.0, factor.inverse, c.take(factor.free), 1.0, factor.offset)
        elif factor.factored:
            inner = self._potrs(factor.block, c.take(factor.free) - factor.inner_base)[0]
        else:  # both in one call
            factor.block, inner, info = self._posv(factor.block, c.take(factor.free) - factor.inner_base, overwrite_a=1)
            if info != 0:
                self._factors.clear()  # half of this one is overwritten
                self._latest = None
                if not self._proximal:
                    raise _Singular
                raise DermisError("the Gram matrix is not positive definite on the free variables", where=WHERE)
            factor.factored = True
        return inner, self._gemv(1.0, factor.columns, inner, 1.0, rest)

    def _invert(self, factor: _Factor) -> None:
        """Keep the inverse where its rounding is as harmless as that of a back-substitution; it is twice as fast."""
        half = self._potri(factor.block)[0]
        inverse = np.triu(half) + np.triu(half, 1).T
        block = factor.columns[factor.free]
        condition = np.abs(inverse).sum(axis=1).max() * np.abs(block).sum(axis=1).max()
        if condition <= MAX_CONDITION:
            factor.inverse = np.asfortranarray(inverse)
            factor.offset = -(inverse @ factor.inner_base)

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
        self._status, self._latest = status, None
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
        return self._factors.make(status.tobytes(), lambda: self._factored(status))

    def _factored(self, status: NDArray[np.int8]) -> _Factor:
        free = (status == 0).nonzero()[0]
        rows = self._solved.take(free, axis=0)  # H is symmetric, and its rows are contiguous
        fixed, upper = self.low.copy(), (status > 0).nonzero()[0]
        fixed[upper] = self.high[upper]
        fixed[free] = 0.0
        loaded = fixed.nonzero()[0]  # few where the lower bounds are zero
        base = self._gemv(1.0, self._solved.take(loaded, axis=0).T, fixed.take(loaded)) if len(loaded) else self._none
        low, high = self.low[free], self.high[free]
        return _Factor(
            status,
            free,
            rows.take(free, axis=1).T,
            rows.T,
            np.negative(status, dtype=np.float64),
            fixed,
            base,
            base.take(free),
            low,
            high,
        )

    def _set_bounds(self, low: Any, high: Any) -> None:
        self.low, self.high = bounds_of(low, high, self.n)
        same = self.n > 0 and bool((self.low == self.low[0]).all() and (self.high == self.high[0]).all())
        self._uniform = (float(self.low[0]), float(self.high[0])) if same else None
        self._span = max(float(np.abs(self.low).max(initial=0.0)), float(np.abs(self.high).max(initial=0.0)))

    def _make_definite(self) -> None:
        """Go over to H + w I and to proximal steps, which take w out again."""
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

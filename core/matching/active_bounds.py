"""Active set of a bounded least-squares problem, with the matrices that its solves share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from .bounded_input import bounds_of

MAX_CONDITION = 1e4  # largest condition number of the free variables' H for which its inverse is used
_SIGNS = np.array([0.0, -1.0, 1.0])  # sign for each status; status -1 is the last entry


class Box:
    """Lower and upper bounds of all variables.

    Args:
        low, high: bounds, numbers or shape (n,), low <= high, finite.
        n: number of variables.

    Attributes:
        uniform: lower and upper bound if they are the same for all variables, else None.
        span: largest absolute value of a bound.

    Raises:
        DermisError: the bounds have another shape, are crossed or are not finite.
    """

    def __init__(self, low: Any, high: Any, n: int) -> None:
        self.low, self.high = bounds_of(low, high, n)
        same = n > 0 and bool((self.low == self.low[0]).all() and (self.high == self.high[0]).all())
        self.uniform = (float(self.low[0]), float(self.high[0])) if same else None
        self._ends = np.array([0.0, *self.uniform[::-1]]) if self.uniform else None  # for each status
        self.span = max(float(np.abs(self.low).max(initial=0.0)), float(np.abs(self.high).max(initial=0.0)))

    def fixed(self, status: NDArray[np.integer]) -> Array:
        """Return the value of each variable at its active bound, 0 for free ones, shape (n,)."""
        if self._ends is not None:
            return self._ends.take(status)
        return np.where(status == 0, 0.0, np.where(status > 0, self.high, self.low))


@dataclass(slots=True)
class ActiveBounds:
    """One active set, with the quantities that depend on it alone.

    Attributes:
        status: -1 at the lower bound, 0 free, +1 at the upper bound, shape (n,).
        free: indices of the free variables, shape (k,).
        block: H[free, free] in Fortran order, shape (k, k); its upper Cholesky factor if `factored`.
        columns: H[:, free] in Fortran order, shape (n, k).
        sign: +1 at the lower bound, -1 at the upper bound, 0 free, shape (n,).
        fixed: x at the active bounds, 0 for free variables, shape (n,).
        low, high: bounds of the free variables, numbers or shape (k,).
        uses: number of solves with `base`.
        factored: whether `block` was replaced by its factor.
        base: H @ fixed of all variables, shape (n,), and of the free ones, shape (k,); None before the first solve.
        inverse: inverse of H[free, free], shape (k, k), if it is used often and well conditioned; else None.
        offset: -inverse @ base of the free variables, shape (k,); None without `inverse`.
    """

    status: NDArray[np.int8]
    free: NDArray[np.intp]
    block: Array
    columns: Array
    sign: Array
    fixed: Array
    low: Array | float
    high: Array | float
    uses: int = 0
    factored: bool = False
    base: tuple[Array, Array] | None = None
    inverse: Array | None = None
    offset: Array | None = None

    @classmethod
    def of(cls, h: Array, status: NDArray[np.int8], box: Box) -> ActiveBounds:
        """Return an active set with its parts of H, which is symmetric and in C order."""
        free = np.logical_not(status).nonzero()[0]
        rows = h.take(free, axis=0)
        low, high = box.uniform or (box.low[free], box.high[free])
        at = status.astype(np.intp)  # `take` would convert it at every call
        return cls(status, free, rows.take(free, axis=1).T, rows.T, _SIGNS.take(at), box.fixed(at), low, high)

    def beyond(self, inner: Array) -> tuple[float, float]:
        """Return how far the free variables exceed their lower and upper bounds at most.

        A value is zero or negative if no variable exceeds that bound.
        """
        if not len(inner):
            return 0.0, 0.0
        low, high = self.low, self.high
        if isinstance(low, float) and isinstance(high, float):
            return low - inner.item(inner.argmin()), inner.item(inner.argmax()) - high
        return float((low - inner).max()), float((inner - high).max())

    def invert(self, half: Array) -> None:
        """Keep the inverse of the free block if the block is well conditioned.

        A product with the inverse is twice as fast as back-substitution. Up to `MAX_CONDITION`, its rounding errors are
        as small.

        Args:
            half: upper triangle of the inverse, shape (k, k).
        """
        assert self.base is not None
        inverse = np.triu(half) + np.triu(half, 1).T
        block = self.columns[self.free]
        if np.abs(inverse).sum(axis=1).max() * np.abs(block).sum(axis=1).max() <= MAX_CONDITION:
            self.inverse = np.asfortranarray(inverse)
            self.offset = -(inverse @ self.base[1])

"""Guess of which variables sit on which bound, with the matrices that its solves share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from .bounded_input import bounds_of

MAX_CONDITION = 1e4  # of the free variables' H, for its inverse to be used instead of its factor
_SIGNS = np.array([0.0, -1.0, 1.0])  # by status; -1 is the last


class Box:
    """Bounds of all variables.

    Args:
        low, high: numbers or shape (n,), low <= high, finite.

    Attributes:
        uniform: the bounds, where all variables have the same. span: the largest of them.

    Raises:
        DermisError: the bounds do not fit or are crossed.
    """

    def __init__(self, low: Any, high: Any, n: int) -> None:
        self.low, self.high = bounds_of(low, high, n)
        same = n > 0 and bool((self.low == self.low[0]).all() and (self.high == self.high[0]).all())
        self.uniform = (float(self.low[0]), float(self.high[0])) if same else None
        self._ends = np.array([0.0, *self.uniform[::-1]]) if self.uniform else None  # by status; -1 is the last
        self.span = max(float(np.abs(self.low).max(initial=0.0)), float(np.abs(self.high).max(initial=0.0)))

    def fixed(self, status: NDArray[np.integer]) -> Array:
        """Return variables at the bounds they sit on, 0 where they are free."""
        if self._ends is not None:
            return self._ends.take(status)
        return np.where(status == 0, 0.0, np.where(status > 0, self.high, self.low))


@dataclass(slots=True)
class ActiveBounds:
    """One guess of the active bounds, with the quantities that all its frames share.

    Attributes:
        status: -1 at the lower bound, 0 free, +1 at the upper one. free: which are free.
        block: H[free, free], Fortran order; once it is solved with, `factored`, its upper factor.
        columns: H[:, free], Fortran order.
        sign: +1 at the lower bound, -1 at the upper, 0 free. fixed: x at the bounds, 0 where free.
        low, high: bounds of the free variables. uses: solves from `base`, H @ fixed, of all and
            of the free variables, which a second frame asks for.
        inverse: inverse of H[free, free], if it is used repeatedly and well conditioned.
        offset: -inverse @ base of the free variables.
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
        """Return a guess with its parts of H, which is symmetric, in C order."""
        free = np.logical_not(status).nonzero()[0]
        rows = h.take(free, axis=0)
        low, high = box.uniform or (box.low[free], box.high[free])
        at = status.astype(np.intp)  # which `take` would make of it every time
        return cls(status, free, rows.take(free, axis=1).T, rows.T, _SIGNS.take(at), box.fixed(at), low, high)

    def beyond(self, inner: Array) -> tuple[float, float]:
        """Return how far free variables are below and above their bounds; not above 0 where none is."""
        if not len(inner):
            return 0.0, 0.0
        low, high = self.low, self.high
        if isinstance(low, float) and isinstance(high, float):
            return low - inner.item(inner.argmin()), inner.item(inner.argmax()) - high
        return float((low - inner).max()), float((inner - high).max())

    def invert(self, half: Array) -> None:
        """Keep the inverse where its rounding is as harmless as that of a back-substitution; it is twice as fast.

        Args:
            half: its upper triangle.
        """
        assert self.base is not None
        inverse = np.triu(half) + np.triu(half, 1).T
        block = self.columns[self.free]
        if np.abs(inverse).sum(axis=1).max() * np.abs(block).sum(axis=1).max() <= MAX_CONDITION:
            self.inverse = np.asfortranarray(inverse)
            self.offset = -(inverse @ self.base[1])

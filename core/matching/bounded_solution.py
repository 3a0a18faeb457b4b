"""The solution of a bounded least-squares problem, with its certificate."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array


class BoundedSolution(NamedTuple):
    """A solution with the quantities that verify it.

    Attributes:
        x: the minimiser, shape (n,).
        gradient: Hx - c, shape (n,).
        status: -1 at the lower bound, 0 free, +1 at the upper bound, shape (n,), int8.
        pivots: how often the guess of the active bounds was changed.
        converged: False where the pivots ran out; x is then feasible but not optimal.
        scale: reference of the gradient, max |c| + max |H| max |x|.
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
        low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        # below its upper bound a variable may not want to rise, above its lower one it may not want to fall
        rise = float(((x < high) * g).min(initial=0.0))
        fall = float(((x > low) * g).max(initial=0.0))
        violation = max(float((low - x).max(initial=0.0)), float((x - high).max(initial=0.0)))
        if violation:
            violation /= max(float(np.abs(low).max(initial=0.0)), float(np.abs(high).max(initial=0.0)), 1e-300)
        return max(max(-rise, fall) / max(self.scale, 1e-300), violation)

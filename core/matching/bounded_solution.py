"""Solution of a bounded least-squares problem, with the quantities that verify it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array


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

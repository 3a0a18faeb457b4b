"""Bend: difference between the gradients of a displacement error by the neo-Hookean law and on linear skin.

The error of a displacement u(x) by pin forces x is half the square of W^1/2 (wanted - u). Its descent is A' a / E, with
the pins' nodal forces A and the adjoint a: K(u) a = W (wanted - u) for E = 1. K(u) is the tangent stiffness of the law.
With the stiffness at rest in its place, the same formula gives the descent on linear skin.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Floats32
from ..skin.law_tables import LawTables

ITERATIONS = 40  # largest number of iterations; touches of 1.5 mm need 6 for a residual of 3e-3


class Bend:
    """Difference between two adjoints, computed by conjugate gradients.

    They begin with the adjoint on linear skin, and the stiffness at rest preconditions them. Each iteration takes two
    evaluations of the law and one solve.

    Args:
        tables: tables of the law.
        pins: A / E, forces of unit pin forces on the pad nodes over Young's modulus [1/Pa], shape (3 m, pins).
        moved: displacement u by the law, not zero everywhere [m], shape (3 free,).
        off: W (wanted - u) [m], shape (3 free,).

    Attributes:
        left: residual, in the norm of energy and relative to the adjoint on linear skin.
        definite: whether the tangent stiffness was positive in all directions of the search. The search ends if not.
    """

    def __init__(self, tables: LawTables, pins: Array, moved: Floats32, off: Floats32) -> None:
        self._tables, self._pins, self._moved = tables, pins, moved
        linear = tables.yielded(off)
        self._own = float(linear @ off)
        self._adjoint, self._way = np.zeros(len(off)), np.zeros(len(off))
        self._missing = off.astype(np.float64)
        self.left, self.definite = 0.0, True
        if self._own > 0.0:
            self._missing -= tables.stiffened(moved, linear)
            self._measure()

    def solve(self, tolerance: float) -> Array:
        """Iterate until the residual is within a tolerance.

        A search that goes on to a smaller tolerance gives the same result as one that aims at it from the beginning.

        Returns:
            For each active pin, the descent by the law less that on linear skin [m^2/N], shape (pins,).
        """
        for _ in range(ITERATIONS):
            if self.left <= tolerance or not self.definite:
                break
            stiff = self._tables.stiffened(self._moved, self._way.astype(np.float32)).astype(np.float64)
            bent = float(self._way @ stiff)
            self.definite = bent > 0.0
            if self.definite:
                length = self.left**2 * self._own / bent
                self._adjoint += length * self._way
                self._missing -= length * stiff
                self._measure()
        return np.asarray(self._adjoint[self._tables.pad] @ self._pins)

    def _measure(self) -> None:
        """Compute the residual and the next direction."""
        step = self._tables.yielded(self._missing.astype(np.float32)).astype(np.float64)
        before, self.left = self.left, np.sqrt(max(float(step @ self._missing), 0.0) / self._own)
        self._way = step + ((self.left / before) ** 2 if before else 0.0) * self._way

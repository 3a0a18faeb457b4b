"""StiffPoints: what stiffening adds to points of a pad that something flat presses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array, Floats32, Indices
from ..stiffening.stiffening import Stiffening
from ..stiffening.tangent import StiffTangent


@dataclass(frozen=True, eq=False)
class StiffPoints:
    """Points of a skin that stiffens: they move by C f - U n(q), with q + n(q) = U' f / E.

    Attributes:
        stiffening: of the skin. modulus: E alpha [Pa].
        patterns: U at the points, x, y, z each, shape (3 n, k).
    """

    stiffening: Stiffening
    modulus: float
    patterns: Array

    @property
    def rest(self) -> StiffTangent:
        """The tangent of skin that nothing presses."""
        return StiffTangent.rest(self.stiffening.count)

    def work(self, columns: Indices, force: Array) -> Array:
        """Return z, the work of forces [N] in some of the components, shape (c,), in each pattern at E = 1, (k,)."""
        return (force @ self.patterns[columns]) / self.modulus

    def moved(self, tangent: StiffTangent, z: Array) -> StiffTangent:
        """Return the tangent at other forces, by their work in the patterns, shape (k,)."""
        return tangent.moved(self.stiffening.energy, z)

    def matrix(self, tangent: StiffTangent, columns: Indices) -> Array:
        """Return U M U' / E among some of the components, to be taken off their compliance [m/N], shape (c, c).

        In single precision, as contact has it: what it is off by, the next tangent finds.
        """
        few = self._short[columns]
        out: Array = ((few @ (tangent.softening / self.modulus).astype(np.float32)) @ few.T).astype(np.float64)
        return out

    @cached_property
    def _short(self) -> Floats32:
        return self.patterns.astype(np.float32)

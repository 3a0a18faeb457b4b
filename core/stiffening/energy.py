"""Energy: what tissue stores beyond linear tissue when its skin is displaced by a few patterns, to the fourth power.

Displacement q_a U_a of the skin, with all beneath free to follow, stores |q|^2 / 2 + Phi3(q) + Phi4(q) + ... at E = 1.
A series in displacement is worth several times one in force: skin that stiffens takes ever more force, and so its
displacement is a root of the force, which powers follow badly.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array, Indices


@dataclass(frozen=True, eq=False)
class Energy:
    """Phi3 and Phi4 of some patterns.

    Attributes:
        cubic: T of Phi3 = sum T_abc q_a q_b q_c, symmetric, shape (k, k, k).
        quartic: R of Phi4 = sum R_abcd q_a q_b q_c q_d over the first l <= k patterns, symmetric in all four, as a
            matrix of pairs a <= b and c <= d, shape (l (l + 1) / 2, l (l + 1) / 2).
    """

    cubic: Array
    quartic: Array

    @property
    def count(self) -> int:
        """Number of patterns k."""
        return len(self.cubic)

    @property
    def few(self) -> int:
        """Number of patterns l of which the fourth power is kept."""
        return int(np.sqrt(2 * len(self.quartic)))

    def value(self, q: Array) -> float:
        """Return Phi3 + Phi4."""
        cubic, quartic = self._slopes(q)
        few = q[: self.few]
        return float(q @ cubic @ q) + float(few @ quartic @ few)

    def force(self, q: Array) -> Array:
        """Return the slope of Phi3 + Phi4, the force beyond linear tissue's, shape (k,)."""
        return self.force_and_stiffness(q)[0]

    def stiffness(self, q: Array) -> Array:
        """Return the slope of `force`, symmetric, shape (k, k)."""
        return self.force_and_stiffness(q)[1]

    def force_and_stiffness(self, q: Array) -> tuple[Array, Array]:
        """Return `force` and `stiffness`, for the price of one."""
        cubic, quartic = self._slopes(q)
        few = self.few
        force = 3.0 * (cubic @ q)
        force[:few] += 4.0 * (quartic @ q[:few])
        stiffness = 6.0 * cubic
        stiffness[:few, :few] += 12.0 * quartic
        return force, stiffness

    def _slopes(self, q: Array) -> tuple[Array, Array]:
        """Return T q, shape (k, k), and R q q, shape (l, l)."""
        k = self.count
        cubic = (self.cubic.reshape(k * k, k) @ q).reshape(k, k)
        i, j = self._pairs
        twice = np.where(i == j, 1.0, 2.0)
        quartic = np.zeros((self.few, self.few))
        quartic[i, j] = self.quartic @ (twice * q[i] * q[j])
        quartic[j, i] = quartic[i, j]
        return cubic, quartic

    @cached_property
    def _pairs(self) -> tuple[Indices, Indices]:
        i, j = np.triu_indices(self.few)
        return i, j

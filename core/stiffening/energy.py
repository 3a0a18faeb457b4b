"""Energy: what tissue stores beyond linear tissue when its skin is displaced by a few patterns, to the fourth power.

Displacement q_a U_a of the skin, with all beneath free to follow, stores |q|^2 / 2 + Phi3(q) + Phi4(q) + ... at E = 1.
A series in displacement is worth several times one in force: skin that stiffens takes ever more force, and so its
displacement is a root of the force, which powers follow badly.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices

Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class Energy:
    """Phi3 and Phi4 of some patterns.

    Beyond `reach`, where t = |q / reach| is above 1, the series is followed no further: along each ray the energy goes
    on as the parabola that it has there, and a wall (t - 1)^3 keeps it from running away. It stays one energy: what is
    pressed on gets its work back.

    Attributes:
        cubic: T of Phi3 = sum T_abc q_a q_b q_c, symmetric, shape (k, k, k).
        quartic: R of Phi4 = sum R_abcd q_a q_b q_c q_d over the first l <= k patterns, symmetric in all four, as a
            matrix of pairs a <= b and c <= d, shape (l (l + 1) / 2, l (l + 1) / 2).
        reach: amounts up to which the series is trusted, shape (k,); anywhere where None.

    In single precision it takes half the time.
    """

    cubic: Floats
    quartic: Floats
    reach: Array | None = None

    @property
    def count(self) -> int:
        """Number of patterns k."""
        return len(self.cubic)

    @cached_property
    def few(self) -> int:
        """Number of patterns l of which the fourth power is kept."""
        return int(np.sqrt(2 * len(self.quartic)))

    def far(self, q: Array) -> float:
        """Return t = |q / reach|, 0 where nothing bounds it."""
        return 0.0 if self.reach is None else float(np.linalg.norm(q / self.reach))

    def value(self, q: Array) -> float:
        """Return Phi3 + Phi4."""
        third, fourth = self._beyond(q, self._powers(q))
        return third.value + fourth.value

    def force(self, q: Array) -> Array:
        """Return the slope of Phi3 + Phi4, the force beyond linear tissue's, shape (k,)."""
        return self.force_and_stiffness(q)[0]

    def stiffness(self, q: Array) -> Array:
        """Return the slope of `force`, symmetric, shape (k, k)."""
        return self.force_and_stiffness(q)[1]

    def force_and_stiffness(self, q: Array) -> tuple[Array, Array]:
        """Return `force` and `stiffness`, for the price of one."""
        third, fourth = self._beyond(q, self._powers(q))
        few = len(fourth.slope)
        third.slope[:few] += fourth.slope
        third.bend[:few, :few] += fourth.bend
        return third.slope, third.bend

    def _powers(self, q: Array) -> tuple[_Power, _Power]:
        """Return both powers; the fourth of the first l patterns alone."""
        from scipy.linalg.blas import dsymv, ssymv  # reads half of the matrix

        k, few, (i, j, place) = self.count, self.few, self._pairs
        first = q[:few]
        third = np.asarray(self._flat @ q.astype(self.cubic.dtype), np.float64).reshape(k, k)
        products = (self._twice * q[i] * q[j]).astype(self.quartic.dtype)
        product = ssymv if self.quartic.dtype == np.float32 else dsymv
        fourth = product(1.0, self.quartic.T, products)[place].astype(np.float64)
        return _Power.of(3, q, third), _Power.of(4, first, fourth)

    def _beyond(self, q: Array, powers: tuple[_Power, _Power]) -> tuple[_Power, _Power]:
        """Return the powers, bent to parabolas along the rays beyond `reach`, with the wall in the third."""
        if self.reach is None:
            return powers
        scaled = q / self.reach
        t = float(np.linalg.norm(scaled))
        if t <= 1.0:
            return powers
        third, fourth = powers
        whole = np.zeros(len(q)), np.zeros((len(q), len(q)))
        whole[0][: self.few], whole[1][: self.few, : self.few] = fourth.slope, fourth.bend
        along = scaled / (self.reach * t)  # slope of t
        across = (np.diag(self.reach**-2.0) - np.outer(along, along)) / t
        s, firm = t - 1.0, float((self.reach**2).max())
        bend = firm * (2.0 * s * np.outer(along, along) + s * s * across)
        wall = _Power(0, firm * s**3 / 3.0, firm * s * s * along, bend)
        bent = _Power(4, fourth.value, *whole).bent(t, along, across)
        return third.bent(t, along, across).plus(wall), bent

    @cached_property
    def _pairs(self) -> tuple[Indices, Indices, Indices]:
        """Return both patterns of each pair, and where the pair of two patterns is, shape (l, l)."""
        i, j = np.triu_indices(self.few)
        place = np.empty((self.few, self.few), np.intp)
        place[i, j] = place[j, i] = np.arange(len(i))
        return i, j, place

    @cached_property
    def _twice(self) -> Array:
        i, j, _ = self._pairs
        return np.where(i == j, 1.0, 2.0)

    @cached_property
    def _flat(self) -> Floats:
        return self.cubic.reshape(self.count**2, self.count)


class _Power(NamedTuple):
    """A homogeneous power of q: its value, slope (k,) and second derivative (k, k)."""

    power: int
    value: float
    slope: Array
    bend: Array

    @classmethod
    def of(cls, power: int, q: Array, form: Array) -> _Power:
        """Return the power whose second derivative is a multiple of a form in q."""
        slope = form @ q
        value = float(slope @ q)
        return cls(power, value, power * slope, power * (power - 1) * form)

    def plus(self, other: _Power) -> _Power:
        """Return the sum with another."""
        return _Power(self.power, self.value + other.value, self.slope + other.slope, self.bend + other.bend)

    def bent(self, t: float, along: Array, across: Array) -> _Power:
        """Return a(t) times it, which goes on along each ray as the parabola that it has at t = 1.

        Args:
            t: above 1, homogeneous of degree 1. along, across: its slope (k,) and second derivative (k, k).
        """
        p, s = self.power, t - 1.0
        rise = (p + p * (p - 1) * s) / t**p
        a = (1.0 + p * s + 0.5 * p * (p - 1) * s * s) / t**p
        da = rise - p * a / t
        dda = p * (p - 1) / t**p - p * rise / t - p * da / t + p * a / (t * t)
        both = np.outer(self.slope, along)
        bend = a * self.bend + da * (both + both.T) + self.value * (dda * np.outer(along, along) + da * across)
        return _Power(p, a * self.value, a * self.slope + da * self.value * along, bend)

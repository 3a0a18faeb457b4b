"""Energy: what tissue stores beyond linear tissue when its skin is displaced by a few patterns, to the fourth power.

Displacement q_a U_a of the skin, with all beneath free to follow, stores |q|^2 / 2 + Phi3(q) + Phi4(q) + ... at E = 1.
A series in displacement is worth several times one in force: skin that stiffens takes ever more force, and so its
displacement is a root of the force, which powers follow badly.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from .cubic import Cubic
from .features import Features

WALL = 0.3  # of |reach|^2: less lets tissue run away, more takes a drag for a push


@dataclass(frozen=True, eq=False)
class Energy:
    """Phi3 and Phi4 of some patterns.

    Phi4 is told by a few features of q, squared: touches go few ways among all products of four patterns.

    Beyond `reach`, where t = |q / reach| is above 1, the series is followed no further: along each ray the energy goes
    on as the parabola that it has there, and a wall (t - 1)^3 keeps it from running away. It stays one energy: what is
    pressed on gets its work back.

    Attributes:
        third: of Phi3.
        features: y of Phi4 = sum s_j y_j^2. signs: s, 1 or -1, shape (r,).
        reach: amounts up to which the series is trusted, shape (k,); anywhere where None.

    In single precision it takes half the time.
    """

    third: Cubic
    features: Features
    signs: Array
    reach: Array | None = None

    @classmethod
    def of_forms(cls, cubic: Array, quartic: Array, reach: Array | None = None, even: int | None = None) -> Energy:
        """Return the energy of whole forms.

        Args:
            cubic: T of Phi3 = sum T_abc q_a q_b q_c, symmetric, shape (k, k, k).
            quartic: Phi4 as a form of products q_a q_b, a <= b, of the first l <= k patterns, symmetric, shape (p, p).
            reach: as above. even: number of patterns that a mirror keeps, which come first; all where None.
        """
        count = len(cubic)
        values, vectors = np.linalg.eigh(quartic)
        kept = np.abs(values) > 1e-12 * np.abs(values).max(initial=1e-300)
        i, j = np.triu_indices(int(np.sqrt(2 * len(quartic))))
        forms = np.zeros((int(kept.sum()), count, count))
        forms[:, i, j] += 0.5 * (vectors[:, kept] * np.sqrt(np.abs(values[kept]))).T
        forms += forms.transpose(0, 2, 1)
        even = count if even is None else even
        return cls(Cubic.of(cubic, even), Features.of(forms, even, 0), np.sign(values[kept]), reach)

    @property
    def astray(self) -> bool:
        """Never: nothing is sought."""
        return False

    @property
    def count(self) -> int:
        """Number of patterns k."""
        return self.third.count

    @property
    def cubic(self) -> Array:
        """T of Phi3 = sum T_abc q_a q_b q_c, symmetric, shape (k, k, k)."""
        return self.third.tensor

    def far(self, q: Array) -> float:
        """Return t = |q / reach|, 0 where nothing bounds it."""
        return 0.0 if self.reach is None else float(np.linalg.norm(q / self.reach))

    def holds(self, q: Array) -> bool:
        """Return whether the series is trusted there: beyond, what it balances in a drag is off by more than linear."""
        return self.far(q) <= 1.0

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
        """Return `force` and `stiffness`, for the price of one, and for none where q is that of the last time."""
        known = self._last.get("")
        if known is not None and np.array_equal(known[0], q):
            return known[1], known[2]
        third, fourth = self._beyond(q, self._powers(q))
        force, stiffness = third.slope + fourth.slope, third.bend + fourth.bend
        self._last[""] = q.copy(), force, stiffness  # what is shown asks again for what contact was solved with
        return force, stiffness

    def sharpened(self, q: Array) -> tuple[Array, Array]:
        """Return the same: the stiffness is of that place."""
        return self.force_and_stiffness(q)

    def followed(self) -> Energy:
        """Return itself: it depends on nothing but q."""
        return self

    def amounts(self, q: Array) -> Array:
        """Return q: there is nothing else to keep."""
        return q

    def save(self) -> None:
        """Nothing is remembered."""

    def restore(self, state: None) -> None:
        """Nothing is remembered."""

    @cached_property
    def _last(self) -> dict[str, tuple[Array, Array, Array]]:
        return {}

    def _powers(self, q: Array) -> tuple[_Power, _Power]:
        """Return both powers."""
        along = self.features.along(q)
        signed = along * self.signs[:, None].astype(along.dtype)
        form = self.features.summed(signed @ q)
        slope = form @ q
        bend = 4.0 * form + 8.0 * along.T @ signed
        return _Power.of(3, q, self.third.along(q)), _Power(4, float(slope @ q), 4.0 * slope, bend)

    def _beyond(self, q: Array, powers: tuple[_Power, _Power]) -> tuple[_Power, _Power]:
        """Return the powers, bent to parabolas along the rays beyond `reach`, with the wall in the third."""
        if self.reach is None:
            return powers
        scaled = q / self.reach
        t = float(np.linalg.norm(scaled))
        if t <= 1.0:
            return powers
        third, fourth = powers
        along = scaled / (self.reach * t)  # slope of t
        across = (np.diag(self.reach**-2.0) - np.outer(along, along)) / t
        s, firm = t - 1.0, WALL * float((self.reach**2).max())
        bend = firm * (2.0 * s * np.outer(along, along) + s * s * across)
        wall = _Power(0, firm * s**3 / 3.0, firm * s * s * along, bend)
        return third.bent(t, along, across).plus(wall), fourth.bent(t, along, across)


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

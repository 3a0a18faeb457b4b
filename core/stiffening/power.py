"""Power: a homogeneous power of amounts, with its slope and second derivative."""

from __future__ import annotations

from typing import NamedTuple

from ..arrays import Array


class Power(NamedTuple):
    """A power of q, or a sum of some: its value, slope (k,) and second derivative (k, k)."""

    value: float
    slope: Array
    bend: Array

    @classmethod
    def of(cls, power: int, q: Array, form: Array) -> Power:
        """Return the power whose second derivative is power (power - 1) times a form in q."""
        slope = form @ q
        return cls(float(slope @ q), power * slope, power * (power - 1) * form)

    def plus(self, other: Power) -> Power:
        """Return the sum with another."""
        return Power(self.value + other.value, self.slope + other.slope, self.bend + other.bend)

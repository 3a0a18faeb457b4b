"""Power: a homogeneous power of amounts, with its slope and second derivative, and what it may be weighed with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import Array


class Weight(NamedTuple):
    """A function of q: its value, slope (k,) and second derivative (k, k)."""

    value: float
    slope: Array
    bend: Array


class Power(NamedTuple):
    """A power of q: its value, slope (k,) and second derivative (k, k)."""

    value: float
    slope: Array
    bend: Array

    @classmethod
    def of(cls, power: int, q: Array, form: Array) -> Power:
        """Return the power whose second derivative is power (power - 1) times a form in q."""
        slope = form @ q
        return cls(float(slope @ q), power * slope, power * (power - 1) * form)

    def times(self, weight: Weight) -> Power:
        """Return the product with a function."""
        both = np.outer(self.slope, weight.slope)
        return Power(
            weight.value * self.value,
            weight.value * self.slope + self.value * weight.slope,
            weight.value * self.bend + both + both.T + self.value * weight.bend,
        )

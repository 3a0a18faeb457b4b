"""Damping: the powers of a series, which end as parabolas where they are followed too far."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array
from .power import Power

PRESSED = 0.2  # of t^2 that what presses bring most of counts for: there the series holds longer


@dataclass(frozen=True, eq=False)
class Damping:
    """Phi3 / (1 + t^4)^(1/4) and Phi4 / (1 + t^4)^(1/2), t^2 = q' M q.

    Near rest that is the series, to the fourth power of t. Far away both grow with t^2, as what linear tissue stores
    does: a third power that goes on growing makes tissue give way that is dragged no farther than friction drags it.
    It stays one energy: what is pressed on gets its work back.

    Attributes:
        reach: amounts about which the powers end, t = 1, shape (k,).
        press: what presses bring most of, over `reach`, of unit length, shape (k,); none where zero.
    """

    reach: Array
    press: Array

    @cached_property
    def metric(self) -> Array:
        """M, shape (k, k)."""
        along = self.press / self.reach
        return np.asarray(np.diag(self.reach**-2.0) - (1.0 - PRESSED) * np.outer(along, along))

    def weight(self, q: Array, share: float) -> tuple[float, Array]:
        """Return (1 + t^4)^-share and its slope in q, shape (k,)."""
        along = self.metric @ q
        value, first, _ = _weight(float(q @ along), share)
        return value, 2.0 * first * along

    def ended(self, q: Array, third: Power, fourth: Power) -> Power:
        """Return the sum of both powers at q, damped."""
        along = self.metric @ q
        square = float(q @ along)
        (a, a1, a2), (b, b1, b2) = _weight(square, 0.25), _weight(square, 0.5)
        first = 2.0 * (a1 * third.value + b1 * fourth.value)
        # what the second derivative has of products with the slope of t^2 is one symmetric product of two vectors
        other = 2.0 * (a1 * third.slope + b1 * fourth.slope + (a2 * third.value + b2 * fourth.value) * along)
        both = np.outer(other, along)
        bend = a * third.bend
        for more in (b * fourth.bend, first * self.metric, both, both.T):
            bend += more
        return Power(
            a * third.value + b * fourth.value, a * third.slope + b * fourth.slope + first * along, np.asarray(bend)
        )


def _weight(s: float, share: float) -> tuple[float, float, float]:
    """Return (1 + s^2)^-share and its first two derivatives."""
    u = 1.0 + s * s
    value = u**-share
    first = -2.0 * share * s * value / u
    return value, first, -2.0 * share * value / u + 4.0 * share * (share + 1.0) * s * s * value / (u * u)

"""Damping: the powers of a series, which end as parabolas where they are followed too far."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array
from .power import Power, Weight

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

    def damped(self, q: Array, third: Power, fourth: Power) -> tuple[Power, Power]:
        """Return both powers at q, damped."""
        along = self.metric @ q
        return third.times(self._weight(q, along, 0.25)), fourth.times(self._weight(q, along, 0.5))

    def weight(self, q: Array, share: float) -> Weight:
        """Return (1 + t^4)^-share and its derivatives."""
        return self._weight(q, self.metric @ q, share)

    def _weight(self, q: Array, along: Array, share: float) -> Weight:
        s = float(q @ along)  # t^2
        u = 1.0 + s * s
        first = -2.0 * share * s * u ** (-share - 1.0)
        second = -2.0 * share * u ** (-share - 1.0) + 4.0 * share * (share + 1.0) * s * s * u ** (-share - 2.0)
        return Weight(u**-share, 2.0 * first * along, np.outer(4.0 * second * along, along) + 2.0 * first * self.metric)

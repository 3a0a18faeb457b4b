"""The way to the safe state of a board that does not know one: driven there by the sender, at the device's speed."""

from __future__ import annotations

import numpy as np

from .gate import Gate
from .packets import Reach
from .wire import Array

SAFING_MOST = 0.06  # the way takes at most this long; then the safe values are driven at once [s]


class SafeWay:
    """From where a device was driven last to its safe values. Calibration has no say in it, speed has."""

    def __init__(self, gate: Gate, now: float) -> None:
        self._wire = gate.wire
        self._values: Array = gate.last.copy()
        self._started = self._time = now

    def step(self, now: float) -> tuple[Array, bool]:
        """Return what to drive now [units], and whether that is the safe state."""
        goal = self._wire.safe
        if self._wire.reach == Reach.AT_ONCE or now - self._started > SAFING_MOST:
            self._values = goal.copy()
        else:
            most = self._wire.slew * max(now - self._time, 1e-9)  # not 0: inf * 0 is no number
            self._values = self._values + np.clip(goal - self._values, -most, most)
        self._time = now
        return self._values, bool((np.abs(self._values - goal) < 1e-9).all())

"""The ramp to the safe state, for boards that do not go there alone.

The sender drives the board there at the declared speed, however long that takes. Only a device that is declared
`at_once`, such as a screen, goes there in one step.
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Array
from .output_limiter import OutputLimiter, way_seconds
from .protocols.packets import Reach
from .protocols.wire import SAFE_SWEEP, Wire

STUBBORN = 1.0  # [s] A link that has taken nothing for this long is given up.


class SafeRamp:
    """A straight line from the last driven values to the safe values.

    A command is due once a period. The calibration changes only the end of the line. A step that the link refused is
    repeated, so no jump follows after the link was full.

    Args:
        period: time between two commands [s]. now: time at which the ramp begins, which may lie in the future [s].

    Attributes:
        said: how often the safe state was written after the ramp had reached it.
        say_at: earliest time at which it may be written again [s].
    """

    def __init__(self, limiter: OutputLimiter, period: float, now: float) -> None:
        self._limiter, self._period = limiter, period
        limiter.plan(period)
        self._start = limiter.last
        self._begins = self._next = self._left = now
        self.said, self.say_at = 0, -math.inf

    @property
    def seconds(self) -> float:
        """How long the rest of the way takes [s]."""
        return way_seconds(self._limiter.wire.safe - self._limiter.last, speeds(self._limiter.wire, self._start))

    @property
    def there(self) -> bool:
        """Return whether the values driven last are the safe values."""
        return bool((np.abs(self._limiter.last - self._limiter.wire.safe) < 1e-9).all())

    def waits(self, now: float) -> bool:
        """Return whether the ramp has not begun yet."""
        return now < self._begins

    def due(self, now: float) -> bool:
        """Return whether the next command has to leave."""
        return now >= self._next

    def step(self, now: float) -> Array:
        """Return the values to drive now [units]; the limiter remembers them."""
        wire = self._limiter.wire
        return self._limiter.approach(wire.safe, speeds(wire, self._start), now)

    def sent(self, now: float) -> None:
        """Count the last step as sent."""
        self._left = now
        self._next = max(self._next + self._period, now)

    def undo(self) -> None:
        """Forget the last step: its command did not leave."""
        self._limiter.undo()

    def stuck(self, now: float) -> bool:
        """Return whether the link has taken nothing for `STUBBORN` seconds."""
        return now - self._left > STUBBORN


def speeds(wire: Wire, start: Array) -> Array:
    """Return how fast each channel may go to its safe value [units/s].

    That is the declared speed. A channel without one goes through its range in `SAFE_SWEEP`. A channel without a range
    goes its way from `start` in `SAFE_SWEEP`. A device declared `at_once` has no limit.
    """
    if wire.reach == Reach.AT_ONCE:
        return np.full(wire.count, np.inf)
    own = np.maximum(np.abs(wire.safe - start), 1e-12) / SAFE_SWEEP  # is finite for a channel without a range, too
    return np.where(np.isfinite(wire.safe_slew), wire.safe_slew, own)

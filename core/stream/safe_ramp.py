"""The way to the safe state of a board that does not know one: the sender drives it there, at the declared speed.

It takes as long as that takes. Only a device declared `at_once`, such as a screen, goes there in one step.
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Array
from .output_limiter import OutputLimiter, way_seconds
from .protocols.packets import Reach
from .protocols.wire import SAFE_SWEEP, Wire

STUBBORN = 1.0  # a link that takes nothing for this long will not [s]


class SafeRamp:
    """From where a device was driven last to its safe values, in a straight line, a command a period.

    Calibration has no say in the way, only in where it ends. A step that a link refused is repeated, so a link that
    was full does not make up for it by a jump.

    Args:
        period: between two commands [s]. now: when it begins, which may be later [s].

    Attributes:
        said: how often the safe state was said, once it was reached. say_at: when it may be said next [s].
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
        """Return whether the values driven last are the safe state."""
        return bool((np.abs(self._limiter.last - self._limiter.wire.safe) < 1e-9).all())

    def waits(self, now: float) -> bool:
        """Return whether it has not begun yet."""
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
        """Return whether the link has taken nothing for too long."""
        return now - self._left > STUBBORN


def speeds(wire: Wire, start: Array) -> Array:
    """Return how fast each channel may go [units/s]: as declared; without that, its range or its way in a second."""
    if wire.reach == Reach.AT_ONCE:
        return np.full(wire.count, np.inf)
    own = np.maximum(np.abs(wire.safe - start), 1e-12) / SAFE_SWEEP  # of a channel without a range, too
    return np.where(np.isfinite(wire.safe_slew), wire.safe_slew, own)

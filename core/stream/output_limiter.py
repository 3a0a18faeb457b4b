"""The last step before the wire: calibration, limits, slew and blend.

It applies to all values, whether a track or a person requests them.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from ..arrays import Array
from ..devices.response import Believed
from .protocols.wire import Wire

SLACK = 1e-9  # [1] relative rounding error that is no violation
PERIODS = 2.0  # [1] A step counts as at most this many planned periods, however late it is.
SLOWEST = 0.1  # [s] A step counts as at most this, or as two periods of the preset's own rate if they are longer.
LIMITS = ("range", "disc", "slew", "not_finite")

Blend = tuple[Array, float, float]  # the values at its start [units], the time passed [s], the time that it takes [s]
_State = tuple[Array, float, Blend | None, Believed | None]


class OutputLimiter:
    """Turns wanted values into driven values that keep the device's limits.

    Every value that a limit changes is counted; values that the slew limit changes during a blend are not.

    While the computer sleeps nobody moves the device, so neither slew nor blend may use that time. Every step therefore
    counts as a limited time, see `PERIODS` and `SLOWEST`. A late command makes a movement longer, and its step no
    larger than that time allows.

    Args:
        period: planned time between commands [s]; without it that of the device's rate.

    Attributes:
        last: the values driven last [units], shape (channels,).
    """

    def __init__(self, wire: Wire, period: float | None = None) -> None:
        self.wire = wire
        self._period = period or 1.0 / wire.spec.rate
        self._counts = {kind: np.zeros(wire.count, np.int64) for kind in LIMITS}
        self.last: Array = self.driven(wire.rest)
        self._time = -np.inf
        self._blend: Blend | None = None
        self._believed: Believed | None = None
        self._before: _State = (self.last, self._time, self._blend, self._believed)

    @property
    def limited(self) -> Counter[str]:
        """How many values the limits changed, by 'channel.kind'.

        The kinds are 'range', 'disc', 'slew' and 'not_finite'.
        """
        names = self.wire.names
        return Counter(
            {
                f"{names[i]}.{kind}": int(counts[i])
                for kind, counts in self._counts.items()
                for i in np.flatnonzero(counts)
            }
        )

    def driven(self, wanted: Array) -> Array:
        """Return calibrated values within the limits, without counting."""
        wire = self.wire
        driven = wire.responses.driven(wire.zero + wire.gain * wanted, None, wanted)[0]
        return np.minimum(np.maximum(driven, wire.lower_limit), wire.upper_limit)

    def plan(self, period: float) -> None:
        """Take another planned period between commands [s]."""
        self._period = period

    def begin(self, pose: Array, time: float, seconds: float) -> None:
        """Start from a pose [units], and blend from it to the wanted values.

        The blend takes `seconds`, and no channel goes faster than its slew limit. A pose outside the limits is left at
        that speed, too, and not at once.
        """
        self.last = np.where(np.isfinite(pose), pose, self.driven(self.wire.rest))
        self._time = time
        self._blend = (self.last.copy(), 0.0, seconds) if seconds > 0 else None
        self._believe()
        self._before = (self.last, self._time, self._blend, self._believed)

    def blend(self, time: float, seconds: float) -> None:
        """Blend from the values driven last to other wanted values.

        If a blend under way has longer to go than `seconds`, the new one takes that time.
        """
        left = 0.0 if self._blend is None else self._blend[2] - self._blend[1]
        self.begin(self.last, time, max(seconds, left))

    def undo(self) -> None:
        """Forget the last step: its command did not leave."""
        self.last, self._time, self._blend, self._believed = self._before

    def step(self, wanted: Array, time: float) -> Array:
        """Return the values to drive at a time [s], and remember them.

        No time may be earlier than the one before it.
        """
        wire = self.wire
        elapsed = self._credit(time)
        driven = wire.zero + wire.gain * wanted
        past = np.zeros(0)
        if wire.responses:
            if wire.disc is not None and np.isfinite(driven).all():
                driven = self._disc(driven, wire.disc)  # the actuators must not reach beyond the disc
            driven, past = wire.responses.driven(driven, self._believed, self.last)
        finite = np.isfinite(driven)
        if not finite.all():
            self._counts["not_finite"] += ~finite
            driven = np.where(finite, driven, self.last)
        bounded = np.minimum(np.maximum(driven, wire.lower_limit), wire.upper_limit)
        if not (bounded == driven).all() or past.any():
            # A rounding error of the preset's units must not be counted.
            past = np.maximum(np.abs(bounded - driven), past) if past.size else np.abs(bounded - driven)
            self._counts["range"] += past > SLACK * np.maximum(np.abs(bounded), 1e-3)
        if wire.disc is not None:
            bounded = self._disc(bounded, wire.disc)
        blending = self._blend is not None
        if self._blend is not None:
            start, through, seconds = self._blend
            through += elapsed
            part = through / seconds
            if part >= 1 - SLACK:
                self._blend, blending = None, False
            else:
                self._blend = (start, through, seconds)
                bounded = start + (bounded - start) * (part * part * (3 - 2 * part))
        most = wire.slew * max(elapsed, 1e-9)  # not 0, because inf * 0 is NaN
        change = bounded - self.last
        allowed = np.minimum(np.maximum(change, -most), most)
        fast = np.abs(change) > most * (1 + 1e-6) + 1e-12
        if fast.any():
            if not blending:
                self._counts["slew"] += fast
            bounded = np.where(fast, self.last + allowed, bounded)
        self.last = bounded
        self._believe()
        return bounded

    def approach(self, goal: Array, slew: Array, time: float) -> Array:
        """Step straight towards driven values [units], and remember the step.

        No channel goes faster than `slew` [units/s], and all channels arrive together. A straight line stays inside
        every range and every round range that contains both its ends.
        """
        elapsed, self._blend = self._credit(time), None
        seconds = way_seconds(goal - self.last, slew)
        self.last = goal.copy() if seconds <= elapsed else self.last + (goal - self.last) * (elapsed / seconds)
        self._believe()
        return self.last

    def recalibrate(self, wire: Wire) -> None:
        """Take the device with another calibration.

        The actuators' positions by the old measured curves are forgotten: the new curves estimate them from `last`.
        """
        self.wire, self._believed = wire, None
        self._believe()

    def _believe(self) -> None:
        """Estimate the actuators' positions by their measured curves.

        The estimate takes into account that `last` was driven now.
        """
        if self.wire.responses:
            self._believed = self.wire.responses.believe(self.last, self._believed)

    def _credit(self, time: float) -> float:
        """Return how long a step at a time [s] counts [s].

        It also saves the state before the step, for `undo`.
        """
        self._before = (self.last, self._time, self._blend, self._believed)
        most = min(PERIODS * self._period, max(SLOWEST, PERIODS / self.wire.spec.rate))
        elapsed = min(max(time - self._time, 0.0), most)
        self._time = time
        return elapsed

    def _disc(self, values: Array, disc: tuple[int, int, float]) -> Array:
        i, j, radius = disc
        reach = float(np.hypot(values[i], values[j]))
        if reach <= radius * (1 + SLACK):
            return values
        values = values.copy()
        values[[i, j]] *= radius / reach
        self._counts["disc"][i] += 1
        return values


def way_seconds(way: Array, slew: Array) -> float:
    """Return how long a way takes [s] at its highest speed.

    Args:
        way: change of each channel [units]. slew: highest speed of each channel [units/s].
    """
    return float(np.max(np.abs(way) / slew, initial=0.0))

"""Which samples are due: one a period, ahead of their time where the device can hold them."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

MARGIN = 0.25  # part of the look-ahead below which a sample is left out rather than late [1]


class SampleClock:
    """A grid of moments, one a period; moments that this process slept through are left out, and counted.

    Attributes:
        period: [s]. next: moment of the next sample [s]. skipped: samples left out.
        lateness: delay of the samples after their planned times [s].
    """

    def __init__(self, rate: float) -> None:
        self.period = 1.0 / rate
        self.next = 0.0
        self.skipped = 0
        self.lateness = Lateness()
        self._ahead = False

    def start(self, moment: float, horizon: float) -> None:
        """Begin with the sample of a moment."""
        self.next, self._ahead = moment, horizon > 0

    def due(self, now: float, horizon: float) -> Iterator[float]:
        """Yield the moments whose samples have to leave now; one counts as sent when the next is asked for.

        Args:
            horizon: how far ahead of their moment samples leave [s]; 0: the newest value, at once.
        """
        began, self._ahead = horizon > 0 and not self._ahead, horizon > 0
        if horizon and self.next < now + MARGIN * horizon:
            # A playback has just begun, or this process was kept from working: samples too late are left
            # out. The device gets the rest of the look-ahead back as fast as the link takes it.
            self._leave_out(math.ceil((now + MARGIN * horizon - self.next) / self.period), counted=not began)
        elif not horizon and self.next < now - 2 * self.period:  # late: the newest value is the best one
            self._leave_out(int((now - self.next) / self.period), counted=True)
        while self.next <= now + horizon:
            yield self.next
            self.sent(now, horizon)

    def sent(self, now: float, horizon: float) -> None:
        """Count the next sample as sent."""
        self.lateness.add(now + horizon - self.next)
        self.next += self.period

    def _leave_out(self, count: int, *, counted: bool) -> None:
        self.next += count * self.period
        if counted:
            self.skipped += count


class Lateness:
    """How much later than planned things were, over the last few thousand."""

    def __init__(self, size: int = 4096) -> None:
        self._ring = np.zeros(size)
        self.count = 0

    def add(self, seconds: float) -> None:
        """Take one."""
        self._ring[self.count % len(self._ring)] = seconds
        self.count += 1

    def percentiles(self) -> tuple[float, float]:
        """Return the median and the 99th percentile [s]; NaN before the first."""
        if not self.count:
            return float("nan"), float("nan")
        p50, p99 = np.percentile(self._ring[: min(self.count, len(self._ring))], (50, 99))
        return float(p50), float(p99)

"""The clock that says which samples are due.

One sample is due a period. Samples leave ahead of their time if the device can hold them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

MARGIN = 0.25  # [1] A sample is left out if less than this part of the look-ahead remains until its time.


class SampleClock:
    """A grid of moments, one a period.

    Moments that this process slept through are left out and counted. Moments left out because samples begin to leave
    ahead of their time are not counted.

    Attributes:
        period: time between two moments [s]. next: moment of the next sample [s]. skipped: number of samples left out.
        lateness: delay of the samples after their planned times [s].
    """

    def __init__(self, rate: float) -> None:
        self.period = 1.0 / rate
        self.next = 0.0
        self.skipped = 0
        self.lateness = Lateness()
        self._ahead = False

    def start(self, moment: float, horizon: float) -> None:
        """Begin with the sample of a moment [s]."""
        self.next, self._ahead = moment, horizon > 0

    def due(self, now: float, horizon: float) -> Iterator[float]:
        """Yield the moments whose samples have to leave now [s].

        A moment counts as sent when the caller requests the next one.

        Args:
            horizon: how far ahead of their moments samples leave [s]; 0: at their moments.
        """
        began, self._ahead = horizon > 0 and not self._ahead, horizon > 0
        if horizon and self.next < now + MARGIN * horizon:
            # A playback has just begun, or this process could not run for a while. Samples that would be too late are
            # left out. The others leave as fast as the link takes them, so the device soon holds the look-ahead again.
            self._leave_out(math.ceil((now + MARGIN * horizon - self.next) / self.period), counted=not began)
        elif not horizon and self.next < now - 2 * self.period:  # late: older values than the newest have no use
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
    """Delays of the last few thousand samples after their planned times."""

    def __init__(self, size: int = 4096) -> None:
        self._ring = np.zeros(size)
        self.count = 0

    def add(self, seconds: float) -> None:
        """Take one delay [s]."""
        self._ring[self.count % len(self._ring)] = seconds
        self.count += 1

    def percentiles(self) -> tuple[float, float]:
        """Return the median and the 99th percentile [s]; NaN before the first."""
        if not self.count:
            return float("nan"), float("nan")
        p50, p99 = np.percentile(self._ring[: min(self.count, len(self._ring))], (50, 99))
        return float(p50), float(p99)

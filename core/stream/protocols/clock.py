"""Time: where the track is while Blender plays, what a device's clock shows, how late the sender was."""

from __future__ import annotations

from collections import deque

import numpy as np

LEAD = 0.1  # how far the track may run ahead of the last frame that Blender showed [s]
JUMP = 0.25  # a frame further off than this is a jump, not a playback that is a little late [s]


class TrackClock:
    """Follows a playback that reports its time a frame at a time, and gives the time in between.

    Attributes:
        free: run on where no frame arrives, instead of waiting `LEAD` behind the last one.
    """

    def __init__(self, *, free: bool = False) -> None:
        self.free = free
        self.running = False
        self._at = 0.0  # track time ...
        self._when = 0.0  # ... at this moment
        self._speed = 1.0
        self._shown, self._seen = 0.0, 0.0  # last frame's time, and when it came

    def report(self, time: float, playing: bool, now: float) -> None:
        """Take what Blender shows at this moment: track time [s] and whether it plays."""
        if not playing:
            self.running, self._at, self._when, self._shown, self._seen = False, time, now, time, now
            return
        if self.running and time == self._shown:
            return  # the same frame is still on the screen
        error = time - self.at(now, now)
        if not self.running or abs(error) > JUMP:
            self._at, self._when, self._speed = time, now, 1.0
        else:
            period = max(now - self._seen, 1e-3)
            self._at, self._when = self.at(now, now) + 0.1 * error, now
            self._speed = min(max(self._speed + 0.02 * error / period, 0.05), 2.0)
        self.running, self._shown, self._seen = True, time, now

    def at(self, moment: float, now: float) -> float:
        """Return the track time at a moment, not before `now`."""
        if not self.running:
            return self._at
        time = self._at + (moment - self._when) * self._speed
        return time if self.free else min(time, self._shown + LEAD + max(moment - now, 0.0))


class DeviceClock:
    """A device's 32-bit microsecond counter in terms of the host's clock, kept by round trips."""

    MEMORY = 48

    def __init__(self) -> None:
        self._samples: deque[tuple[float, float, float]] = deque(maxlen=self.MEMORY)  # round trip, offset, when
        self._last: int | None = None

    @property
    def known(self) -> bool:
        """Return whether there has been a round trip."""
        return bool(self._samples)

    def reply(self, sent: float, received: float, device_us: int) -> None:
        """Take a reply: when it was asked and received [s of the host], and the device's counter."""
        if self._last is None:
            whole = device_us
        else:  # the counter overflows every 71.6 minutes
            whole = self._last + ((device_us - self._last + 2**31) % 2**32 - 2**31)
        self._last = whole
        self._samples.append((received - sent, whole * 1e-6 - 0.5 * (sent + received), received))

    def device_us(self, moment: float) -> int:
        """Return the device's counter at a moment of the host [s], modulo 2^32."""
        # The shortest round trip of the last second or so says most about the offset.
        offset = min(self._samples)[1]
        return round((moment + offset) * 1e6) % 2**32


class RoundTrips:
    """How long answers take by themselves, so that what lies before them in a queue can be told from it.

    Only an idle link shows that; a queue that lasts would be taken for the way itself.

    Attributes:
        shortest: of all [s]; 0 before the first.
        usual: all but the longest of the last idle ones [s]: an adapter may hold answers back for some milliseconds.
    """

    MEMORY = 48
    SPREAD = 0.02  # answers that vary by more than this vary for another reason [s]

    def __init__(self) -> None:
        self._idle: deque[float] = deque(maxlen=self.MEMORY)
        self.shortest = self.usual = 0.0

    def add(self, seconds: float, *, idle: bool) -> None:
        """Take one; `idle`: nothing else was sent."""
        self.shortest = min(self.shortest, seconds) if self.shortest else seconds
        if idle:
            self._idle.append(seconds)
        longest = sorted(self._idle)[-2:]
        self.usual = min(max(longest[0] if longest else 0.0, self.shortest), self.shortest + self.SPREAD)


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

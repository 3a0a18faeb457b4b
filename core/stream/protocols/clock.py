"""The reading of a device's clock, and the time that its answers take."""

from __future__ import annotations

from collections import deque


class DeviceClock:
    """A device's 32-bit microsecond counter in terms of the host's clock, kept by round trips.

    Each round trip bounds the offset between the two clocks: the counter was read after the question and before the
    answer. A reply outside the bounds of those before shows that the counter stood still or jumped. One such reply may
    have been read late by a sender that was kept from working; after a second one the earlier replies are forgotten.

    Attributes:
        jumps: how often the counter was found to have stood still or jumped.
    """

    MEMORY = 48
    TOLERANCE = 0.1  # no board's clock is further off: an RC oscillator that nobody calibrated (ATmega328P) [1]
    RESOLUTION = 2e-6  # [s]
    UNSTEADY, WITHIN = 3, 10.0  # so many jumps within this time [s]: not a clock that commands can be timed by

    def __init__(self) -> None:
        self._samples: deque[tuple[float, float, float]] = deque(maxlen=self.MEMORY)  # round trip, offset, when
        self._last: int | None = None
        self._low = self._high = self._when = 0.0  # bounds of the offset, and since when at most [s]
        self._stray: float | None = None  # when a reply outside the bounds was received [s]
        self._jumped: deque[float] = deque(maxlen=self.UNSTEADY)
        self.jumps = 0

    @property
    def known(self) -> bool:
        """Return whether there has been a round trip."""
        return bool(self._samples)

    def steady(self, now: float) -> bool:
        """Return whether commands can be timed by it: it does not stand still, or jump again and again."""
        return len(self._jumped) < self.UNSTEADY or now - self._jumped[0] > self.WITHIN

    def forget(self) -> None:
        """Forget all round trips: the clocks are synchronised anew by the next one."""
        self._samples.clear()
        self._stray = None

    def reply(self, sent: float, received: float, device_us: int) -> None:
        """Take a reply: when it was asked and received [s of the host], and the device's counter."""
        if self._last is None:
            whole = device_us
        else:  # the counter overflows every 71.6 minutes
            whole = self._last + ((device_us - self._last + 2**31) % 2**32 - 2**31)
        self._last = whole
        low, high = whole * 1e-6 - received, whole * 1e-6 - sent
        if self._samples:
            spread = self.TOLERANCE * (received - self._when) + self.RESOLUTION
            least, most = self._low - spread, self._high + spread
            if high < least or low > most:
                if self._stray is None or received == self._stray:
                    self._stray = received
                    return
                self.forget()
                self.jumps += 1
                self._jumped.append(received)
            else:
                low, high = max(low, least), min(high, most)
        self._low, self._high, self._when, self._stray = low, high, sent, None
        self._samples.append((received - sent, whole * 1e-6 - 0.5 * (sent + received), received))

    def device_us(self, moment: float) -> int:
        """Return the device's counter at a moment of the host [s], modulo 2^32."""
        # The shortest round trip of the last second or so says most about the offset.
        offset = min(self._samples)[1]
        return round((moment + offset) * 1e6) % 2**32


class RoundTrips:
    """How long answers take by themselves, so that a delay by a queue before them can be told apart.

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

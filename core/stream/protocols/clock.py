"""Estimates of a device's clock and of the round-trip time."""

from __future__ import annotations

from collections import deque


class DeviceClock:
    """The relation of a device's counter to the host's clock.

    The counter has 32 bits and counts microseconds.

    Each round trip bounds the offset between the two clocks: the counter was read after the question was sent and
    before the answer arrived. A reply outside the bounds of the earlier replies shows that the counter stood still or
    jumped. One such reply is ignored, because a sender that was kept from running may have read it late. After a
    second one the earlier replies are forgotten.

    Attributes:
        jumps: number of times that the counter was found to have stood still or jumped.
    """

    MEMORY = 48  # [1] replies that are remembered
    TOLERANCE = 0.1  # [1] largest rate error of a board's clock: an uncalibrated RC oscillator (ATmega328P)
    RESOLUTION = 2e-6  # [s] allowance for the rounding of the counter
    UNSTEADY, WITHIN = 3, 10.0  # [1] and [s]: a clock with so many jumps within this time cannot time commands

    def __init__(self) -> None:
        # [s] round trip, offset, time of arrival.
        self._samples: deque[tuple[float, float, float]] = deque(maxlen=self.MEMORY)
        self._last: int | None = None
        self._low = self._high = self._when = 0.0  # [s] bounds of the offset, and time from which they widen
        self._stray: float | None = None  # [s] arrival of a reply outside the bounds
        self._jumped: deque[float] = deque(maxlen=self.UNSTEADY)
        self.jumps = 0

    @property
    def known(self) -> bool:
        """Return whether there has been a round trip since the last reset."""
        return bool(self._samples)

    def steady(self, now: float) -> bool:
        """Return whether the clock can time commands.

        A clock that stands still, or jumps again and again, cannot.
        """
        return len(self._jumped) < self.UNSTEADY or now - self._jumped[0] > self.WITHIN

    def forget(self) -> None:
        """Forget all round trips; the next one synchronises the clocks again."""
        self._samples.clear()
        self._stray = None

    def reply(self, sent: float, received: float, device_us: int) -> None:
        """Add a round trip.

        Args:
            sent, received: host times of question and answer [s]. device_us: counter of the device [us].
        """
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
        """Return the device's counter at a host time [s], modulo 2^32."""
        # The shortest round trip that is remembered bounds the offset most tightly.
        offset = min(self._samples)[1]
        return round((moment + offset) * 1e6) % 2**32


class RoundTrips:
    """Round-trip times without queues, for comparison with delayed answers.

    They are measured while the link is idle. On a busy link a lasting queue would count as a part of the round trip.

    Attributes:
        shortest: shortest round trip of all [s]; 0 before the first.
        usual: second longest of the last idle round trips [s]: a USB adapter may hold answers back for some
            milliseconds. It exceeds `shortest` by at most `SPREAD`.
    """

    MEMORY = 48  # [1] idle round trips that are remembered
    SPREAD = 0.02  # [s] answers that vary by more than this vary for another reason

    def __init__(self) -> None:
        self._idle: deque[float] = deque(maxlen=self.MEMORY)
        self.shortest = self.usual = 0.0

    def add(self, seconds: float, *, idle: bool) -> None:
        """Add a round trip [s].

        `idle`: the device was not armed, so no commands were sent.
        """
        self.shortest = min(self.shortest, seconds) if self.shortest else seconds
        if idle:
            self._idle.append(seconds)
        longest = sorted(self._idle)[-2:]
        self.usual = min(max(longest[0] if longest else 0.0, self.shortest), self.shortest + self.SPREAD)

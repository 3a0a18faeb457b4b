"""A simulated Pololu Maestro."""

from __future__ import annotations

import numpy as np

from ..protocols.wire import Wire


class MaestroDevice:
    """A Pololu Maestro without a serial time-out: targets in quarter microseconds; 0: no pulses.

    A servo starts at the preset's rest, and stays where it is while it gets no pulses.
    """

    datagrams = False

    def __init__(self, wire: Wire, *, stuck: int = -1, low_us: float = 1000.0, high_us: float = 2000.0) -> None:
        self.wire = wire
        self.targets = np.zeros(24, int)
        self.errors = 0
        self._low, self._high, self._stuck = 4 * low_us, 4 * high_us, stuck
        self._bytes: list[int] = []
        self._values = wire.rest.copy()

    def feed(self, data: bytes, now: float) -> list[bytes]:
        """Take bytes: a command byte has its highest bit set, data bytes have not."""
        for byte in data:
            if byte & 0x80:
                self.errors += bool(self._bytes)
                self._bytes = [byte]
            elif self._bytes:
                self._bytes.append(byte)
            else:
                self.errors += 1
            if len(self._bytes) == 4 and self._bytes[0] == 0x84:
                _, channel, low, high = self._bytes
                if channel < 24 and channel != self._stuck:
                    self.targets[channel] = low | high << 7
                    self._move()
                self._bytes = []
        return []

    def tick(self, now: float) -> list[bytes]:
        """Do nothing: it keeps its pulses for ever, which is the danger."""
        return []

    def report(self) -> dict[str, object]:
        """Return where the servos are."""
        return {
            "values": self.wire.named(self._values),
            "errors": self.errors,
            "released": bool((self.targets[: self.wire.count] == 0).all()),
        }

    def _move(self) -> None:
        """Put every servo that gets pulses where they say."""
        targets, low, high = self.targets[: self.wire.count], self.wire.range_low, self.wire.range_high
        at = low + (high - low) * np.clip((targets - self._low) / (self._high - self._low), 0, 1)
        self._values = np.where(targets == 0, self._values, at)

"""A simulated receiver of Blender Servo Animation, with its defects."""

from __future__ import annotations

import numpy as np

from ..protocols.wire import Wire


class ServoAnimationDevice:
    """A receiver of Blender Servo Animation.

    Every byte 0x3C begins a new command, even within a position.
    """

    datagrams = False

    def __init__(self, wire: Wire, *, stuck: int = -1, low: float = 1000.0, high: float = 2000.0) -> None:
        self.wire = wire
        self.positions: dict[int, int] = {}
        self.log: list[tuple[int, int]] = []
        self._low, self._high, self._stuck = low, high, stuck
        self._values, self._index = [0] * 5, 0

    def feed(self, data: bytes, now: float) -> list[bytes]:
        """Process received bytes as the original does."""
        for byte in data:
            if byte == 0x3C:
                self._values, self._index = [0] * 5, 0
            if self._index < 5:
                self._values[self._index] = byte
                self._index += 1
                start, servo, high, low, end = self._values
                if start == 0x3C and end == 0x3E and self._index == 5 and servo != self._stuck:
                    self.positions[servo] = high << 8 | low
                    if len(self.log) < 1_000_000:
                        self.log.append((servo, high << 8 | low))
        return []

    def tick(self, now: float) -> list[bytes]:
        """Do nothing: it has no watchdog."""
        return []

    def report(self) -> dict[str, object]:
        """Return the values of the servos.

        A servo that has received no position is at the preset's rest.
        """
        ids = [i for i in range(256) if i != 60][: self.wire.count]
        low, span = self.wire.range_low, self.wire.range_high - self.wire.range_low
        at = [(self.positions.get(i, np.nan) - self._low) / (self._high - self._low) for i in ids]
        return {"values": self.wire.named(np.where(np.isnan(at), self.wire.rest, low + span * at))}

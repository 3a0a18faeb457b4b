"""Pololu Maestro servo controllers, compact protocol: 0x84, channel, target's low and high seven bits.

Targets are quarter microseconds. Source: Pololu Maestro Servo Controller User's Guide, sections 5.b and 5.e
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...errors import DermisError
from .adapter import Adapter
from .packets import Reach
from .wire import Wire

SET_TARGET = 0x84
CHANNELS = 24  # of the largest one
REFRESH = 0.03  # targets that do not change are repeated this often: well within the board's time-out of 0.1 s [s]


class Maestro(Adapter):
    """Pololu Maestro. Channel k of the device is channel `first` + k of the board."""

    name, title = "maestro", "Pololu Maestro"
    caution = (
        "This board keeps its last pulses when the computer falls silent. Set 'Serial timeout' in the Maestro "
        "Control Center to 0.1 s and what each servo does on error, or keep a switch at hand."
    )
    OPTIONS = ("first", "pulse_low_us", "pulse_high_us", "silence", "silence_ms")

    def __init__(self, wire: Wire, options: Mapping[str, str]) -> None:
        super().__init__(wire, options)
        wire.need_ranges(self.title)
        if wire.count > CHANNELS:
            raise DermisError(
                "more channels than a Maestro has", where=wire.spec.name, value=wire.count, limit=str(CHANNELS)
            )
        self.first = self.whole("first", 0, 0, CHANNELS - wire.count)
        self.command_bytes = wire.count * len(target(0, 0))  # where all of them change
        self.low, self.high = (4 * self.number(f"pulse_{n}_us", d) for n, d in (("low", 1000), ("high", 2000)))
        if not 4 * 64 <= self.low < self.high <= 4 * 4080:
            raise DermisError(
                "impossible pulses",
                where=self.title,
                value=f"{self.low / 4:g} to {self.high / 4:g} us",
                limit="64 to 4080 us, low below high",
            )
        self._sent = np.full(wire.count, -1)
        self._when = -1.0

    def forget(self) -> None:
        """Send every position with the next command, changed or not."""
        self._sent[:] = -1

    def command(self, values: Array, now: float, play: float | None) -> list[bytes]:
        """Return one Set Target for each channel that changed; all of them now and then."""
        targets = self._targets(values)
        if now - self._when > REFRESH:
            changed, self._when = np.arange(len(targets)), now
        else:
            changed = np.flatnonzero(targets != self._sent)
        self._sent = targets
        message = b"".join(target(self.first + int(i), int(targets[i])) for i in changed)
        return [message] if message else []

    def carried(self, values: Array) -> Array:
        """Return the values of the targets, in whole quarter microseconds."""
        part = (self._targets(values) - self.low) / (self.high - self.low)
        return self.wire.range_low + (self.wire.range_high - self.wire.range_low) * part

    def _targets(self, values: Array) -> NDArray[np.int_]:
        part = (values - self.wire.range_low) / (self.wire.range_high - self.wire.range_low)
        return np.rint(self.low + (self.high - self.low) * np.clip(part, 0, 1)).astype(int)

    def safe(self) -> list[bytes]:
        """Return the end of all pulses where the safe state is to let go; else the pose already is the safe one."""
        super().safe()
        self._sent[:] = -1
        if self.wire.reach != Reach.RELEASE:
            return []
        return [b"".join(target(self.first + i, 0) for i in range(self.wire.count))]


def target(channel: int, quarter_us: int) -> bytes:
    """Return Set Target; 0 stops the pulses."""
    return bytes((SET_TARGET, channel, quarter_us & 0x7F, quarter_us >> 7 & 0x7F))

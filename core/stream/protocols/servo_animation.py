"""Receivers of the live mode of Blender Servo Animation.

A command has the bytes 0x3C, servo id, position high, position low, 0x3E. A receiver begins a new command at every byte
0x3C, so a command with servo id 60, or with a position that has a byte of 60, is never obeyed. Such a position is
replaced by the nearest one without that byte, and counted; id 60 is not used.
Source: Servo Animation 2.x, its Arduino library's Command::write
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...arrays import Array
from ...errors import DermisError
from .adapter import Adapter
from .packets import Reach
from .wire import Wire

START, END, TRAP = 0x3C, 0x3E, 0x3C
REFRESH = 0.1  # [s] time after which positions are sent again even if they did not change
MAX_POSITION = 32767  # largest position: an int of the receiver has 16 bits


class ServoAnimation(Adapter):
    """Blender Servo Animation.

    Options: `first`: id of the first servo. `position_low`, `position_high`: positions at a channel's low and high.
    """

    name, title = "servo-animation", "Blender Servo Animation"
    caution = (
        "This receiver has no watchdog and no check sum: it keeps its last positions when the computer falls "
        "silent. Keep a switch in the servos' supply at hand."
    )
    OPTIONS = ("first", "position_low", "position_high", "silence", "silence_ms")

    def __init__(self, wire: Wire, options: Mapping[str, str]) -> None:
        super().__init__(wire, options)
        wire.need_ranges(self.title)
        ids = [i for i in range(256) if i != TRAP]
        if wire.count > len(ids):
            raise DermisError(
                "more channels than servo ids",
                where=wire.spec.name,
                value=wire.count,
                limit=f"{len(ids)}: 0 to 255 without {TRAP}",
            )
        first = self.whole("first", 0, 0, ids[len(ids) - wire.count])
        self.ids = [i for i in ids if i >= first][: wire.count]
        self.command_bytes = wire.count * len(command(0, 0))  # if all positions change
        self.low, self.high = (
            self.whole("position_low", 1000, 0, MAX_POSITION),
            self.whole("position_high", 2000, 0, MAX_POSITION),
        )
        if self.low == self.high:
            raise DermisError(
                "both ends of a range have one position",
                where=self.title,
                value=self.low,
                remedy="Give position_low and position_high two values",
            )
        if wire.reach == Reach.RELEASE:
            self.caution += " Its protocol has no word for letting go, so the safe pose is held, not released."
        self._sent = np.full(wire.count, -1)
        self._when = -1.0

    def forget(self) -> None:
        """Make the next command send every position, changed or not."""
        self._sent[:] = -1

    def command(self, values: Array, now: float, play: float | None) -> list[bytes]:
        """Return one command for each servo whose position changed.

        After every `REFRESH` seconds there is one for each servo.
        """
        wanted = self._wanted(values)
        positions = np.rint(wanted).astype(int)
        if now - self._when > REFRESH:
            due, self._when = np.arange(len(positions)), now
        else:
            due = np.flatnonzero(positions != self._sent)
        self._sent = positions
        out = []
        for i in due:
            position = around_trap(float(wanted[i]))
            self.counters["positions moved off the byte 0x3C"] += int(position != positions[i])
            out.append(command(self.ids[i], position))
        return [b"".join(out)] if out else []

    def carried(self, values: Array) -> Array:
        """Return the values of the positions that are sent [units]."""
        wanted = self._wanted(values)
        positions = np.array([around_trap(one) for one in wanted.ravel().tolist()], np.float64).reshape(wanted.shape)
        part = (positions - self.low) / (self.high - self.low)
        return self.wire.range_low + (self.wire.range_high - self.wire.range_low) * part

    def _wanted(self, values: Array) -> Array:
        part = np.clip((values - self.wire.range_low) / (self.wire.range_high - self.wire.range_low), 0.0, 1.0)
        return self.low + (self.high - self.low) * part


def command(servo: int, position: int) -> bytes:
    """Return the command that moves one servo."""
    return bytes((START, servo, position >> 8, position & 0xFF, END))


def around_trap(wanted: float) -> int:
    """Return the nearest position to a wanted one, without a byte of 60."""
    nearest = round(wanted)
    if nearest >> 8 == TRAP:
        low, high = (TRAP << 8) - 1, (TRAP + 1) << 8
    elif nearest & 0xFF == TRAP:
        low, high = nearest - 1, nearest + 1
    else:
        return nearest
    return low if wanted - low <= high - wanted else high

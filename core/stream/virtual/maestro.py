"""A simulated Pololu Maestro."""

from __future__ import annotations

import math

import numpy as np

from ..protocols.maestro_commands import CHANNELS, GET_ERRORS, GET_POSITION, POLOLU, SET_TARGET, crc7
from ..protocols.wire import Wire

DATA = {SET_TARGET: 3, GET_POSITION: 1, GET_ERRORS: 0}  # supported command -> number of its data bytes
CRC_ERROR, PROTOCOL_ERROR, TIMEOUT = 1 << 3, 1 << 4, 1 << 5  # bits of the error register


class MaestroDevice:
    """A Pololu Maestro, whose targets are in quarter microseconds; 0: no pulses.

    A servo starts at the preset's rest, and keeps its pose while it gets no pulses.

    Args:
        wire: description of the device. stuck: index of a servo that does not move; -1: none.
        low_us, high_us: pulse widths at a channel's low and high [us].
        crc: whether each command must end with its CRC-7. number: device number of the Pololu protocol; the compact
            protocol is supported, too.
        timeout: serial time-out [s]; 0: none, which is a danger, since the board then keeps its pulses in silence.
        home: targets after an error, shape (channels,). The default is the safe pose with a time-out; without one the
            targets are kept, the board's setting 'Ignore'.
    """

    datagrams = False

    def __init__(
        self,
        wire: Wire,
        *,
        stuck: int = -1,
        low_us: float = 1000.0,
        high_us: float = 2000.0,
        crc: bool = False,
        number: int = 12,
        timeout: float = 0.0,
        home: list[int] | None = None,
    ) -> None:
        self.wire = wire
        self.targets = np.zeros(CHANNELS, int)
        self.errors = self.register = 0
        self._low, self._high, self._stuck = 4 * low_us, 4 * high_us, stuck
        self._crc, self._number, self._timeout, self._home = crc, number, timeout, home
        self._bytes: list[int] = []
        self._values = wire.rest.copy()
        self._heard = -math.inf  # [s] time of the last valid command
        self._timed_out = False
        if home is None and timeout:
            part = (wire.safe - wire.range_low) / (wire.range_high - wire.range_low)
            self._home = np.rint(self._low + (self._high - self._low) * part).astype(int).tolist()
        self._go_home()

    def feed(self, data: bytes, now: float) -> list[bytes]:
        """Process received bytes; return the answers.

        The highest bit of a command byte is set, and that of a data byte is not.
        """
        self.tick(now)
        out = []
        for byte in data:
            if byte & 0x80:
                if self._bytes and self._bytes != [POLOLU]:  # this byte alone serves to detect the baud rate
                    self.fail(PROTOCOL_ERROR)
                self._bytes = [byte]
            elif self._bytes:
                self._bytes.append(byte)
            else:
                self.fail(PROTOCOL_ERROR)
            length = self._length()
            if length and len(self._bytes) == length:
                command, self._bytes = bytes(self._bytes), []
                if answer := self._do(command, now):
                    out.append(answer)
        return out

    def tick(self, now: float) -> list[bytes]:
        """Report an error once no valid command has arrived for the time-out.

        Without a time-out nothing happens.
        """
        if self._timeout and not self._timed_out and now - self._heard >= self._timeout:
            self._timed_out = True
            self.fail(TIMEOUT)
        return []

    def fail(self, bits: int) -> None:
        """Set bits of the error register, and send the servos to `home`."""
        self.errors += bits != TIMEOUT
        self.register |= bits
        self._go_home()

    def report(self) -> dict[str, object]:
        """Return the values of the servos, and counters."""
        return {
            "values": self.wire.named(self._values),
            "errors": self.errors,
            "released": bool((self.targets[: self.wire.count] == 0).all()),
        }

    def _length(self) -> int:
        """Return the length of the current command, with its CRC [bytes].

        0: the length is not known yet, or there is no such command.
        """
        head = 3 if self._bytes[:1] == [POLOLU] else 1
        if len(self._bytes) < head:
            return 0
        count = DATA.get(self._bytes[head - 1] | 0x80)
        if count is None:
            self._bytes = []
            self.fail(PROTOCOL_ERROR)
            return 0
        return head + count + self._crc

    def _do(self, command: bytes, now: float) -> bytes:
        """Execute a complete command; return its answer."""
        if self._crc and crc7(command[:-1]) != command[-1]:
            self.fail(CRC_ERROR)
            return b""
        if command[0] == POLOLU:
            if command[1] != self._number:
                return b""
            command = bytes((command[2] | 0x80,)) + command[3:]
        self._heard, self._timed_out = now, False
        if command[0] == GET_ERRORS:
            register, self.register = self.register, 0
            return register.to_bytes(2, "little")
        channel = command[1]
        if channel >= CHANNELS:
            self.fail(PROTOCOL_ERROR)
            return b""
        if command[0] == GET_POSITION:
            return int(self.targets[channel]).to_bytes(2, "little")
        if channel != self._stuck:
            self.targets[channel] = command[2] | command[3] << 7
            self._move()
        return b""

    def _go_home(self) -> None:
        if self._home is not None:
            self.targets[: self.wire.count] = self._home
            self._move()

    def _move(self) -> None:
        """Move every servo that gets pulses to its target."""
        targets, low, high = self.targets[: self.wire.count], self.wire.range_low, self.wire.range_high
        at = low + (high - low) * np.clip((targets - self._low) / (self._high - self._low), 0, 1)
        self._values = np.where(targets == 0, self._values, at)

"""Virtual devices for the protocols that labs already use: each as its real receiver behaves, traps included."""

from __future__ import annotations

import struct
import time
from heapq import heappop, heappush

import numpy as np

from ...errors import DermisError
from ..protocols import osc, torque
from ..protocols.wire import Array, Wire


class MaestroDevice:
    """A Pololu Maestro without a serial time-out: targets in quarter microseconds; 0: no pulses."""

    watchdog = datagrams = False

    def __init__(self, wire: Wire, *, stuck: int = -1, low_us: float = 1000.0, high_us: float = 2000.0) -> None:
        self.wire = wire
        self.targets = np.zeros(24, int)
        self.errors = 0
        self._low, self._high, self._stuck = 4 * low_us, 4 * high_us, stuck
        self._bytes: list[int] = []

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
                self._bytes = []
        return []

    def tick(self, now: float) -> list[bytes]:
        """Do nothing: it keeps its pulses for ever, which is the danger."""
        return []

    def report(self) -> dict[str, object]:
        """Return the pulses as values."""
        part = (self.targets[: self.wire.count] - self._low) / (self._high - self._low)
        values = self.wire.low + (self.wire.high - self.wire.low) * np.clip(part, 0, 1)
        return {
            "values": _named(self.wire, values),
            "errors": self.errors,
            "released": bool((self.targets[: self.wire.count] == 0).all()),
        }


class ServoAnimationDevice:
    """A receiver of Blender Servo Animation: every 0x3C starts anew, also in the middle of a position."""

    watchdog = datagrams = False

    def __init__(self, wire: Wire, *, stuck: int = -1, low: float = 1000.0, high: float = 2000.0) -> None:
        self.wire = wire
        self.positions: dict[int, int] = {}
        self.log: list[tuple[int, int]] = []
        self._low, self._high, self._stuck = low, high, stuck
        self._values, self._index = [0] * 5, 0

    def feed(self, data: bytes, now: float) -> list[bytes]:
        """Take bytes as the original does."""
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
        """Return the positions as values."""
        ids = [i for i in range(256) if i != 60][: self.wire.count]
        part = np.array([(self.positions.get(i, self._low) - self._low) / (self._high - self._low) for i in ids])
        return {"values": _named(self.wire, self.wire.low + (self.wire.high - self.wire.low) * part)}


class TorqueDevice:
    """Motors with inertia, friction and the skin's spring, driven by torques over UDP; lets go after 20 ms of silence.

    Args:
        inertia: of each motor at its pulley [kg m2]. damping: [N m s]. stiffness: of the skin [N m/rad].
        encoder: step of the reported angles [rad].
    """

    watchdog = datagrams = True
    TIMEOUT, STEP = 0.02, 5e-5

    def __init__(
        self,
        wire: Wire,
        *,
        stuck: int = -1,
        inertia: float = 1e-6,
        damping: float = 1e-5,
        stiffness: float = 0.02,
        encoder: float = 0.0,
    ) -> None:
        self.wire = wire
        self.angle: Array = wire.rest.copy()
        self.speed: Array = np.zeros(wire.count)
        self.torque: Array = np.zeros(wire.count)
        self.received = self.errors = 0
        self._numbers = (inertia, damping, stiffness, encoder)
        self._stuck = stuck
        self._heard: float | None = None
        self._now: float | None = None

    def feed(self, data: bytes, now: float) -> list[bytes]:
        """Take one datagram; answer with the angles."""
        self.tick(now)
        if len(data) != 4 + 4 * self.wire.count or not data.startswith(torque.TO_BOARD):
            self.errors += 1
            return []
        self.torque = np.frombuffer(data, "<f4", offset=4).astype(np.float64)
        self._heard = now
        self.received += 1
        step = self._numbers[3]
        angle = np.rint(self.angle / step) * step if step else self.angle
        return [torque.FROM_BOARD + data[2:4] + angle.astype("<f4").tobytes()]

    def tick(self, now: float) -> list[bytes]:
        """Integrate the motion up to now, in steps far below the loop's."""
        if self._now is None:
            self._now = now
        inertia, damping, stiffness, _ = self._numbers
        steps = min(int((now - self._now) / self.STEP), 10_000)
        for _ in range(steps):
            self._now += self.STEP
            silent = self._heard is None or self._now - self._heard > self.TIMEOUT
            drive = 0.0 if silent else self.torque
            acceleration = (drive - damping * self.speed - stiffness * self.angle) / inertia
            self.speed = self.speed + acceleration * self.STEP
            self.angle = self.angle + self.speed * self.STEP
            if self._stuck >= 0:
                self.angle[self._stuck] = self.speed[self._stuck] = 0.0
        if steps == 10_000:
            self._now = now
        return []

    def report(self) -> dict[str, object]:
        """Return the angles."""
        silent = self._heard is None or self._now is None or self._now - self._heard > self.TIMEOUT
        return {
            "values": _named(self.wire, self.angle),
            "received": self.received,
            "errors": self.errors,
            "released": bool(silent or not self.torque.any()),
        }


class OscDevice:
    """A receiver of OSC bundles that honours time tags, as the specification asks: a bundle for later waits till then.

    Attributes:
        waiting: bundles for later: when [s], number, messages.
    """

    watchdog = False
    datagrams = True

    def __init__(self, wire: Wire, *, stuck: int = -1) -> None:
        self.wire = wire
        self.latest: Array = wire.rest.copy()
        self.received = self.errors = 0
        self.tags: list[int] = []
        self.waiting: list[tuple[float, int, list[tuple[str, list[float]]]]] = []
        self._stuck = stuck

    def feed(self, data: bytes, now: float) -> list[bytes]:
        """Take one bundle; one for later changes nothing yet, and nothing takes it back."""
        try:
            tag, messages = osc.read_bundle(data)
        except (DermisError, struct.error):
            self.errors += 1
            return []
        self.received += 1
        self.tags = [tag]
        ahead = 0.0 if tag == osc.IMMEDIATELY else tag / 2**32 - osc.NTP - time.time()
        if ahead > 0:
            heappush(self.waiting, (now + ahead, self.received, messages))
        else:
            self._set(messages)
        return []

    def tick(self, now: float) -> list[bytes]:
        """Let the bundles count whose time has come."""
        while self.waiting and self.waiting[0][0] <= now:
            self._set(heappop(self.waiting)[2])
        return []

    def _set(self, messages: list[tuple[str, list[float]]]) -> None:
        for address, arguments in messages:
            name = address.rpartition("/")[2]
            if name in self.wire.names and self.wire.names.index(name) != self._stuck:
                self.latest[self.wire.names.index(name)] = arguments[0]

    def report(self) -> dict[str, object]:
        """Return the values."""
        return {"values": _named(self.wire, self.latest), "received": self.received, "errors": self.errors}


def _named(wire: Wire, values: Array) -> dict[str, float]:
    return dict(zip(wire.names, values.tolist(), strict=True))

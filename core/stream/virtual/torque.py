"""A simulated torque board with motors on the skin."""

from __future__ import annotations

import numpy as np

from ...arrays import Array
from ..protocols import torque
from ..protocols.wire import Wire


class TorqueDevice:
    """Motors with inertia, friction and the skin's spring, driven by torques.

    After 20 ms of silence the motors have no torque.

    Args:
        wire: description of the device. stuck: index of a motor that does not move; -1: none.
        inertia: inertia of each motor at its pulley [kg m2].
        damping: damping [N m s].
        stiffness: stiffness of the skin [N m/rad].
        encoder: step of the reported angles [rad]; 0: none.
    """

    datagrams = True
    TIMEOUT, STEP = 0.02, 5e-5  # [s] silence after which there is no torque, and time step of the motion

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
        """Process one datagram; return the answer with the angles."""
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
        """Integrate the motion up to the time `now` [s].

        The time step is far below that of the position loop.
        """
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
        """Return the angles by channel, and counters."""
        silent = self._heard is None or self._now is None or self._now - self._heard > self.TIMEOUT
        return {
            "values": self.wire.named(self.angle),
            "received": self.received,
            "errors": self.errors,
            "released": bool(silent or not self.torque.any()),
        }

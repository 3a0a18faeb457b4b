"""Boards that take motor torques over UDP at 1 kHz and report angles.

The sender closes the position loop. [S3] describes such a board without its byte format, so the format here is that of
Dermis. Datagrams are little-endian. To the board: `"DT"`, u16 sequence number, f32 torque for each motor [N m]. From
the board: `"DA"`, u16 sequence number of the datagram that it answers, f32 angle for each motor [rad].
Source: [S3] section 3.3
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping

import numpy as np

from ...arrays import Array
from ...errors import DermisError
from .adapter import Adapter
from .wire import Wire

HEAD = struct.Struct("<2sH")
TO_BOARD, FROM_BOARD = b"DT", b"DA"
FRESH = 0.01  # [s] with an angle older than this, the loop commands no torque
POLL_EVERY = 0.01  # [s] time between two questions for the angles while the board is not armed
SILENCE, SILENCE_ARMED = 1.0, 0.08  # [s] a board without an answer for this long is gone; the second while it is armed
ABSENT = 0.03  # [s] if this sender itself paused for longer, the pause does not count as the board's silence


class Torque(Adapter):
    """A torque board, with a position loop in the sender.

    Options: `torque`: torque limit [N m]. `inertia`: inertia of a motor at its pulley [kg m2]. `loop_hz`: bandwidth of
    the position loop [Hz]. `stiffness`: stiffness of the skin at a pulley [N m/rad], for the feedforward torque.
    `silence`, `silence_ms`: declared behaviour of the board in silence.
    """

    name, title = "torque", "Torque board"
    tells_pose = datagrams = limp = True
    caution = (
        "The paper says nothing of a watchdog in the board. It must let its motors go after 20 ms without a "
        "datagram; check yours before a finger goes in."
    )
    OPTIONS = ("inertia", "loop_hz", "torque", "stiffness", "silence", "silence_ms")

    def __init__(self, wire: Wire, options: Mapping[str, str]) -> None:
        super().__init__(wire, options)
        if any(unit != "rad" for unit in wire.units):
            raise DermisError(
                "a torque board turns motors, so its channels are angles",
                where=wire.spec.name,
                value=", ".join(wire.units),
                limit="rad",
            )
        self.torque = self.number("torque", float(wire.spec.parameters.get("torque_limit", 0.0)))
        inertia, omega = self.number("inertia", 1e-6), 2 * math.pi * self.number("loop_hz", 15.0)
        if not (self.torque > 0 and inertia > 0 and 0 < omega < 2 * math.pi * 100):
            raise DermisError(
                "the position loop needs a torque limit, an inertia and a bandwidth below 100 Hz",
                where=self.title,
                value=f"{self.torque:g} N m, {inertia:g} kg m2",
            )
        # The gains put all three poles of a bare inertia with an integrator at -w: (s + w)^3. The integrator holds the
        # pose against the skin.
        self.gains = (3 * inertia * omega**2, 3 * inertia * omega, inertia * omega**3)
        self.stiffness = self.number("stiffness", _stiffness(wire))
        self.command_bytes = HEAD.size + 4 * wire.count
        self._sequence = 0
        self._sum = np.zeros(wire.count)
        self._speed = np.zeros(wire.count)
        self._angle: Array | None = None
        self._target = wire.rest.copy()
        self._heard = self._alive = self._stepped = -math.inf
        self._due = self._polled = -1.0
        self._asked: dict[int, float] = {}
        self._let_go: int | None = None  # sequence number of the first datagram of an unconfirmed safe state

    def opened(self, now: float) -> None:
        """Begin; the board is ready once it has reported its angles."""
        self.ready = False

    def poll(self, now: float) -> list[bytes]:
        """Return a datagram without torque that asks for angles, if one is due.

        While the board is armed, the commands ask for them.
        """
        if now - self._polled > ABSENT:
            self._alive += now - self._polled
        self._polled = now
        silence = SILENCE_ARMED if self.armed else SILENCE
        if self.ready and now - self._alive > silence:
            self.fault = f"the board has not answered for {silence:g} s"
        if self.armed or now < self._due:
            return []
        self._due = now + POLL_EVERY
        return [self._pack(np.zeros(self.wire.count), now)]

    def receive(self, data: bytes, now: float) -> None:
        """Process the angles of one datagram."""
        if len(data) != HEAD.size + 4 * self.wire.count or not data.startswith(FROM_BOARD):
            self.counters["malformed"] += 1
            if not self.ready and data.startswith(FROM_BOARD):
                self.fault = f"wrong device: it reports {(len(data) - HEAD.size) // 4} angles, not {self.wire.count}"
            return
        _, sequence = HEAD.unpack_from(data)
        angle = np.frombuffer(data, "<f4", offset=HEAD.size).astype(np.float64)
        if not np.isfinite(angle).all():
            self.counters["malformed"] += 1
            return
        asked = self._asked.pop(sequence, None)
        if asked is None:
            self.counters["out of order"] += 1
            return
        self.round_trip = now - asked
        if self._let_go is not None and (sequence - self._let_go) & 0xFFFF < 0x8000:
            self._let_go = None
        step = now - self._heard
        if self._angle is not None and 1e-4 < step < FRESH:
            # A one-pole filter over about three samples: the step of an encoder would appear as a large speed.
            self._speed += 0.5 * ((angle - self._angle) / step - self._speed)
        elif self._angle is None or step >= FRESH:
            self._speed = np.zeros(self.wire.count)
        elif step <= 1e-4:
            return
        self._angle, self._heard, self._alive, self.ready = angle, now, now, True
        self.pose, self.pose_at = angle, now

    def arm(self) -> None:
        """Arm, with the integrator of the position loop at 0."""
        self._sum[:] = 0
        self._stepped = -math.inf
        self._let_go = None
        super().arm()

    def command(self, values: Array, now: float, play: float | None) -> list[bytes]:
        """Return the torques of the position loop, within the torque limit.

        Without a fresh angle all torques are 0.
        """
        if self._angle is None or now - self._heard > FRESH:
            self.counters["no fresh angle, so no torque"] += 1
            self._sum[:] = 0
            return [self._pack(np.zeros(self.wire.count), now)]
        proportional, derivative, integral = self.gains
        step = min(now - self._stepped, 0.002) if math.isfinite(self._stepped) else 0.0
        error = values - self._angle
        wanted_speed = (values - self._target) / step if step > 1e-4 else np.zeros(self.wire.count)
        self._target = values
        torque = self.stiffness * values + proportional * error + self._sum + derivative * (wanted_speed - self._speed)
        held = np.clip(torque, -self.torque, self.torque)
        saturated = held != torque
        # While the torque is limited, the integrator does not grow further in that direction.
        self._sum += np.where(saturated & (np.sign(error) == np.sign(torque)), 0.0, integral * error * step)
        self.counters["torque limited"] += int(saturated.sum())
        self._stepped = now
        return [self._pack(held, now)]

    def retract(self) -> list[bytes]:
        """Return datagrams without torque, which let the motors go."""
        return self.safe()

    def safe(self) -> list[bytes]:
        """Return datagrams without torque, which let the motors go."""
        super().safe()
        if self.ready:
            self._let_go = (self._sequence + 1) & 0xFFFF
        return [self._pack(np.zeros(self.wire.count), self._heard) for _ in range(3)]

    @property
    def settled(self) -> bool:
        """Return whether the board has answered a datagram of the last `safe`."""
        return self._let_go is None

    def _pack(self, torque: Array, now: float) -> bytes:
        self._sequence = (self._sequence + 1) & 0xFFFF
        if len(self._asked) > 200:
            self._asked.clear()
        self._asked[self._sequence] = now
        return HEAD.pack(TO_BOARD, self._sequence) + torque.astype("<f4").tobytes()


def _stiffness(wire: Wire) -> float:
    """Return the skin's stiffness at a pulley [N m/rad].

    It is the mean of the preset's lower and upper stiffness, times the square of the links' length.
    """
    given = wire.spec.parameters
    low, high = (float(given.get(f"skin_stiffness_{end}", 0.0)) for end in ("low", "high"))
    return 0.5 * (low + high) * float(given.get("link_length", 0.0)) ** 2

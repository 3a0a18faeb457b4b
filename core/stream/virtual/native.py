"""A simulated device of the native protocol.

It answers as the firmware does. `tests/unit/stream/virtual/test_receivers.py` runs one script of packets against both
and compares their answers.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from ...arrays import Array
from ...errors import DermisError
from ..protocols import packets
from ..protocols.packets import DeviceState, Kind, Nack, Packet, Reach, Welcome
from ..protocols.wire import Wire
from .faults import FaultyClock

DEVICE_ID = b"VIRTUAL1"
TOUCH_EVERY = 0.02  # [s] time between two reports of a finger that stays down
NACK_EVERY = 0.005  # [s] shortest time between two NACKs, so that not every frame of a flood is answered
WINDOW = 1024  # [packets] a packet whose number is further ahead is an old one, so the gap is not counted as a loss
MAX_STEP = 5.0  # [ms] longest time step of the movement, so that a device that stood still does not jump
AT_ONCE = 1e9  # [counts/ms] speed of a transition to the safe state at once
_RIGHT = FaultyClock()  # a clock without faults
WATCHDOGS = range(10, 81)  # [ms] silences that a sender may configure


class NativeDevice:
    """A device with actuators, a queue of timed commands and a watchdog.

    The actuators follow their targets within the slew limits of the sender's configuration.

    Args:
        wire: description of the device.
        stuck: index of an actuator that does not move; -1: none.
        clock: the device's clock, with its faults.
        queue: number of commands that the device can hold for later, at most 255.
        spec_hash: first 8 bytes of the hash of the preset; zeros: any preset.
        output_hz: reported rate at which the actuators take new values [Hz]; 0: at every command.

    Attributes:
        counts: pose of the actuators [counts], shape (channels,). state: `DeviceState`.
        received, lost, damaged, late, watchdogs: counters. play_error: largest error of a play-out time [s].
        safe_at: time at which the present safe state was reached [s], or None.
    """

    datagrams = False
    watchdogs_allowed = WATCHDOGS

    def __init__(
        self,
        wire: Wire,
        *,
        stuck: int = -1,
        clock: FaultyClock = _RIGHT,
        queue: int = 255,
        spec_hash: bytes = bytes(8),
        output_hz: int = 0,
    ) -> None:
        self.wire = wire
        count = wire.count
        self.counts = wire.counts(wire.rest).astype(np.float64)
        self.state = DeviceState.IDLE
        self.received = self.lost = self.damaged = self.late = self.watchdogs = 0
        self.play_error = 0.0
        self.early_least, self.early_most = np.inf, -np.inf
        self.safe_at: float | None = None
        self.touch: tuple[bool, float, float] | None = None
        self._touched = 0.0
        self._stuck, self._clock, self._most, self._spec_hash = stuck, clock, queue, spec_hash
        self._output_hz = output_hz
        self._start: float | None = None
        self._decoder = packets.Decoder()
        self._session = 0  # no session
        self._last = 0
        self._target = self.counts.copy()
        self._queue: deque[tuple[int, Array]] = deque()
        self._heard = -np.inf
        self._ticked: float | None = None
        self._timeout, self._reach = 0.0, Reach.RAMP
        self._safe = self.counts.copy()
        self._slew = np.full(count, 65535.0)
        self._pace = self._slew  # [counts/ms] speeds on the ramp to the safe state
        self._way: float | None = None  # [ms] remaining time of that ramp; None without a ramp
        self._sequence = 0
        self._nacked = -np.inf
        self.released = self._driven = False
        self.pose_known = True

    def clock_us(self, now: float) -> int:
        """Return the device's clock, without overflow [us].

        It starts near an overflow of 32 bits, so that overflows are tested.
        """
        if self._start is None:
            self._start = now
        return 2**32 - 3_000_000 + round(self._clock.shows(now - self._start) * 1e6)

    def feed(self, data: bytes, now: float) -> list[bytes]:
        """Process received bytes; return the answers."""
        out: list[bytes] = []
        for packet in self._decoder.feed(data):
            try:
                out += self._take(packet, now)
            except DermisError:
                out += self._nack(packet.session, packet.sequence, Nack.MALFORMED, now)
        for _ in range(self._decoder.damaged):
            out += self._nack(self._session, self._last, Nack.DAMAGED, now)
        self.damaged += self._decoder.damaged
        self._decoder.damaged = 0
        return out

    def tick(self, now: float) -> list[bytes]:
        """Advance to the time `now` [s]; return reports of a finger that is down.

        The device plays due commands, moves its actuators and checks its watchdog.
        """
        step = 0.0 if self._ticked is None else min((now - self._ticked) * 1e3, MAX_STEP)
        self._ticked = now
        if self.state == DeviceState.ARMED and now - self._heard > self._timeout:
            self.watchdogs += 1
            self._go_safe()
        clock = self.clock_us(now)
        while self._queue and self._queue[0][0] <= clock:
            when, self._target = self._queue.popleft()
            self.play_error = max(self.play_error, (clock - when) * 1e-6)
        if self._driven:  # another sender's session does not end a ramp to the safe state; only ARM does
            self._move(step * (self._slew if self.state == DeviceState.ARMED else self._pace))
        if self._way is not None:
            self._way = self._way - step if self._way > step else None
        there = not self._driven or (np.abs(self._target - self.counts) < 1).all()
        if self.state == DeviceState.SAFE and self.safe_at is None and there:
            self.safe_at = now
        if self.touch is not None and self.touch[0] and now - self._touched >= TOUCH_EVERY:
            return [self.touched(*self.touch, now)]
        return []

    def touched(self, down: bool, x: float, y: float, now: float) -> bytes:
        """Return the packet that reports a finger on the panel [m].

        `tick` repeats the report while the finger is down.
        """
        self.touch, self._touched = (down, x, y), now
        return self._pack(self._session, Kind.TOUCH, packets.touch(self.clock_us(now), down, x, y))

    def report(self) -> dict[str, object]:
        """Return the device's state as JSON values.

        `early_ms`: smallest and largest time by which timed commands arrived before their play-out time [ms].
        """
        return {
            "values": self.wire.named(self.wire.values(self.counts)),  # type: ignore[arg-type]
            "state": self.state.name.lower(),
            "received": self.received,
            "lost": self.lost,
            "damaged": self.damaged,
            "late": self.late,
            "watchdogs": self.watchdogs,
            "queued": len(self._queue),
            "safe_at": self.safe_at,
            "play_error_ms": self.play_error * 1e3,
            "released": self.released,
            "early_ms": [self.early_least * 1e3, self.early_most * 1e3] if self.early_least < np.inf else None,
        }

    def _take(self, packet: Packet, now: float) -> list[bytes]:
        kind, sequence = packet.kind, packet.sequence
        if packet.session != self._session or not self._session:  # a new session may begin unless the device is armed
            if kind != Kind.HELLO or self.state == DeviceState.ARMED:
                return self._nack(packet.session, sequence, Nack.OTHER_SESSION, now)
            packets.read_hello(packet.body)
            if not packet.session:
                raise DermisError("session 0 is nobody's", where="HELLO")
            self._session, self.state, self._last = packet.session, DeviceState.IDLE, (sequence - 1) & 0xFFFF
            self._queue.clear()
        ahead = (sequence - self._last) & 0xFFFF
        if ahead == 0 or ahead > WINDOW:
            return []  # a copy, an overtaken or an old packet is no sign of life
        out = []
        if ahead > 1:
            self.lost += ahead - 1
            out = self._nack(self._session, sequence, Nack.GAP, now)
        self._last, self._heard = sequence, now
        try:
            return out + self._take_own(packet, now)
        except DermisError:
            return out + self._nack(self._session, sequence, Nack.MALFORMED, now)

    def _take_own(self, packet: Packet, now: float) -> list[bytes]:
        """Process a packet of the session; return the answers.

        Raises:
            DermisError: the packet is malformed.
        """
        kind = packet.kind
        if kind == Kind.HELLO:
            return [self._welcome(packet.body, now)]
        if kind == Kind.SYNC:
            return [self._synced(packets.read_sync(packet.body), now)]
        if kind == Kind.COMMAND:
            return self._command(packet, now)
        if kind == Kind.CONFIGURE:
            self._configure(packet.body)
        elif kind == Kind.ARM and not packet.body:
            if self.state == DeviceState.CONFIGURED:
                self._target = self.counts.copy()
                self.state, self.safe_at, self.released = DeviceState.ARMED, None, False
                self.pose_known = self._driven = True
                self._way = None
        elif kind == Kind.SAFE:
            self._go_safe()
        else:
            raise DermisError("unknown kind of packet", value=kind)
        return [self._pack(self._session, Kind.STATE, packets.state(self.state, kind))]

    def _welcome(self, body: bytes, now: float) -> bytes:
        packets.read_hello(body)
        pose = np.rint(self.counts).astype(np.uint16) if self.pose_known else None
        welcome = Welcome(
            packets.VERSION,
            self.wire.count,
            DEVICE_ID,
            self._spec_hash,
            self.clock_us(now) & 0xFFFFFFFF,
            self.state,
            self._most,
            pose,
            self._output_hz,
        )
        return self._pack(self._session, Kind.WELCOME, welcome.body())

    def _configure(self, body: bytes) -> None:
        watchdog, reach, safe, slew = packets.read_configure(body)
        if len(safe) != self.wire.count:
            raise DermisError("another number of channels", value=len(safe), limit=str(self.wire.count))
        allowed = self.watchdogs_allowed
        if watchdog not in allowed:
            raise DermisError("no such watchdog", value=watchdog, limit=f"{allowed[0]} to {allowed[-1]} ms")
        if not slew.all():
            raise DermisError("a channel may not move at all", value=0, limit="1 to 65535 counts a millisecond")
        if self.state == DeviceState.ARMED:
            return  # the safe state of an armed device does not change
        self._timeout, self._reach = watchdog * 1e-3, Reach(reach)
        self._safe, self._slew = safe.astype(np.float64), slew.astype(np.float64)
        if not self.pose_known:
            self.counts, self._target = self._safe.copy(), self._safe.copy()
        self.state = DeviceState.CONFIGURED

    def _command(self, packet: Packet, now: float) -> list[bytes]:
        when, timed, counts = packets.read_command(packet.body)
        if len(counts) != self.wire.count:
            raise DermisError("another number of channels", value=len(counts), limit=str(self.wire.count))
        if self.state != DeviceState.ARMED:
            return self._nack(self._session, packet.sequence, Nack.NOT_ARMED, now)
        target = counts.astype(np.float64)
        clock = self.clock_us(now)
        early = (when - clock + 2**31) % 2**32 - 2**31 if timed else 0
        if timed:
            self.early_least = min(self.early_least, early * 1e-6)
            self.early_most = max(self.early_most, early * 1e-6)
        if timed and early >= 0:
            if len(self._queue) >= self._most:
                return self._nack(self._session, packet.sequence, Nack.QUEUE_FULL, now)
            self._queue.append((clock + early, target))
            self.received += 1
            return []
        self.received += 1
        self._queue.clear()
        self._target = target
        if not timed:
            return []
        self.late += 1
        return self._nack(self._session, packet.sequence, Nack.LATE, now)

    def _move(self, most: Array) -> None:
        """Move towards the targets by at most `most` [counts], shape (channels,)."""
        move = np.minimum(np.maximum(self._target - self.counts, -most), most)
        if self._stuck >= 0:
            move[self._stuck] = 0.0
        self.counts = self.counts + move

    def _synced(self, host_us: int, now: float) -> bytes:
        reply = packets.Synced(
            host_us,
            self.clock_us(now),
            self.state,
            min(len(self._queue), 255),
            self.received,
            self.lost,
            self.damaged,
            self.late,
            self.watchdogs,
        )
        return self._pack(self._session, Kind.SYNCED, reply.body())

    def _go_safe(self) -> None:
        """Begin the transition to the safe state.

        A ramp to it that has begun goes on: a second SAFE changes neither its speed nor its target.
        """
        if self.state == DeviceState.IDLE:
            return
        self._queue.clear()
        self.state, self.safe_at = DeviceState.SAFE, None
        if self._way is not None:
            return
        if self._reach == Reach.RELEASE:  # after letting go the pose is not known
            self.pose_known = self._driven = False
            self.released = True
            return
        self._target = self._safe.copy()
        way = np.abs(self._target - self.counts)
        longest = 0.0 if self._reach == Reach.AT_ONCE else float((way / self._slew).max())
        # All channels begin and arrive together. If they arrived one after another, a platform would tilt.
        self._pace = way / longest if longest else np.full(self.wire.count, AT_ONCE)
        self._way = longest if self._driven else None

    def _nack(self, session: int, sequence: int, reason: Nack, now: float) -> list[bytes]:
        """Return the NACK of a refused packet.

        A NACK too soon after the last one is dropped; its sequence number stays used.
        """
        answer = self._pack(session, Kind.NACK, packets.nack(sequence, reason))
        if now - self._nacked < NACK_EVERY:
            return []
        self._nacked = now
        return [answer]

    def _pack(self, session: int, kind: Kind, body: bytes) -> bytes:
        self._sequence = (self._sequence + 1) & 0xFFFF
        return packets.pack(kind, session, self._sequence, body)

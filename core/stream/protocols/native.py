"""The sender's side of the native protocol.

It is the handshake, arming, the device's clock, and commands with play-out times.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping

import numpy as np

from ...arrays import Array
from ...errors import DermisError
from . import packets
from .adapter import Adapter, Touch
from .clock import DeviceClock, RoundTrips
from .packets import DeviceState, Kind, Nack, Packet, Reach
from .refusals import MOST, Refusals
from .silence import Does, Silence
from .wire import REACH, Wire

# [ms] silence after which the device goes to its safe state. A backlog of 30 ms and a pulse period of 20 ms may precede
# and follow it: 100 ms in all.
WATCHDOG_MS = 50
# [s] time between two packets: questions for the pose, questions for the clock, packets for arming, and SAFE.
# Questions for the clock come at SAFE_EVERY, too, while the link is slow or silent.
HELLO_EVERY, SYNC_EVERY, ARM_EVERY, SAFE_EVERY = 0.1, 0.01, 0.03, 0.005
# [ms] shortest watchdog: two periods of SYNC, so that one sign of life may come late. With 10 ms no device would arm.
LEAST_WATCHDOG_MS = round(2e3 * SYNC_EVERY)
SILENCE = 1.0  # [s] a device that has not answered for this long is gone
SILENCE_ARMED = 0.08  # [s] the same while the device is armed: the sender's own dead man's switch
BEHIND = 0.01  # [s] if an answer takes this much longer than the fastest one, commands are queuing on the link
PROMPT = 0.004  # [s] an answer at most this much slower than usual met no queue
OVERDUE = 0.03  # [s] without an answer for this long, questions come more often: one lost packet must not end a stream
ABSENT = 0.03  # [s] if this sender itself paused for longer, the pause does not count as the device's silence
SAFE_TIMES = 200  # packets SAFE at most, sent within a second until the device confirms one: any packet may be lost
HELLO_TIMES = 5  # HELLO packets without an answer before a new session: the device may know the old number already


class Native(Adapter):
    """The native protocol of Dermis, versions 1 and 2.

    Options: `watchdog_ms`: silence before the safe state [ms]. `reach`: transition to it, 'ramp' or 'release'.
    """

    name, title = "native", "Dermis native"
    tells_pose = timed = True
    baud = 500_000
    at_baud = (
        "A board built with DERMIS_WIFI or DERMIS_SERVO_ANIMATION speaks another protocol at this port. One with a "
        "DERMIS_BAUD of its own needs that as ?baud=, and one flashed before version 2 ?baud=115200"
    )
    unarmed = "If a PCA9685 makes its pulses, check that board's address, SDA, SCL and VCC: without it nothing is armed"
    OPTIONS: tuple[str, ...] = ("reach", "watchdog_ms")
    WATCHDOGS = WATCHDOG_MS, LEAST_WATCHDOG_MS, 80  # [ms] default, shortest, longest; a longer one breaks the 100 ms
    GONE, BEHIND = SILENCE_ARMED, BEHIND

    def __init__(self, wire: Wire, options: Mapping[str, str]) -> None:
        super().__init__(wire, options)
        wire.need_ranges(self.title)
        self.watchdog_ms = self.whole("watchdog_ms", *self.WATCHDOGS)
        self.reach = self._reach(options.get("reach", ""))
        does = Does.LETS_GO if self.reach == Reach.RELEASE else Does.RETRACTS
        self.silence = Silence(does, self.watchdog_ms / 1e3, "board")
        self.least_rate = 0.0  # commands need not be repeated: the questions for the clock are signs of life
        full = packets.command(0xFFFFFFFF, np.full(wire.count, packets.FULL, np.uint16), timed=True)
        self.command_bytes = len(packets.pack(Kind.COMMAND, 0xFF, 0xFFFF, full))
        self.other_bytes = len(packets.pack(Kind.SYNC, 0xFF, 0xFFFF, b"\xff" * 4)) / SYNC_EVERY
        self.clock = DeviceClock()
        self.decoder = packets.Decoder()
        self.state: DeviceState | None = DeviceState.IDLE
        self._session = 0
        self._sequence = 0
        self._due: dict[str, float] = {}
        self._asked: dict[int, tuple[float, int]] = {}  # token -> time of the question, commands sent before it
        self._commands = 0
        self._refusals = Refusals()
        self._jumps = 0
        self._refuses = False  # too many commands were refused when they were judged last
        self._at_once = self._was_at_once = False  # the next command is untimed, so it empties the device's queue
        self._old_firmware = ""
        self._timing: list[str] = []  # findings about play-out times since the device was armed
        self._oldest = math.inf  # [s] time of the oldest question without an answer
        self._trips = RoundTrips()
        self._heard = self._polled = 0.0
        self._wants_arms = self._wants_pose = False
        self._safes = 0
        self._unconfirmed = False

    def opened(self, now: float) -> None:
        """Begin a session with a new number.

        Packets of earlier sessions are ignored from now on.
        """
        self._draw_session()
        self._heard = self._polled = now
        self.decoder = packets.Decoder()

    def receive(self, data: bytes, now: float) -> None:
        """Process the device's packets.

        Damaged packets, and packets of another session, are counted and dropped.
        """
        for packet in self.decoder.feed(data):
            if packet.kind != Kind.NACK and packet.session != self._session:
                self.counters["of another session"] += 1
                continue
            try:
                self._take(packet, now)
            except DermisError:
                self.counters["malformed"] += 1
        if self.decoder.damaged:
            self.counters["damaged on the way here"] += self.decoder.damaged
            self.decoder.damaged = 0

    def poll(self, now: float) -> list[bytes]:
        """Return due packets: handshake, arming, clock and repeated SAFE."""
        out = []
        if now - self._polled > ABSENT:
            self._heard += now - self._polled
        self._polled = now
        if not self.ready:
            if not self.fault and self._is_due("hello", HELLO_EVERY, now):
                if self._sequence and self._sequence % HELLO_TIMES == 0:
                    self._draw_session()
                out += self.ask_pose()
            return out
        silence = self.GONE if self.armed else SILENCE
        if now - self._heard > silence:
            self.fault = f"the device has not answered for {silence:g} s"
        if self._safes and self._is_due("safe", SAFE_EVERY, now):
            self._safes -= 1
            out.append(self._pack(Kind.SAFE))
        elif self._wants_arms and not self.armed and self._is_due("arm", ARM_EVERY, now):
            if self.state == DeviceState.CONFIGURED:
                out.append(self._pack(Kind.ARM))
            elif self.state != DeviceState.ARMED:
                body = packets.configure(
                    self.watchdog_ms, self.reach, self.wire.counts(self.wire.safe), self.wire.slew_counts()
                )
                out.append(self._pack(Kind.CONFIGURE, body))
            out += self.ask_pose()  # a ramp to the safe state goes on until the device is armed
        self._judge_link(now)
        well = self.prompt and not self.congested and now - self._heard < OVERDUE
        if self._is_due("sync", SYNC_EVERY if well else SAFE_EVERY, now):
            token = round(now * 1e6) & 0xFFFFFFFF
            if len(self._asked) > 100:  # answers that never came
                self._asked.clear()
                self._oldest = math.inf
            self._asked[token] = now, self._commands
            self._oldest = min(self._oldest, now)
            out.append(self._pack(Kind.SYNC, token.to_bytes(4, "little")))
            asks = not (self._wants_arms or self._safes) or (self.armed and self.follows_pose)
            if asks and self._is_due("hello", HELLO_EVERY, now):
                out += self.ask_pose()  # it may have let go; sent after SYNC, so that SYNC's round trip is not longer
        return out

    def arm(self) -> None:
        """Ask for the device to be configured and armed.

        `poll` repeats the packets until the device has reported that it is armed, and its pose.
        """
        self._wants_arms = self._wants_pose = True
        self.timed, self._refuses = type(self).timed, False
        self._timing.clear()
        self._tell_notice()
        self._unconfirmed, self._safes = False, 0
        self._due.pop("arm", None)

    def command(self, values: Array, now: float, play: float | None) -> list[bytes]:
        """Return one COMMAND, with a play-out time if the device's clock is known."""
        timed = play is not None and self.timed and self.clock.known and not self._at_once
        self._was_at_once, self._at_once = self._at_once, False
        self._commands += 1
        when = self.clock.device_us(play) if timed and play is not None else 0
        return [self._pack(Kind.COMMAND, packets.command(when, self.wire.counts(values), timed=timed))]

    def carried(self, values: Array) -> Array:
        """Return values rounded to the protocol's counts [units]."""
        return self.wire.values(self.wire.counts(values))

    def ask_pose(self) -> list[bytes]:
        """Return a question for identity and pose.

        Within a session it changes nothing at the device.
        """
        return [self._pack(Kind.HELLO, packets.hello(self.wire.count, self.wire.hash))]

    def sign_of_life(self, values: Array, now: float) -> list[bytes]:
        """Return nothing: the questions of `poll` for the clock suffice."""
        return []

    def forget(self) -> None:
        """Take back the sequence number of the last command.

        Its packet was not sent, so the device must not count it as lost.
        """
        self._sequence = (self._sequence - 1) & 0xFFFF
        self._commands -= 1
        self._at_once |= self._was_at_once

    def retract(self) -> list[bytes]:
        """Return SAFE; `poll` repeats it until the device confirms it."""
        return self.safe()

    def safe(self) -> list[bytes]:
        """Return SAFE; `poll` repeats it until the device confirms it."""
        self._wants_arms = self.armed = False
        self._unconfirmed = self.ready
        self._safes = SAFE_TIMES
        self._due.pop("safe", None)
        return [self._pack(Kind.SAFE)] if self.ready else []

    @property
    def settled(self) -> bool:
        """Return whether no SAFE awaits its confirmation.

        True as well if the device was never recognised.
        """
        return not self._unconfirmed

    def _draw_session(self) -> None:
        self._session = os.urandom(1)[0] or 1

    def _take(self, packet: Packet, now: float) -> None:
        self._heard = now
        if packet.kind == Kind.WELCOME:
            self._welcome(packets.Welcome.read(packet.body), now)
        elif packet.kind == Kind.STATE:
            state, answered = packets.read_state(packet.body)
            self._device_state(state)
            if answered == Kind.SAFE and state != DeviceState.ARMED:
                self._unconfirmed, self._safes = False, 0
        elif packet.kind == Kind.SYNCED:
            reply = packets.Synced.read(packet.body)
            question = self._asked.pop(reply.host_us, None)
            if question is not None:
                asked, commands = question
                # Older questions, or their answers, were lost.
                self._asked = {token: q for token, q in self._asked.items() if q[0] > asked}
                self._oldest = min((at for at, _ in self._asked.values()), default=math.inf)
                self.clock.reply(asked, now, reply.device_us)
                self._refusals.add(commands, reply)
                self.refused = self._refusals.count
                self._judge_timing(now)
                self.round_trip = now - asked
                self._trips.add(self.round_trip, idle=not self.armed)
            self._device_state(reply.state)
            for name, count in (("lost", reply.lost), ("damaged", reply.damaged), ("late", reply.late)):
                self.counters[f"{name} at the device"] = count
        elif packet.kind == Kind.NACK:
            _, reason = packets.read_nack(packet.body)
            name = Nack(reason).name.lower().replace("_", " ") if reason in set(Nack) else f"reason {reason}"
            self.counters[f"refused: {name}"] += 1
            if reason == Nack.OTHER_SESSION and packet.session == self._session:
                self.fault = (
                    "the device has begun anew (a reset?), or follows another sender"
                    if self.ready
                    else "the device is in use by another sender"
                )
        elif packet.kind == Kind.TOUCH:
            _, down, x, y = packets.read_touch(packet.body)
            self.touch = Touch(down, x, y, now)

    def _welcome(self, welcome: packets.Welcome, now: float) -> None:
        self.device = welcome.device.hex()
        if welcome.version not in packets.READS:
            self.fault = (
                f"the device uses version {welcome.version} of the protocol, and this sender supports "
                f"{' and '.join(map(str, packets.READS))}"
            )
        elif welcome.channels != self.wire.count:
            self.fault = (
                f"wrong device: it has {welcome.channels} channels, '{self.wire.spec.name}' has "
                f"{self.wire.count} on the wire"
            )
        elif any(welcome.spec_hash) and welcome.spec_hash != self.wire.hash:
            self.fault = (
                f"wrong device: it was made for the preset {welcome.spec_hash.hex()}, "
                f"'{self.wire.spec.name}' is {self.wire.hash.hex()}"
            )
        else:
            if not self.ready:  # a later WELCOME only answers a question for the pose, and clears no fault
                self.ready, self.fault = True, ""
            if welcome.version < packets.VERSION:
                self._old_firmware = (
                    f"The device's firmware uses version {welcome.version} of the protocol. Update it: with an old one "
                    "noise on the line can delay the safe state, and the channels reach it one after another"
                )
            self._tell_notice()
            self.queue, self.output_hz = welcome.queue, float(welcome.output_hz)
            self.pose = None if welcome.pose is None else self.wire.values(welcome.pose)
            self.pose_at = now
            self._wants_pose = self._wants_pose and welcome.state != DeviceState.ARMED
            self._device_state(welcome.state)

    def _judge_timing(self, now: float) -> None:
        """Check the device's clock and its refusals of timed commands.

        If the clock jumped, or too many commands were refused, the clocks are synchronised again. Commands in the
        device's queue then have play-out times of the old synchronisation, so the next command empties the queue.
        If the trouble lasts, commands are sent without play-out times.
        """
        jumped, self._jumps = self.clock.jumps > self._jumps, self.clock.jumps
        refuses = self._refusals.too_many(self._commands, now)
        again = bool(refuses and self._refuses)
        self._refuses = self._refuses if refuses is None else refuses
        if not self.timed:
            return
        if not self.clock.steady(now):
            self._give_up_timing(f"its clock stands still, jumps or runs {self.clock.TOLERANCE:.0%} wrong")
        elif again:
            self._give_up_timing(f"more than {MOST:.0%} of the commands were still refused or late")
        elif jumped or refuses:
            if not jumped:  # after a jump `DeviceClock` has forgotten the earlier round trips already
                self.clock.forget()
            self._at_once = True
            refused = f"More than {MOST:.0%} of the commands were refused or late"
            why = "The device's clock jumped" if jumped else refused
            self._tell_notice(f"{why}: the clocks were synchronised again")

    def _give_up_timing(self, why: str) -> None:
        self.timed = False
        self._tell_notice(f"The device gets commands without a play-out time until it is armed again: {why}")

    def _tell_notice(self, found: str = "") -> None:
        if found and found not in self._timing:
            self._timing.append(found)
        self.notice = ". ".join(filter(None, (self._old_firmware, *self._timing)))

    def _judge_link(self, now: float) -> None:
        """Infer from late answers whether commands queue in a driver."""
        self.congested = now - self._oldest > max(self._trips.shortest + self.BEHIND, self._trips.usual + PROMPT)
        self.prompt = self.round_trip < self._trips.usual + PROMPT

    def _reach(self, given: str) -> Reach:
        """Read the transition to the safe state.

        Args:
            given: the URL's option; '' for the transition of the preset.

        Raises:
            DermisError: no such transition, or the preset goes to its safe state at once.
        """
        gentle = {name: reach for name, reach in REACH.items() if reach != Reach.AT_ONCE}
        if not given:
            return self.wire.reach
        if self.wire.reach == Reach.AT_ONCE:
            raise DermisError(
                "the preset goes to its safe state at once, and no option delays that",
                where="reach",
                value=given,
                remedy="Leave the option out",
            )
        if given not in gentle:
            raise DermisError("no such way to the safe state", where="reach", value=given, limit=", ".join(gentle))
        return gentle[given]

    def _device_state(self, state: int) -> None:
        was = self.armed
        self.state = DeviceState(state) if state in set(DeviceState) else DeviceState.IDLE
        self.armed = self._wants_arms and self.state == DeviceState.ARMED and not self._wants_pose
        if was and not self.armed and self.state == DeviceState.SAFE:
            self._wants_arms = False
            self.fault = f"the device went to its safe state by itself: it heard nothing for {self.watchdog_ms} ms"

    def _pack(self, kind: Kind, body: bytes = b"") -> bytes:
        self._sequence = (self._sequence + 1) & 0xFFFF
        return packets.pack(kind, self._session, self._sequence, body)

    def _is_due(self, name: str, every: float, now: float) -> bool:
        if now < self._due.get(name, -1.0):
            return False
        self._due[name] = now + every
        return True

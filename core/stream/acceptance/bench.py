"""A device under test: armed, jogged, stopped, left in silence, flooded.

The streamer sends all commands that a scene can send, so they are sent as in ordinary use. Only silences, floods and
commands without a limiter bypass it; they are sent by this module.
"""

from __future__ import annotations

import math
import random
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ... import clock
from ...arrays import Array
from ...errors import DermisError
from ..connection import Connection
from ..drive import Phase
from ..protocols.native import Native
from ..protocols.packets import DeviceState, Kind, Reach, pack
from ..protocols.silence import Does
from ..protocols.wire import Wire
from ..request import StreamRequest
from ..shared_state import Heartbeat
from ..state import State
from ..streamer import Streamer
from ..virtual.link import open_any_link
from .host import Host

SAFE_MS = 100.0  # [ms] longest time from the start of a silence or a flood to the safe state
FLOOD_RATE = 50_000.0  # [bytes/s] rate of a flood: that of a serial line of 500,000 baud
POSE_EVERY = 0.05  # [s] time between two questions for the pose
CONNECTING, ARMING = 6.0, 3.0  # [s] time-outs; a board that is reset when its port is opened needs 2 s to connect
NOT_ARMED = "not-armed"  # code of the error of a device that does not arm
LEAVING = 2.0  # [s] time-out for a link that is being closed
RAMPING = 600.0  # [s] time-out for the ramp to the safe pose, whose speed the preset declares

# Bytes that a broken program or a loose cable may put on the line. Each pattern is repeated at up to `FLOOD_RATE`.
FLOODS: dict[str, Callable[[random.Random], bytes]] = {
    "frames of one byte": lambda _: bytes.fromhex("0001") * 256,
    "Maestro's commands": lambda _: bytes.fromhex("8400002f") * 128,
    "frames that are too short": lambda _: bytes.fromhex("01007f00") * 128,
    "noise, a third of it zeros": lambda r: bytes(0 if r.random() < 0.3 else r.randrange(256) for _ in range(512)),
    "noise": lambda r: r.randbytes(512),
    "no end of a frame": lambda _: b"\x01" * 512,
    "zeros": lambda _: bytes(512),
    "another sender's questions": lambda r: pack(Kind.SYNC, 251, r.randrange(65536), bytes(4)) * 16,
}


@dataclass(frozen=True)
class Heard:
    """A board's first answer after a silence.

    Attributes:
        state: state of the board.
        least, most: lower and upper bound of the silence before this answer [s].
    """

    state: DeviceState
    least: float
    most: float


class Bench:
    """A link to one device under test, with a streamer of its own.

    Args:
        request: link, device and calibration. heed: function that is called all the time; raises an error to end the
            checks. clock, sleep: clock and sleep function of this computer.

    Attributes:
        wire: description of the device. streamer: streamer of the link. host: measures the load of this computer.
        tells_pose, hushed: as in the adapter of the last connection, see `Adapter`. They are kept without a link.
    """

    def __init__(
        self,
        request: StreamRequest,
        heed: Callable[[], None] = lambda: None,
        *,
        clock: Callable[[], float] = clock.now,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.host = Host(clock, sleep)
        self._heed, self._clock, self._sleep = heed, clock, self.host.sleep
        self._silent = self._left_alone = False
        self.tells_pose = self.hushed = False
        made = request.calibrated()  # without measured curves, which would change the tested values
        plain = "" if made is None else made.without_curves().dumps()
        self._request = replace(request, connect=True, mode="jog", ramp=1.0, stall=60.0, calibration=plain)
        self._number = self._arms = 0
        self.wire = Wire.of(request.spec(), self._request.calibrated())
        self.streamer = Streamer(open_any_link, clock=clock)

    @property
    def connection(self) -> Connection:
        """The open connection.

        Raises:
            DermisError: there is none any more.
        """
        if self.streamer.connection is None:
            raise DermisError(self.streamer.message.rstrip(".") or f"{self._request.url} is gone")
        return self.streamer.connection

    @property
    def native(self) -> Native | None:
        """The adapter, if it is one of the native protocol; otherwise None."""
        adapter = self.streamer.connection.adapter if self.streamer.connection is not None else None
        return adapter if isinstance(adapter, Native) else None

    @property
    def answers(self) -> bool:
        """Whether the board uses the native protocol, even without a link."""
        return self._request.protocol == Native.name

    @property
    def holds_safe(self) -> bool:
        """Whether the board holds a pose in its safe state.

        Otherwise it lets the actuators go, so they may be anywhere.
        """
        adapter = self.connection.adapter
        return self.wire.reach != Reach.RELEASE and not adapter.limp and adapter.silence.does is not Does.LETS_GO

    @property
    def confirmed(self) -> bool | None:
        """Whether the board has confirmed its safe state.

        None: its protocol confirms none, or there is no link.
        """
        if not self.tells_pose or self.hushed or self.streamer.connection is None:
            return None
        adapter = self.streamer.connection.adapter
        return adapter.settled if adapter.state is None else adapter.state == DeviceState.SAFE

    def connect(self) -> None:
        """Connect, and wait until the device has been recognised.

        Raises:
            DermisError: the device was not recognised in time.
        """
        if self.streamer.drive is not None and self.streamer.drive.leaving:
            self.until(lambda: self.streamer.drive is None, LEAVING)
        if self.streamer.drive is None:
            # A streamer that has lost its link would wait for a person.
            self.streamer = Streamer(open_any_link, clock=self._clock)
        self._apply(connect=True, jog=self._jog(self.wire.safe), arm_id=0)
        there = (State.READY, State.STALLED)
        self.until(lambda: self.streamer.state in (*there, State.FAULT) or not self._holds, CONNECTING)
        if self.streamer.state not in there:
            raise DermisError(self.streamer.message.rstrip(".") or f"{self._request.url} does not answer")
        adapter = self.connection.adapter
        self.tells_pose, self.hushed = adapter.tells_pose, adapter.hushed

    def arm(self) -> None:
        """Arm with the safe pose as the goal, and wait until the ramp there is over.

        Raises:
            DermisError: the device does not arm, with the code 'not-armed'; or it disarmed itself.
        """
        if self.streamer.drive is None or self.streamer.drive.leaving:
            self.connect()
        self._arms += 1
        self._apply(arm_id=self._arms, jog=self._jog(self.wire.safe))
        self.until(lambda: self._driven or not self.streamer.armed, ARMING)
        if not self._driven:
            raise DermisError(self._why(), code=NOT_ARMED)
        limiter = self.connection.output.limiter
        self.run(self._request.ramp + 0.2)
        self.until(lambda: not self.streamer.armed or bool(np.allclose(limiter.last, self.wire.safe)), RAMPING)
        self._still_armed()

    def move(self, values: Array, seconds: float) -> None:
        """Jog to driven values [units], shape (channels,), and run for a time [s].

        Raises:
            DermisError: the device disarmed itself, or is gone.
        """
        self.head_for(values)
        self.run(seconds)
        self._still_armed()

    def head_for(self, values: Array) -> None:
        """Jog to driven values [units], shape (channels,), from now on."""
        self._apply(jog=self._jog(values))

    def run(self, seconds: float) -> None:
        """Run the streamer for a time [s]."""
        self.until(lambda: False, seconds)

    def until(self, done: Callable[[], bool], seconds: float) -> float | None:
        """Run until a condition holds; return the time that it took [s].

        None: it did not hold within `seconds`.
        """
        start = self._clock()
        while (now := self._clock()) - start < seconds:
            if done():
                return now - start
            self._heed()
            self.host.look()
            if self._silent:
                self._sleep(0.002)
            else:
                self._tick(now)
        return self._clock() - start if done() else None

    @contextmanager
    def silent(self) -> Iterator[None]:
        """Stop the streamer inside the block, so that nothing is sent."""
        self._silent = True
        try:
            yield
        finally:
            self._silent = False

    def hold(self) -> None:
        """Continue after a silence in which the device has kept its pose.

        A person has confirmed that.
        """
        self.connection.outbox.left_at = self._clock()

    def believe(self, values: Array) -> None:
        """Continue after the device has gone to driven values [units] by itself.

        A person has confirmed that. The shape of the values is (channels,).
        """
        self.hold()
        self.connection.output.limiter.begin(values, self._clock(), 0.0)
        self.head_for(values)

    def stop(self) -> None:
        """Ask for the safe state."""
        self.streamer.stop(self._clock(), "Stopped")

    def silence(self, seconds: float, flood: bytes = b"") -> Heard | None:
        """Keep silent, or send a flood; return the board's first answer after it.

        The silence lasts from the last message before it to the first message after it.

        Args:
            seconds: duration [s]. flood: bytes to send all the time instead of nothing.

        Returns: None if the protocol is not the native one, or if the board does not answer.
        """
        link, native = self.connection.link, self.native
        began, began_by = self._ask(native)
        end, sent = began_by + seconds, 0
        while (now := self._clock()) < end:
            self._heed()
            if flood and sent <= FLOOD_RATE * (now - began_by) and link.send(flood):
                sent += len(flood)
            self._sleep(min(0.001, end - now))
            for _ in link.receive():
                pass  # answers to the flood: the stream itself has asked nothing
        if native is None:
            return None
        self._raw(b"\0")  # ends the unfinished frame of a flood
        native.state = None
        ended, ended_by = self._ask(native)
        while native.state is None and self._clock() - ended_by < 0.3:
            for data in link.receive():
                native.receive(data, self._clock())
            self._sleep(0.001)
        state, native.state = native.state, native.state or DeviceState.IDLE
        return None if state is None else Heard(state, ended - began_by, ended_by - began)

    def pose(self) -> Array | None:
        """Ask the board for its pose in driven values [units], shape (channels,).

        None: the board does not report it.
        """
        if not self.tells_pose or self.streamer.connection is None:
            return None
        adapter = self.streamer.connection.adapter
        adapter.pose = None
        for message in adapter.ask_pose():
            self._raw(message)
        self.until(lambda: adapter.pose is not None, 0.3)
        return adapter.pose

    @contextmanager
    def slower(self, slew: Array) -> Iterator[None]:
        """Use other slew limits [units/s] for a board that is armed in the block."""
        adapter = self.connection.adapter
        usual, adapter.wire = adapter.wire, replace(adapter.wire, slew=slew)
        try:
            yield
        finally:
            adapter.wire = usual

    def past_the_limiter(self, values: Array, seconds: float) -> Iterator[tuple[float, float, Array]]:
        """Send one command without a limiter; yield the board's poses meanwhile.

        The streamer stands still. Questions for the pose and the clock keep the board's watchdog from acting.

        Args:
            values: command in driven values [units], shape (channels,). seconds: duration [s].

        Yields: time of the question for a pose [s], time of its answer [s], and the pose [units].
        """
        link, native = self.connection.link, self.native
        assert native is not None
        for message in native.command(values, self._clock(), None):
            self._raw(message)
        end, first, asked = self._clock() + seconds, math.inf, -1.0
        native.pose = None
        while (now := self._clock()) < end:
            self._heed()
            for message in native.poll(now):
                self._raw(message)
            if now - asked > POSE_EVERY:
                first, asked = min(first, now), now
                for message in native.ask_pose():
                    self._raw(message)
            for data in link.receive():
                native.receive(data, self._clock())
            if native.pose is not None:
                yield first, self._clock(), native.pose
                native.pose, first, asked = None, math.inf, -1.0
            self._sleep(0.002)

    @contextmanager
    def apart(self) -> Iterator[None]:
        """Close the link, so that another program can use it in the block.

        That program may leave the device at any pose.
        """
        self.close()
        self._left_alone = True
        yield

    def bring_home(self) -> None:
        """Connect again, and bring the device to its safe state from any pose.

        Raises:
            DermisError: the device cannot be brought there, or is still armed.
        """
        self.connect()
        if self.native is None:  # the native protocol reports whether the device is armed; others may not
            self.arm()
            self.stop()
            self.until(lambda: self.streamer.state == State.READY, RAMPING)
        elif self.native.state == DeviceState.ARMED:
            raise DermisError("the device is armed, and nobody holds it")
        self._left_alone = False

    def close(self) -> None:
        """Bring the device to its safe state and close the link.

        The call returns once both are done, without a time-out.
        """
        self.streamer.shut(self._clock())
        while not self.streamer.finished:
            self._tick(self._clock())

    def end(self) -> str:
        """Leave the device in its safe state after any outcome.

        Return why that is not certain; '' if it is.
        """
        self._heed, self._silent = lambda: None, False
        message = ""
        if self._left_alone or (self._arms and self.streamer.drive is None):
            try:
                self.bring_home()
            except DermisError as error:
                message = str(error).rstrip(".")
        self.close()
        if self.streamer.counters["safe states not confirmed"]:
            message = self.streamer.message.rstrip(".")
        return message

    def _tick(self, now: float) -> None:
        self._give_heartbeat(now)
        due = self.streamer.tick(self._clock())
        self._sleep(min(max(due - self._clock(), 0.0), 0.002))

    def _give_heartbeat(self, now: float) -> None:
        self._number += 1
        self.streamer.heartbeat(Heartbeat(self._number, 0, False, None, ()), now)

    def _still_armed(self) -> None:
        if not self.streamer.armed:
            raise DermisError(self._why())

    def _why(self) -> str:
        return self.streamer.message.rstrip(".") or f"{self._request.url} is not armed"

    @property
    def _driven(self) -> bool:
        """Whether the device is armed, or is assumed to be."""
        return self.streamer.drive is not None and self.streamer.drive.phase is Phase.LIVE

    @property
    def _holds(self) -> bool:
        return self.streamer.drive is not None or not self.streamer.message

    def _jog(self, values: Array) -> dict[str, float]:
        """Return the commands that the calibration turns into driven values."""
        return self.wire.named(self.wire.commanded(values))

    def _apply(self, **fields: Any) -> None:
        self._request = replace(self._request, **fields)
        self._give_heartbeat(self._clock())
        self.streamer.apply(self._request, self._clock())

    def _ask(self, native: Native | None) -> tuple[float, float]:
        """Send a question, which is a sign of life.

        Return the time before and after it was sent [s].
        """
        before = self._clock()
        for message in native.ask_pose() if native is not None else ():
            self._raw(message)
        return before, self._clock()

    def _raw(self, message: bytes) -> None:
        link, end = self.connection.link, self._clock() + 0.5
        while not link.send(message) and self._clock() < end:
            self._sleep(0.001)

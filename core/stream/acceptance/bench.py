"""A device on the bench, moved by the streamer itself: armed, jogged, stopped, left in silence, flooded.

Everything a person's scene would send goes the way it always goes; only silence, floods and commands that no limiter
has seen are put on the wire from here.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from ... import clock
from ...arrays import Array
from ...errors import DermisError
from ..connection import Connection
from ..protocols.native import Native
from ..protocols.packets import DeviceState, Kind, pack
from ..protocols.wire import Wire
from ..request import StreamRequest
from ..shared_state import Heartbeat
from ..state import State
from ..streamer import Streamer
from ..virtual.link import open_any_link

SAFE_MS = 100.0  # by then silence or a flood has ended in the safe state [ms]
FLOOD_RATE = 50_000.0  # as fast as a serial line of 500,000 baud [bytes/s]
POSE_EVERY = 0.05  # an answer that takes longer is asked for again [s]
CONNECTING, ARMING = 6.0, 3.0  # a board that resets when its port is opened needs 2 s [s]
RAMPING = 600.0  # to the safe pose, at a speed that the preset declares [s]

# What a broken program or a loose cable may put on the line: each pattern's bytes, repeated as fast as the link takes.
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


class Bench:
    """Holds a link to one device by a streamer of its own.

    Args:
        request: link, device and calibration. heed: called all the time; raises what shall end the walk.
        clock, sleep: of this computer.

    Attributes:
        wire: the device. streamer: its mind.
    """

    def __init__(
        self,
        request: StreamRequest,
        heed: Callable[[], None] = lambda: None,
        *,
        clock: Callable[[], float] = clock.now,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._heed, self._clock, self._sleep = heed, clock, sleep
        self._silent = self._left_alone = False
        self._request = replace(request, connect=True, mode="jog", ramp=1.0, stall=60.0)
        self._number = self._arms = 0
        self.wire = Wire.of(request.spec(), request.calibrated())
        self.streamer = Streamer(open_any_link)

    @property
    def connection(self) -> Connection:
        """The open link.

        Raises:
            DermisError: it is gone.
        """
        if self.streamer.connection is None:
            raise DermisError(self.streamer.message.rstrip(".") or f"{self._request.url} is gone")
        return self.streamer.connection

    @property
    def native(self) -> Native | None:
        """The native protocol's side of the link, None where the board speaks another one."""
        adapter = self.streamer.connection.adapter if self.streamer.connection is not None else None
        return adapter if isinstance(adapter, Native) else None

    @property
    def answers(self) -> bool:
        """Return whether the board speaks the native protocol, whether or not there is a link just now."""
        return self._request.protocol == Native.name

    def connect(self) -> None:
        """Connect, and wait until the device has been recognised.

        Raises:
            DermisError: it has not.
        """
        if self.streamer.drive is None:
            self.streamer = Streamer(open_any_link)  # one that has lost its link waits for a person
        self._apply(connect=True, jog=self._jog(self.wire.safe), arm_id=0)
        self.until(lambda: self.streamer.state in (State.READY, State.FAULT) or not self._holds, CONNECTING)
        if self.streamer.state != State.READY:
            raise DermisError(self.streamer.message.rstrip(".") or f"{self._request.url} does not answer")

    def arm(self) -> None:
        """Arm at the safe pose, and wait until the ramp there is over.

        Raises:
            DermisError: it does not arm.
        """
        if self.streamer.drive is None:
            self.connect()
        self._arms += 1
        self._apply(arm_id=self._arms, jog=self._jog(self.wire.safe))
        self.until(lambda: self.streamer.state in (State.ARMED, State.STREAMING), ARMING)
        self._still_armed()
        limiter = self.connection.output.limiter
        self.run(self._request.ramp + 0.2)
        self.until(lambda: not self.streamer.armed or bool(np.allclose(limiter.last, self.wire.safe)), RAMPING)
        self._still_armed()

    def move(self, values: Array, seconds: float) -> None:
        """Jog to driven values [units], shape (channels,), and give them some time [s].

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
        """Let time pass as in any stream [s]."""
        self.until(lambda: False, seconds)

    def until(self, done: Callable[[], bool], seconds: float) -> float | None:
        """Run until something holds; return how long that took [s], None where it did not."""
        start = self._clock()
        while (now := self._clock()) - start < seconds:
            if done():
                return now - start
            self._heed()
            if self._silent:
                self._sleep(0.002)
            else:
                self._tick(now)
        return self._clock() - start if done() else None

    @contextmanager
    def silent(self) -> Iterator[None]:
        """Send nothing at all, however long that takes."""
        self._silent = True
        try:
            yield
        finally:
            self._silent = False

    def believe(self, values: Array) -> None:
        """Take it from a person that the device has gone to driven values [units] by itself."""
        self.connection.output.limiter.begin(values, self._clock(), 0.0)
        self.head_for(values)

    def stop(self) -> None:
        """Ask for the safe state."""
        self.streamer.stop(self._clock(), "Stopped")

    def silence(self, seconds: float, flood: bytes = b"") -> int | None:
        """Send nothing of one's own for some time, or a flood; then ask the device how it is.

        Returns: its state by the native protocol, None where nobody can be asked.
        """
        link, native = self.connection.link, self.native
        start = self._clock()
        end, sent = start + seconds, 0
        while (now := self._clock()) < end:
            self._heed()
            if flood and sent <= FLOOD_RATE * (now - start) and link.send(flood):
                sent += len(flood)
            self._sleep(min(0.001, end - now))
            for _ in link.receive():
                pass  # refusals of the flood; nothing of the stream's own was asked
        if native is None:
            return None
        self._raw(b"\0")  # ends what the flood has begun
        self.until(lambda: native.state == DeviceState.SAFE, 0.3)
        return int(native.state)

    def pose(self) -> Array | None:
        """Ask the board what it drives [units]; None where it does not say."""
        native = self.native
        if native is None or self.streamer.drive is None:
            return None
        native.pose = None
        for message in native.ask_pose():
            self._raw(message)
        self.until(lambda: native.pose is not None, 0.3)
        return native.pose

    def past_the_limiter(self, values: Array, seconds: float) -> Iterator[tuple[float, Array]]:
        """Send one command that no limiter of this program has seen [units]; yield time [s] and pose while it acts.

        The board's watchdog is fed by questions for the pose and the clock alone; the streamer stands still.
        """
        link, native = self.connection.link, self.native
        assert native is not None
        for message in native.command(values, self._clock(), None):
            self._raw(message)
        end, asked = self._clock() + seconds, -1.0
        while (now := self._clock()) < end:
            self._heed()
            for message in native.poll(now):
                self._raw(message)
            if native.pose is not None or now - asked > POSE_EVERY:
                native.pose, asked = None, now
                for message in native.ask_pose():
                    self._raw(message)
            for data in link.receive():
                native.receive(data, self._clock())
            if native.pose is not None:
                yield self._clock(), native.pose
            self._sleep(0.002)

    @contextmanager
    def apart(self) -> Iterator[None]:
        """Let the link go for a while, so that another program can hold it, and may leave the device anywhere."""
        self.close()
        self._left_alone = True
        yield

    def bring_home(self) -> None:
        """Find the device wherever another program, or a lost link, has left it, and bring it to its safe state.

        Raises:
            DermisError: it cannot be.
        """
        self.connect()
        if self.native is None:  # which would have told that it is safe
            self.arm()
            self.stop()
            self.until(lambda: self.streamer.state == State.READY, RAMPING)
        elif self.native.state == DeviceState.ARMED:
            raise DermisError("the device is armed, and nobody holds it")
        self._left_alone = False

    def close(self) -> None:
        """Bring the device to its safe state and let it go; takes as long as that takes, and nothing ends it before."""
        self.streamer.shut(self._clock())
        while not self.streamer.finished:
            self._tick(self._clock())

    def end(self) -> str:
        """Leave the device safe, whatever became of it; return why that is not sure, '' where it is."""
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
            raise DermisError(self.streamer.message.rstrip(".") or f"{self._request.url} is not armed any more")

    @property
    def _holds(self) -> bool:
        return self.streamer.drive is not None or not self.streamer.message

    def _jog(self, values: Array) -> dict[str, float]:
        """Return what to ask for, so that the calibration makes driven values of it."""
        return self.wire.named(self.wire.commanded(values))

    def _apply(self, **fields: Any) -> None:
        self._request = replace(self._request, **fields)
        self._give_heartbeat(self._clock())
        self.streamer.apply(self._request, self._clock())

    def _raw(self, message: bytes) -> None:
        link, end = self.connection.link, self._clock() + 0.5
        while not link.send(message) and self._clock() < end:
            self._sleep(0.001)

"""A device on the bench, moved by the streamer itself: armed, jogged, stopped, left in silence, flooded.

Everything a person's scene would send goes the way it always goes; only silence, floods and commands that no limiter
has seen are put on the wire from here.
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

SAFE_MS = 100.0  # by then silence or a flood has ended in the safe state [ms]
FLOOD_RATE = 50_000.0  # as fast as a serial line of 500,000 baud [bytes/s]
POSE_EVERY = 0.05  # an answer that takes longer is asked for again [s]
CONNECTING, ARMING = 6.0, 3.0  # a board that resets when its port is opened needs 2 s [s]
NOT_ARMED = "not-armed"  # code of the refusal of a device that never was armed
LEAVING = 2.0  # a link that is let go is closed by then [s]
RAMPING = 600.0  # to the safe pose, at a speed that the preset declares [s]

# Bytes that a broken program or a loose cable may put on the line, each pattern repeated as fast as the link takes.
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
    """Holds a link to one device by a streamer of its own.

    Args:
        request: link, device and calibration. heed: called all the time; raises to end the walk.
        clock, sleep: clock and sleep function of this computer.

    Attributes:
        wire: the device. streamer: its mind. host: how busy this computer is.
        tells_pose: the board reports a pose, as the adapter of the last connection says; kept while there is no link.
        hushed: the board is asked nothing while it is not armed, see `Adapter`; kept likewise.
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
        made = request.calibrated()  # tested values are driven as they are: a measured curve would change them
        plain = "" if made is None else made.without_curves().dumps()
        self._request = replace(request, connect=True, mode="jog", ramp=1.0, stall=60.0, calibration=plain)
        self._number = self._arms = 0
        self.wire = Wire.of(request.spec(), self._request.calibrated())
        self.streamer = Streamer(open_any_link, clock=clock)

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

    @property
    def holds_safe(self) -> bool:
        """Return whether the safe state is a pose that the board holds; otherwise it lets go, and may be anywhere."""
        adapter = self.connection.adapter
        return self.wire.reach != Reach.RELEASE and not adapter.limp and adapter.silence.does is not Does.LETS_GO

    @property
    def confirmed(self) -> bool | None:
        """Return whether the board has confirmed its safe state; None where its protocol cannot."""
        if not self.tells_pose or self.hushed or self.streamer.connection is None:
            return None
        adapter = self.streamer.connection.adapter
        return adapter.settled if adapter.state is None else adapter.state == DeviceState.SAFE

    def connect(self) -> None:
        """Connect, and wait until the device has been recognised.

        Raises:
            DermisError: it has not.
        """
        if self.streamer.drive is not None and self.streamer.drive.leaving:
            self.until(lambda: self.streamer.drive is None, LEAVING)
        if self.streamer.drive is None:
            self.streamer = Streamer(open_any_link, clock=self._clock)  # one that has lost its link waits for a person
        self._apply(connect=True, jog=self._jog(self.wire.safe), arm_id=0)
        there = (State.READY, State.STALLED)
        self.until(lambda: self.streamer.state in (*there, State.FAULT) or not self._holds, CONNECTING)
        if self.streamer.state not in there:
            raise DermisError(self.streamer.message.rstrip(".") or f"{self._request.url} does not answer")
        adapter = self.connection.adapter
        self.tells_pose, self.hushed = adapter.tells_pose, adapter.hushed

    def arm(self) -> None:
        """Arm at the safe pose, and wait until the ramp there is over.

        Raises:
            DermisError: it does not arm, with the code 'not-armed'; or it disarmed itself.
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
            self.host.look()
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

    def hold(self) -> None:
        """Take it from a person that the device has kept its pose during a silence: the stream goes on."""
        self.connection.outbox.left_at = self._clock()

    def believe(self, values: Array) -> None:
        """Take it from a person that the device has gone to driven values [units] by itself."""
        self.hold()
        self.connection.output.limiter.begin(values, self._clock(), 0.0)
        self.head_for(values)

    def stop(self) -> None:
        """Ask for the safe state."""
        self.streamer.stop(self._clock(), "Stopped")

    def silence(self, seconds: float, flood: bytes = b"") -> Heard | None:
        """Send nothing of one's own for some time [s], or a flood; return the board's first answer after that.

        The silence is timed where it is made: from the last message before it to the first one after it.

        Returns: None where nobody can be asked, or nobody answers.
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
                pass  # refusals of the flood; nothing of the stream's own was asked
        if native is None:
            return None
        self._raw(b"\0")  # ends a frame that the flood has begun
        native.state = None
        ended, ended_by = self._ask(native)
        while native.state is None and self._clock() - ended_by < 0.3:
            for data in link.receive():
                native.receive(data, self._clock())
            self._sleep(0.001)
        state, native.state = native.state, native.state or DeviceState.IDLE
        return None if state is None else Heard(state, ended - began_by, ended_by - began)

    def pose(self) -> Array | None:
        """Ask the board for its driven values [units]; None where it does not report them."""
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
        """Let the board be told other speed limits [units/s] when it is armed inside the block."""
        adapter = self.connection.adapter
        usual, adapter.wire = adapter.wire, replace(adapter.wire, slew=slew)
        try:
            yield
        finally:
            adapter.wire = usual

    def past_the_limiter(self, values: Array, seconds: float) -> Iterator[tuple[float, float, Array]]:
        """Send one command that no limiter of this program has seen [units]; yield poses while it acts.

        The board's watchdog is fed by questions for the pose and the clock alone; the streamer stands still.

        Yields: when the pose was asked for, when the answer was there [s], and the pose [units].
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
            raise DermisError(self._why())

    def _why(self) -> str:
        return self.streamer.message.rstrip(".") or f"{self._request.url} is not armed"

    @property
    def _driven(self) -> bool:
        """Return whether the device has said, or is taken to have said, that it is armed."""
        return self.streamer.drive is not None and self.streamer.drive.phase is Phase.LIVE

    @property
    def _holds(self) -> bool:
        return self.streamer.drive is not None or not self.streamer.message

    def _jog(self, values: Array) -> dict[str, float]:
        """Return the values to ask for, so that the calibration turns them into the driven values."""
        return self.wire.named(self.wire.commanded(values))

    def _apply(self, **fields: Any) -> None:
        self._request = replace(self._request, **fields)
        self._give_heartbeat(self._clock())
        self.streamer.apply(self._request, self._clock())

    def _ask(self, native: Native | None) -> tuple[float, float]:
        """Send a question, which is a sign of life; return the time before and after it left [s]."""
        before = self._clock()
        for message in native.ask_pose() if native is not None else ():
            self._raw(message)
        return before, self._clock()

    def _raw(self, message: bytes) -> None:
        link, end = self.connection.link, self._clock() + 0.5
        while not link.send(message) and self._clock() < end:
            self._sleep(0.001)

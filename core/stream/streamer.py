"""The streamer: connects, arms and stops a device, as requests ask.

It starts no process, and its caller gives it requests, signs of life and the time. state.py names the states of a link;
drive.py drives the device while the link is open. Every arming has a higher id than the one before, and an id arms only
once.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..errors import DermisError
from .connection import Connection
from .device_output import DeviceOutput
from .drive import Drive
from .links.transport import Gone, Transport
from .links.url import Url
from .protocols import adapters
from .protocols.wire import Wire
from .recorder import Recorder
from .request import StreamRequest
from .shared_state import Heartbeat
from .state import State
from .touch_panel_source import PanelSource, Screen
from .track_source import TrackSource

RETRY = 1.0  # [s] between two attempts to connect


class Streamer:
    """Carries out requests and heartbeats, a tick at a time.

    Args:
        open_link: opens a URL for a device and a protocol; may raise DermisError.
        load_screen: reads a screen map for the mode 'panel'.
        clock: read again just before a command leaves, see `Outbox`; None if time is simulated.

    Attributes:
        request: the latest request. counters: how often on this link, over all its attempts to connect, commands were
            sent, dropped, skipped and so on.
        output: output to the device; None before the first connection.
        drive: drive of the open link; None without a link.
        recorder: recorder of the log that a person asked for.
    """

    def __init__(
        self,
        open_link: Callable[[Url, Wire, str], Transport],
        load_screen: Callable[[Path], Screen] | None = None,
        clock: Callable[[], float] | None = None,
    ) -> None:
        self._open_link, self._load_screen, self._clock = open_link, load_screen, clock
        self.request = StreamRequest()
        self.counters: Counter[str] = Counter()
        self.output: DeviceOutput | None = None
        self.drive: Drive | None = None
        self.recorder = Recorder()
        self._message = ""  # used while there is no link: the drive of a link has a message of its own
        self._faulty = self._closing = False
        self._arm_id = self._stops = 0  # highest id of an arming in a request; number of stops in the last heartbeat
        self._heartbeat: Heartbeat | None = None
        self._heartbeat_at = -math.inf
        self._retry_at = 0.0

    # -- input from outside

    def apply(self, request: StreamRequest, now: float) -> None:
        """Take a new request."""
        self._guarded(now, lambda: self._apply(request, now))

    def _apply(self, request: StreamRequest, now: float) -> None:
        old, self.request = self.request, request
        before, self._arm_id = self._arm_id, max(self._arm_id, request.arm_id)
        if self.drive is not None:
            self.drive.request = request
        request.check()
        if not request.same_link(old):
            self.counters.clear()
            self._leave(now, "")
            self._retry_at = now
        leaving, moved = self.drive is not None and self.drive.leaving, False
        if self.drive is not None and not leaving:
            self._log(self.drive.connection, now)
        if self.drive is not None and not leaving and request.calibration != old.calibration:
            self.drive.recalibrate(request.calibrated())
            moved = request.mode != "panel"  # a screen's map gives volts, whatever the calibration is
        if self.output is not None and not leaving and (moved or not request.same_source(old)):
            self._choose_source(now)
        if request.arm_id == 0 or request.arm_id < before:
            if self.drive is not None:
                self.drive.give_up(now, self.drive.message)
        elif request.arm_id > before and request.stops >= self._stops:
            late = now - request.arm_at if request.arm_at else 0.0
            if late <= request.stall:
                self._arm(now)
            elif self.drive is not None:
                self.drive.message = f"Arm was pressed {late:.1f} s ago, so nothing was armed. Press it again"

    def heartbeat(self, heartbeat: Heartbeat, now: float) -> None:
        """Take a sign of life; go to the safe state if it counts a new stop."""
        if heartbeat.stops != (self._heartbeat.stops if self._heartbeat is not None else 0):
            self._stops = heartbeat.stops
            self.stop(now, "Stopped")
        self._heartbeat, self._heartbeat_at = heartbeat, now if heartbeat.at is None else min(heartbeat.at, now)
        if self.output is not None:
            self.output.show(heartbeat, now)

    def stop(self, now: float, message: str) -> None:
        """Go to the safe state; no samples are sent before the next arming."""
        if (drive := self.drive) is not None:
            self._guarded(now, lambda: drive.stop(now, message))

    def shut(self, now: float) -> None:
        """Begin to end: go to the safe state, then close the link.

        Call `tick` until `finished` is true.
        """
        self._closing = True
        self._guarded(now, lambda: self._leave(now, self.message))

    def tick(self, now: float) -> float:
        """Do the due work; return when `tick` is due next [s]."""
        self._guarded(now, lambda: self._tick(now))
        return self.drive.next(now) if self.drive is not None else now + 0.02

    # -- how it stands

    @property
    def state(self) -> State:
        """The state of the link, for people."""
        if self._faulty and (self.drive is not None or self.request.connect):
            return State.FAULT
        return self.drive.state if self.drive is not None else State.DISCONNECTED

    @property
    def message(self) -> str:
        """The last error, or the awaited event."""
        return self.drive.message if self.drive is not None else self._message

    @property
    def connection(self) -> Connection | None:
        """The open link, None without one."""
        return self.drive.connection if self.drive is not None else None

    @property
    def armed(self) -> bool:
        """Whether the device is arming or gets samples, so that it may move.

        False on the way to the safe state, although the device may move then, too.
        """
        return self.drive is not None and self.drive.armed

    @property
    def finished(self) -> bool:
        """Whether `shut` was called and the link is closed since."""
        return self._closing and self.drive is None

    def counted(self) -> dict[str, int]:
        """Return all counts that are not zero, by name."""
        counted = {**self.counters, **(self.output.limited() if self.output is not None else {})}
        return {name: count for name, count in sorted(counted.items()) if count}

    def status(self) -> dict[str, Any]:
        """Return the status as plain JSON values.

        They include the state, the message, the counters and the driven values.
        """
        drive, message = self.drive, self.message
        going = drive.going if drive is not None else ""
        return {
            "state": self.state,
            "message": "; ".join(filter(None, (message.rstrip("."), going))) if going else message,
            "armed": self.armed,
            "arm_id": self._arm_id,
            "pose_known": drive is not None and drive.pose_known,
            "astray": drive is not None and drive.astray,
            "counters": dict(self.counters),
            "log": self.recorder.status(),
            **(self.output.status() if self.output is not None else {}),
            **(drive.connection.status() if drive is not None else {}),
        }

    # -- the link

    def _tick(self, now: float) -> None:
        drive = self.drive
        if drive is None:
            if self.request.connect and not self._closing and now >= self._retry_at:
                self._connect(now)
            return
        if drive.poll(now):
            source = drive.output.source
            if isinstance(source, TrackSource) and source.output_hz != drive.connection.output_hz:
                self._choose_source(now)  # the device has reported its update rate since the source was made
            drive.tick(now, alive=self._alive(now))
        elif drive.drained:
            self._close(drive.message)

    def _connect(self, now: float) -> None:
        """Open the link, and begin to recognise the device.

        Raises:
            DermisError: a setting is impossible, or the link cannot be opened or used.
        """
        request = self.request
        self._faulty, self._message = False, ""
        self._plan_retry(now)
        request.check()
        output = self.output = DeviceOutput(request, self.output.source if self.output is not None else None)
        self._choose_source(now)
        url = Url(request.url)
        link = self._open_link(url, output.wire, request.protocol)
        try:
            adapter = adapters.make(request.protocol, output.wire, url.options)
            connection = Connection(link, adapter, output, self.counters, now, self._clock)
            connection.recorder = self.recorder
            self.recorder.choose(request, output, adapter, now)
        except DermisError:
            link.close()
            raise
        self.drive = Drive(connection, request, self.counters, self._message)

    def _guarded(self, now: float, work: Callable[[], None]) -> None:
        """Work with the link; end it if it is lost or the work fails.

        A lost link is closed at once. After any other DermisError the device goes to its safe state first. The message
        says why the link ends.
        """
        try:
            work()
        except Gone as error:
            astray = self.drive is not None and self.drive.astray
            self.counters["links lost"] += 1
            self.counters["safe states not confirmed"] += astray
            lost = " The link was lost before the safe state was sure. Switch the device's supply off"
            self._plan_retry(now)
            self._close(f"{error}{lost if astray else ''}")
        except DermisError as error:
            message = str(error)
            self.counters["faults"] += 1
            self._faulty = True
            self._plan_retry(now)
            self._guarded(now, lambda: self._leave(now, message))

    def _plan_retry(self, now: float) -> None:
        """Plan when to connect again.

        A link that is being ended already does not change the plan.
        """
        if self.drive is None or not self.drive.leaving:
            self._retry_at = now + RETRY if self.request.reconnect else math.inf

    def _leave(self, now: float, message: str) -> None:
        if self.drive is None:
            self._message = message
        else:
            self.drive.leave(now, message)

    def _close(self, message: str) -> None:
        drive, self.drive, self._message = self.drive, None, message
        if drive is not None:
            drive.connection.link.close()
        if self._closing or not self.request.connect:
            self.recorder.close()

    def _log(self, connection: Connection, now: float) -> None:
        """Begin, continue or end the log, as the request asks.

        If that fails, the message says why, and the stream goes on.
        """
        try:
            self.recorder.choose(self.request, connection.output, connection.adapter, now)
        except DermisError as error:
            assert self.drive is not None
            self.drive.message = str(error)

    # -- arming, and the source

    def _arm(self, now: float) -> None:
        if self.drive is None:
            self._message = "not connected, so nothing was armed"
            return
        if self.drive.output.source is None and not self.drive.leaving:
            self._choose_source(now)
        self.drive.arm(now, alive=self._alive(now))

    def _alive(self, now: float) -> bool:
        """Return whether Blender gives signs of life, or need not.

        With `play_on` in the request, a track or a panel goes on without signs of life.
        """
        source = self.output.source if self.output is not None else None
        needless = self.request.play_on and isinstance(source, TrackSource | PanelSource)
        return needless or now - self._heartbeat_at <= self.request.stall

    def _choose_source(self, now: float) -> None:
        """Make the source of the request's mode, and blend over to it.

        A source that goes on where the one before it was needs no blend. If no source can be made, an armed device
        goes to its safe state, and the message says why.
        """
        output, drive = self.output, self.drive
        assert output is not None
        published = self._heartbeat.values if self._heartbeat is not None else ()
        output_hz = drive.connection.output_hz if drive is not None else output.rate
        try:
            goes_on = output.choose_source(self.request, published, self._load_screen, output_hz)
        except DermisError as error:
            if drive is not None:
                drive.give_up(now, str(error))
            else:
                self._message = str(error)
        else:
            if drive is not None and not goes_on:
                drive.blend()

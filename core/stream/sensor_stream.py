"""SensorStream: a device that is driven while a sensor is read.

If the sensor falls silent, the device goes to its safe state.
"""

from __future__ import annotations

import math

import numpy as np

from .. import clock
from ..arrays import Array
from ..errors import DermisError
from .local_stream import LocalStream, say
from .request import StreamRequest
from .sensor_input import Sensed, SensorInput
from .shared_state import Heartbeat
from .signals import Interrupted, Signals
from .streamer import Streamer
from .virtual.link import open_any_link

FIRST = 5.0  # [s] how long the first reading of a sensor is waited for


class SensorStream(LocalStream):
    """A device that is driven while a sensor is read.

    It gets its commands as a followed preview does. If the newest reading is older than the request's `stall`, the time
    that Blender may be silent, the device goes to its safe state.

    Args:
        request: its mode is 'follow'. sensor: gives the readings. channels: names of the channels of the commands, in
            their order.
    """

    def __init__(
        self, request: StreamRequest, sensor: SensorInput, channels: tuple[str, ...], signals: Signals
    ) -> None:
        super().__init__(Streamer(open_any_link, clock=clock.now), request, signals)
        self.sensor, self.channels = sensor, channels
        self._watched = False  # whether readings are used, and their absence stops the device
        self._seen: Sensed | None = None
        self._number, self._values = 0, tuple[float, ...]()
        self._order: list[int] = []

    def prepare(self, does: str) -> None:
        """Open the link and announce the stream.

        Args:
            does: the device's task, for people.

        Raises:
            DermisError: the device cannot be reached, or the commands lack one of its channels.
            Interrupted: a signal came first.
        """
        drive = self.connect()
        wire = drive.output.wire
        missing = [name for name in wire.names if name not in self.channels]
        if missing:
            raise DermisError("there is no command for this channel", where=wire.spec.name, value=missing)
        self._order = [self.channels.index(name) for name in wire.names]
        if drive.connection.adapter.caution:
            say(drive.connection.adapter.caution)
        say(f"{wire.spec.name} at {self.request.url} {does} {self.sensor.name}. Ctrl-C: safe state, and the end.")

    def rest(self, seconds: float) -> Array:
        """Wait, and return the readings of the untouched sensor meanwhile.

        The result has the shape (readings, channels).

        Raises:
            DermisError: no reading came.
            Interrupted: a signal came first.
        """
        first = self.first()
        since = clock.now()
        self.run(lambda: clock.now() - since >= seconds or self.sensor.ended)
        if self.signals.number:
            raise Interrupted
        found = self.sensor.since(since) or [first]
        return np.array([sensed.values for sensed in found])

    def first(self) -> Sensed:
        """Wait for the first reading.

        Raises:
            DermisError: none came.
            Interrupted: a signal came first.
        """
        began = clock.now()
        self.run(lambda: self.sensor.count > 0 or self.sensor.ended or clock.now() - began > FIRST)
        if self.signals.number:
            raise Interrupted
        if (last := self.sensor.last) is None:
            raise self.no_more(f"no reading came within {FIRST:g} s")
        return last

    def paced(self) -> None:
        """Wait for two more readings, and refuse a sensor that is too slow.

        Call it before the device is armed.

        Raises:
            DermisError: the sensor gave no reading for longer than `stall`, after which its silence ends the stream.
            Interrupted: a signal came first.
        """
        most = self.request.stall
        began, before = clock.now(), self.sensor.count
        self.run(lambda: self.sensor.count >= before + 2 or self.sensor.ended or clock.now() - began > 2.0 * most)
        if self.signals.number:
            raise Interrupted
        heard = [sensed.at for sensed in self.sensor.since(-math.inf)][before - self.sensor.count - 1 :]
        apart = max(later - earlier for earlier, later in zip(heard, [*heard[1:], clock.now()], strict=True))
        if apart > most and not self.sensor.ended:
            raise DermisError(
                "the sensor is too slow to be followed",
                where=self.sensor.name,
                value=f"no reading for {apart:.2g} s",
                limit=f">= {1.0 / most:g} readings a second: without one for {most:g} s a stream ends",
                remedy="Let it send more often, also while nothing changes",
            )

    def drive_to(self, values: Array) -> None:
        """Take new commands, in the order of `channels`."""
        self._values = tuple(float(values[i]) for i in self._order)

    def shut(self) -> None:
        """Stop reading the sensor, and go to the safe state.

        No reading can break off the way there. Safe to call twice.
        """
        self._watched = False
        super().shut()

    def tick(self, now: float) -> float:
        """Take a new reading, pass on its command, and do the due work.

        The command goes to the streamer in a heartbeat, as those of Blender do.
        """
        newest = self.sensor.last
        if self._watched and newest is not None:
            if newest is not self._seen:
                self._seen = newest
                self.read(newest)
            if now - newest.taken > self.request.stall and self.streamer.armed:
                self.streamer.stop(now, f"the sensor gave no reading for {self.request.stall:g} s")
        self._number += 1
        self.streamer.heartbeat(Heartbeat(self._number, 0, False, None, self._values), now)
        return super().tick(now)

    def read(self, newest: Sensed) -> None:
        """Act on a new reading."""

    def no_more(self, otherwise: str) -> DermisError:
        """Return an error that says why no readings come."""
        return DermisError(self.sensor.fault.rstrip(".") or otherwise, where=self.sensor.name)

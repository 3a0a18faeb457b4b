"""CollectSession: reads a sensor in every pose of a built device.

Each pose is approached from rest, so that friction is the same in all. After every `REPEAT` rows an earlier row is read
again, which shows the sensor's drift. A reading beyond a limit ends the session at once, and the device goes to its
safe state.

Source: [S2] III.A, and the corrections (rows come from rest)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .. import clock
from ..arrays import Array
from ..errors import DermisError
from .request import StreamRequest
from .sensor_input import Sensed, SensorInput
from .sensor_stream import SensorStream
from .signals import Interrupted, Signals

REPEAT = 50  # [1] rows from one repetition to the next
KEEP = 20  # [1] rows from one writing to the next
LATE = 5.0  # [s] longest delay after the planned arrival; a longer one means that the device or its link is stuck
REACHED = 1e-9  # [1] error of a channel at its goal, relative to the goal or to 1 unit, whichever is larger


@dataclass(frozen=True)
class Collected:
    """A row that was read.

    Attributes:
        row: number of the row in the sweep.
        again: whether the row is a repetition.
        at: time at which the reading of the row ended [s].
        reading: mean of the sensor's readings, shape (channels,).
    """

    row: int
    again: bool
    at: float
    reading: Array


class CollectSession(SensorStream):
    """Reads a sensor in every pose of a device.

    Args:
        request: see `SensorStream`.
        sensor: see `SensorStream`.
        channels: see `SensorStream`.
        signals: signals that end the session.
        settle: how long a pose is held before the sensor is read [s].
        average: how long the sensor is read [s].
        most: largest allowed difference of a sensor's channel from its value at rest, by the index of the channel. If a
            difference is larger, the device goes to its safe state.
    """

    def __init__(
        self,
        request: StreamRequest,
        sensor: SensorInput,
        channels: tuple[str, ...],
        signals: Signals,
        *,
        settle: float,
        average: float,
        most: Mapping[int, float],
    ) -> None:
        super().__init__(request, sensor, channels, signals)
        self.settle, self.average, self.most = settle, average, most
        self._rest: Array | None = None
        self._looked = 0.0  # [s] time of the last checked reading

    def collect(
        self,
        commands: Array,
        home: Array,
        rest: Array,
        done: Sequence[Collected],
        keep: Callable[[Sequence[Collected]], None],
    ) -> list[Collected]:
        """Arm, and read every row that has not been read; return all.

        Args:
            commands: commands of the rows, shape (n, channels).
            home: commands of the device at rest.
            rest: the reading of the device at rest, shape (channels,).
            done: rows of an earlier run.
            keep: function that writes rows. It is called every `KEEP` rows and at the end of the session, also if an
                error or a signal ends the session.

        Raises:
            DermisError: a limit was passed, the sensor is too slow or fell silent, or the device's command
                does not reach its goal.
            Interrupted: a signal came.
        """
        self.paced()
        found = list(done)
        there = {item.row for item in found if not item.again}
        todo = [row for row in range(len(commands)) if row not in there]
        self._rest, self._watched, self._looked = rest, True, clock.now()
        self.drive_to(home)
        self.tick(clock.now())
        self.arm()
        try:
            self._go(home, self.request.ramp)
            for row in todo:
                found.append(self._read_row(row, commands[row], home, again=False))
                count = sum(not item.again for item in found)
                if count % REPEAT == 0:
                    earlier = [item.row for item in found if not item.again][-REPEAT]
                    found.append(self._read_row(earlier, commands[earlier], home, again=True))
                if count % KEEP == 0:
                    keep(found)
        finally:
            keep(found)
        self._go(home, 0.0)
        return found

    def read(self, newest: Sensed) -> None:
        """Stop the device if a reading is beyond a limit."""
        assert self._rest is not None
        since, self._looked = self._looked, newest.taken
        heard = [*self.sensor.since(since), newest]  # a peak between two ticks counts
        values = np.array([sensed.values for sensed in heard])
        for place, most in self.most.items():
            off = float(np.abs(values[:, place] - self._rest[place]).max())
            if off > most and self.streamer.armed:
                what = f"channel {place + 1} is {off:.4g} from its rest, more than the limit of {most:g}"
                self.streamer.stop(clock.now(), what)

    def _read_row(self, row: int, command: Array, home: Array, *, again: bool) -> Collected:
        self._go(home, 0.0)
        self._go(command, 0.0)
        self._wait(self.settle)
        since = clock.now()
        self._run(lambda: clock.now() - since >= self.average and self._heard(since))
        readings = self.sensor.since(since)
        return Collected(row, again, clock.now(), np.mean([sensed.values for sensed in readings], axis=0))

    def _go(self, command: Array, more: float) -> None:
        """Drive to a command, and wait until the limiter has reached it.

        Args:
            command: the command.
            more: time that is allowed in addition to the time that the slew limits need [s].

        Raises:
            DermisError: the limiter needs longer than the slew limits, `more` and `LATE` together.
        """
        self.drive_to(command)
        output = self.streamer.output
        assert output is not None
        goal = output.limiter.driven(np.array(self._values))
        scale = np.maximum(np.abs(goal), 1.0)
        began, slew = clock.now(), output.wire.slew
        way = float(np.max(np.abs(goal - output.limiter.last) / np.where(np.isfinite(slew), slew, np.inf), initial=0.0))

        def there() -> bool:
            return bool((np.abs(output.limiter.last - goal) <= REACHED * scale).all())

        late = began + way + more + LATE
        self._run(lambda: there() or clock.now() > late)
        if not there():
            raise DermisError(
                "the device's command has not reached its goal",
                where=self.request.url,
                value=f"{LATE:g} s after the planned time",
            )

    def _heard(self, since: float) -> bool:
        """Return whether a reading was taken since a moment [s].

        No time limit is needed, because a sensor that stays silent ends the stream.
        """
        last = self.sensor.last
        return last is not None and last.taken >= since

    def _wait(self, seconds: float) -> None:
        until = clock.now() + seconds
        self._run(lambda: clock.now() >= until)

    def _run(self, done: Callable[[], bool]) -> None:
        """Let time pass until `done` returns true.

        Raises:
            DermisError: the sensor's readings ended, or the device is not armed any more.
            Interrupted: a signal came.
        """
        began = clock.now()
        armed = False

        def ended() -> bool:
            nonlocal armed
            armed = armed or self.streamer.armed
            return self.sensor.ended or (not self.streamer.armed and (armed or clock.now() - began > 2.0))

        self.run(lambda: done() or ended())
        if self.signals.number:
            raise Interrupted
        if self.sensor.ended:
            raise self.no_more("the sensor's readings have ended")
        if not self.streamer.armed:
            raise self.refusal("the device is not armed")

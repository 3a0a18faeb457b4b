"""SensorSession: a device that follows a sensor live.

Each reading is looked up when it arrives. The commands reach the device as those of a followed preview do: through the
ramp, the limits, and the drive, which may stop at any moment. The session also measures its latency.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from .. import clock
from ..arrays import Array
from .local_stream import say
from .request import StreamRequest
from .sensor_input import Sensed, SensorInput
from .sensor_stream import SensorStream
from .signals import Signals


class Follows(Protocol):
    """Makes commands of readings; `core.design.follow.Follower` is one.

    Attributes:
        beyond: number of readings that resemble none of its own. first_beyond: the first of them, for people.
    """

    beyond: int
    first_beyond: str

    def command(self, reading: Array) -> Array: ...  # noqa: D102


class SensorSession(SensorStream):
    """A device that follows a sensor.

    Attributes:
        readings: number of readings looked up.
        latencies: times from a reading's arrival here to the first command after it [s].
    """

    def __init__(
        self, request: StreamRequest, sensor: SensorInput, channels: tuple[str, ...], signals: Signals
    ) -> None:
        super().__init__(request, sensor, channels, signals)
        self.readings = 0
        self.latencies: list[float] = []
        self._follows: Follows | None = None
        self._offset: Array | float = 0.0
        self._open: Sensed | None = None  # the reading looked up last, if no command has left since

    def follow(self, follows: Follows, offset: Array | float = 0.0) -> None:
        """Arm, and follow until a signal ends it, or until no more readings come.

        Args:
            offset: added to each reading, shape (channels,), for example to move its rest to that of the table.

        Raises:
            DermisError: no readings come, or too few, or the device is not armed any more.
            Interrupted: a signal came first.
        """
        self.first()
        self.paced()
        self._follows, self._offset, self._watched = follows, offset, True
        self.tick(clock.now())  # the first values to follow, and a sign of life, come before anything is armed
        self.arm()
        self.run(lambda: not self.streamer.armed or self.sensor.ended)
        if self.signals.number:
            return
        if self.sensor.ended and self.sensor.fault:
            raise self.no_more("no more readings")
        if not self.streamer.armed:
            raise self.refusal("the device disarmed itself")

    def summary(self) -> str:
        """Return a text of readings, latency and counts."""
        counted, latencies = self.streamer.counted(), np.array(self.latencies) * 1e3
        lines = [f"readings {self.sensor.count}, looked up {self.readings}"]
        if len(latencies):
            median, late = np.percentile(latencies, (50, 95))
            lines.append(
                f"latency median {median:.2f} ms, p95 {late:.2f} ms from a reading's arrival here to its command "
                f"leaving ({len(latencies)} of {self.readings} readings)"
            )
        if self.sensor.bad:
            counted["bad readings"] = self.sensor.bad
        if self._follows is not None and self._follows.beyond:
            counted["readings beyond the table"] = self._follows.beyond
        lines.append(", ".join(f"{name} {count}" for name, count in sorted(counted.items())))
        return "\n".join(filter(None, lines))

    def tick(self, now: float) -> float:
        """Do the due work, and measure how long a reading's command took."""
        before = self.streamer.counters["sent"]
        due = super().tick(now)
        if self._open is not None and self.streamer.counters["sent"] > before:
            self.latencies.append(clock.now() - self._open.at)
            self._open = None
        return due

    def read(self, newest: Sensed) -> None:
        """Look a reading up, and follow its command."""
        assert self._follows is not None
        self._open = newest
        self.readings += 1
        before = self._follows.beyond
        self.drive_to(self._follows.command(newest.values + self._offset))
        if self._follows.beyond > before == 0:
            say(
                f"The table has nothing like this reading, and the next ones are only counted: "
                f"{self._follows.first_beyond}. Its nearest rows are followed."
            )

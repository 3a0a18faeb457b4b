"""The output to a device: values of a source, through the limiter.

The sample clock says at which moments.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ..arrays import Array
from ..devices.calibration import Calibration
from .output_limiter import OutputLimiter
from .protocols.wire import Wire
from .request import StreamRequest
from .sample_clock import SampleClock
from .shared_state import Heartbeat
from .source import FollowSource, Source, follow_values, goes_on, source_of
from .touch_panel_source import PanelSource, Screen
from .track_source import TrackSource

BLEND = 0.3  # [s] over which the change to a new calibration or another source is blended in


class DeviceOutput:
    """The output to one device.

    It outlives the link, so that the numbers of limited values can be reported after the link's end.

    Args:
        source: the previous source, so that a playback goes on where it was.

    Attributes:
        wire: description of the device for a sender.
        rate: rate of the commands [Hz].
        sample_clock: decides which samples are due, and measures their lateness.
        limiter: applies calibration and limits.
        source: source of the values; None before the first one, and if none could be made.
        wanted: the values requested last [units], before calibration and limits.

    Raises:
        DermisError: no device is chosen, or its preset or calibration cannot be used.
    """

    def __init__(self, request: StreamRequest, source: Source | None = None) -> None:
        spec = request.spec()
        self.wire = Wire.of(spec, request.calibrated())
        self.rate = request.rate or spec.rate
        self.sample_clock = SampleClock(self.rate)
        self.limiter = OutputLimiter(self.wire, self.sample_clock.period)
        self.source = source
        self.wanted = self.wire.safe_command

    @property
    def moving(self) -> bool:
        """Whether there is a source whose values may change.

        It is any source but a track whose playback stands still.
        """
        return self.source is not None and self.source.moving

    def choose_source(
        self,
        request: StreamRequest,
        published: Sequence[float],
        load_screen: Callable[[Path], Screen] | None,
        output_hz: float,
    ) -> bool:
        """Make the source of the request's mode.

        Returns whether it takes over from the source before it without a blend.

        Args:
            published: values that Blender published last.
            output_hz: values a second that reach the actuators [Hz].

        Raises:
            DermisError: the source cannot be made; there is no source then.
        """
        old, self.source = self.source, None
        self.source = source_of(request, self.wire, old, published, load_screen, output_hz)
        return goes_on(self.source, old)

    def show(self, heartbeat: Heartbeat, now: float) -> None:
        """Take the state that Blender shows."""
        if isinstance(self.source, FollowSource):
            self.source.latest = follow_values(self.wire, heartbeat.values)
        elif isinstance(self.source, TrackSource | PanelSource) and heartbeat.time is not None:
            self.source.report(heartbeat.time, heartbeat.playing, now)

    def begin(self, pose: Array, now: float, horizon: float, ramp: float) -> None:
        """Begin at a pose [units], and blend from it to the wanted values.

        Args:
            horizon: time by which samples leave before their moments [s].
            ramp: duration of the blend [s].
        """
        self.limiter.plan(self.sample_clock.period)
        self.limiter.begin(pose, now + horizon - 1.0 / self.rate, ramp)
        self.sample_clock.start(now + horizon, horizon)
        if isinstance(self.source, PanelSource):
            self.source.begin(now)

    def blend(self) -> None:
        """Blend over to the changed values."""
        self.limiter.blend(self.sample_clock.next, BLEND)

    def recalibrate(self, calibration: Calibration | None) -> bool:
        """Take another calibration; return whether it changed the safe pose.

        Raises:
            DermisError: the calibration does not fit the device or the track that plays.
        """
        before, wire = self.wire, Wire.of(self.wire.spec, calibration)
        if isinstance(self.source, TrackSource):
            self.source.take(wire)  # may refuse the calibration; nothing has been changed yet
            self.source.offset += wire.latency - before.latency
        self.wire = wire
        self.limiter.recalibrate(wire)
        if isinstance(self.source, PanelSource):
            self.source.recalibrated(wire)
        return bool((before.safe != self.wire.safe).any())

    def limited(self) -> dict[str, int]:
        """Return how many values were limited, by channel and limit."""
        law = {"amplitude.law": self.source.limited} if isinstance(self.source, PanelSource) else {}
        return {**self.limiter.limited, **law}

    def status(self) -> dict[str, Any]:
        """Return the output's state as JSON values.

        It has the rate, the lateness, the numbers of limited values, and the driven values, among others.
        """
        p50, p99 = self.sample_clock.lateness.percentiles()
        return {
            "rate": self.rate,
            "jitter_p50_us": plain(p50 * 1e6),
            "jitter_p99_us": plain(p99 * 1e6),
            "limited": self.limited(),
            "names": list(self.wire.names),
            "units": list(self.wire.units),
            "values": self.limiter.last.tolist(),
            "safe_s": plain(self.wire.safe_seconds),
            "not_rendered": str(self.source.loss or "") if isinstance(self.source, TrackSource) else "",
        }


def plain(value: float) -> float | None:
    """Return a number rounded for JSON, or None if it is not finite."""
    return round(value, 3) if math.isfinite(value) else None

"""A track as the source of a stream."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..devices.frequency_response import BEYOND, FrequencyResponse
from ..errors import DermisError
from ..interpolate import interpolate
from ..track import export
from ..track.command_track import CommandTrack
from .lowpass import Loss, low_passed
from .protocols.wire import Wire
from .track_clock import TrackClock


class TrackSource:
    """The values of a track at the times of Blender's playback.

    Args:
        offset: added to Blender's time [s]: positive plays the track earlier.
        free: play on while Blender's main thread stalls.
        output_hz: values a second that reach the actuators [Hz]; a track that has more is low-passed. 0: no low-pass.

    Attributes:
        safe: values before and after the track [units], shape (channels,).
        loss: the part of the track that low-passing leaves out; None: the track is played as it is.
        asked: time of the track whose values were requested last [s]; NaN before the first.
    """

    def __init__(
        self, wire: Wire, track: CommandTrack, offset: float = 0.0, *, free: bool = False, output_hz: float = 0.0
    ) -> None:
        missing = [n for n in wire.names if n not in {c.name for c in track.channels}]
        if missing:
            raise DermisError(
                "the track is for another device", where=track.spec.name, value=", ".join(missing), limit=wire.spec.name
            )
        for name, unit in zip(wire.names, wire.units, strict=True):
            if track.spec.channel(name).unit != unit:
                raise DermisError(
                    "a channel has another unit in the track",
                    where=name,
                    value=track.spec.channel(name).unit,
                    limit=unit,
                )
        self.clock = TrackClock(free=free)
        self.spec, self.track, self.offset, self.output_hz = wire.spec, track, offset, output_hz
        self._times = track.times
        self._values = np.stack([track.column(n) for n in wire.names], axis=1)
        self.safe = wire.safe_command
        self.loss: Loss | None = None
        self.asked = math.nan
        if output_hz > 0 and len(track.times) > 1:
            self._low_pass(wire, output_hz)
        step = track.duration / (len(self._times) - 1) if len(self._times) > 1 else 0.0
        even = step > 0 and np.abs(np.diff(self._times) - step).max() < 1e-6 * step
        self._rate = 1.0 / step if even else 0.0
        self._wanted = self._values
        self._answered: tuple[Mapping[int, FrequencyResponse], float] = {}, 0.0
        self.take(wire)

    def take(self, wire: Wire) -> None:
        """Take another calibration of the device.

        The track's values are made anew by inverting the calibration's measured frequency responses.

        Raises:
            DermisError: the track moves faster than was measured, or its samples are not evenly spaced.
        """
        answered = wire.frequency, wire.latency
        if answered != self._answered:  # not made anew without need, since a device waits meanwhile
            self._values = equalised(wire, self.track.spec.name, self._wanted, self._rate)
            self._answered = answered

    def plays(self, wire: Wire, track: CommandTrack, output_hz: float) -> bool:
        """Return whether this source plays a track for a device already.

        Its offset does not matter.
        """
        return self.spec is wire.spec and self.track is track and self.output_hz == output_hz

    def _low_pass(self, wire: Wire, output_hz: float) -> None:
        times, values = low_passed(self._times, self._values, output_hz)
        if values is self._values:
            return
        missing = self._values - interpolate(times, values, self._times)
        span = np.where(
            np.isfinite(wire.range_high - wire.range_low),
            wire.range_high - wire.range_low,
            np.ptp(self._values, axis=0),
        )
        largest, rms = np.abs(missing).max(axis=0), np.sqrt((missing**2).mean(axis=0))
        self.loss = Loss(output_hz, wire.names, wire.units, largest, rms, span)
        self._times, self._values = times, values

    @property
    def moving(self) -> bool:
        """Return whether the playback runs."""
        return self.clock.running

    def report(self, time: float, playing: bool, now: float) -> None:
        """Take Blender's state now: track time [s] and whether it plays."""
        self.clock.report(time, playing, now)

    def values_at(self, moment: float, now: float) -> Array:
        """Return the values at a moment [units].

        Before and after the track they are those of the safe state.
        """
        self.asked = self.clock.at(moment, now) + self.offset
        return self.value(self.asked)

    def value(self, time: float) -> Array:
        """Return the values at a time of the track [units]."""
        times = self._times
        if not len(times) or time < times[0] - 1e-9 or time > times[-1] + 1e-9:
            return self.safe
        if self._rate:
            at = min(max((time - float(times[0])) * self._rate, 0.0), len(times) - 1.0)
            k = int(at)
        else:
            k = max(int(np.searchsorted(times, time, side="right")) - 1, 0)
            at = k + ((time - times[k]) / (times[k + 1] - times[k]) if k + 1 < len(times) else 0.0)
        if k + 1 >= len(times):
            return self._values[-1]
        first = self._values[k]
        return first + (at - k) * (self._values[k + 1] - first)


def equalised(wire: Wire, track: str, values: Array, rate: float) -> Array:
    """Return the values to drive so that the actuators reach a track.

    They follow from the inverse of the actuators' frequency responses.

    Args:
        track: name of the track, for messages.
        values: values of the wire's channels, shape (n, channels).
        rate: rate of the track [Hz]; 0 if its samples are not evenly spaced.

    Raises:
        DermisError: a channel moves faster than was measured, or the samples are not evenly spaced.
    """
    driven = values
    for k, response in wire.frequency.items():
        if len(values) < 2 or not np.ptp(values[:, k]) > 0.0:
            continue
        where = f"{track}, {wire.names[k]}"
        if not rate:
            raise DermisError(
                "a frequency response can only be inverted for evenly spaced samples",
                where=where,
                remedy="Resample the track: export it with --rate",
            )
        share = response.beyond(values[:, k], rate)
        if share > BEYOND:
            raise DermisError(
                "the track moves faster than the frequency response was measured",
                where=where,
                value=f"{100 * share:.1f} % of the movement is beyond {response.span[1]:g} Hz",
                limit=f"{100 * BEYOND:g} %",
                remedy="Measure higher frequencies, or take the frequency response out of the calibration",
            )
        driven = driven.copy() if driven is values else driven
        driven[:, k] = response.inverted(values[:, k], rate, wire.latency)
    return driven


_read: list[tuple[tuple[str, int, int], CommandTrack]] = []  # the track read last


def read_track(path: Path) -> CommandTrack:
    """Return the track of a file.

    The file read last is not read again if it has not changed, since a device waits meanwhile.
    """
    try:
        seen = path.stat()
        key = (str(path), seen.st_mtime_ns, seen.st_size)
    except OSError:
        return export.read(path)  # raises the error
    if not _read or _read[0][0] != key:
        _read.clear()  # frees the memory of the old track before the new one is read
        _read.append((key, export.read(path)))
    return _read[0][1]

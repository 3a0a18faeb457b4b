"""CommandTrack: commands of a device over time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..devices.spec import Channel, DeviceSpec, range_disc
from ..errors import DermisError, Finding, Severity
from ..interpolate import MAX_SAMPLES, Method, grid, interpolate
from .limiter import DIGITS, SLEW_SLACK, Limiter

# Kinds of limiting: severity and text of their findings.
LIMITED: dict[str, tuple[Severity, str]] = {
    "not_finite": ("error", "samples were not finite numbers: the last finite value was used, at the start rest"),
    "range": ("warning", "samples were limited to the channel's range"),
    "disc": ("warning", "samples were pulled back to the rim of the round range"),
    "slew": ("warning", "samples were limited to the channel's largest speed"),
    "slew_of_pair": ("warning", "samples were slowed down so that both channels of the round range arrive together"),
    "ramp": ("info", "samples were blended with rest at the start or the end"),
}
RECORDED = "recorded"  # a track's `meta['sensor']` begins with it if a real sensor recorded the touch
RATE_SLACK = 0.01  # largest relative difference between the stated rate and the rate of the samples


@dataclass(frozen=True)
class CommandTrack:
    """Command values of one device at increasing times, in SI.

    Attributes:
        spec: the device's preset, with its channels and rate.
        times: time of each sample from the start of the frame range [s], strictly increasing, shape (n,).
        values: one column for each of `spec.channels`, in the channel's unit, shape (n, channels).
        meta: information for readers of the file, such as finger, scene, frame range, fps and content hash.
        limited: number of samples that a limiter changed, by channel and kind of limit ('tactor_x.range',
            'tactor_x.slew' ...).

    Commands that jump by 1 mm and back within 2 ms are limited to the largest speed of the channel, 150 mm/s:

    >>> import numpy as np
    >>> from dermis import CommandTrack, Library
    >>> values = np.zeros((3, 4))
    >>> values[1, 0] = 1e-3  # tactor_x
    >>> track = CommandTrack(Library().device("haptip"), np.array([0.0, 1e-3, 2e-3]), values)
    >>> [finding.code for finding in track.check()]
    ['too-fast']
    >>> possible = track.within_limits()
    >>> possible.column("tactor_x").round(9).tolist(), possible.limited["tactor_x.slew"]
    ([0.0, 0.00015, 0.0], 1)
    """

    spec: DeviceSpec
    times: Array
    values: Array
    meta: Mapping[str, str] = field(default_factory=dict)
    limited: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.values.shape != (len(self.times), len(self.spec.channels)):
            raise DermisError(
                "values do not fit times and channels",
                where=self.spec.name,
                value=self.values.shape,
                limit=f"({len(self.times)}, {len(self.spec.channels)})",
            )

    def __repr__(self) -> str:
        size = f"{len(self.channels)} channels, {len(self.times)} samples"
        return f"CommandTrack({self.spec.key}, {size}, {self.duration:g} s at {self.spec.rate:g} Hz)"

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The device's channels, in the order of the columns."""
        return self.spec.channels

    def column(self, name: str) -> Array:
        """Return the values of one channel, shape (n,).

        Raises:
            DermisError: the device has no channel of this name.
        """
        for i, channel in enumerate(self.spec.channels):
            if channel.name == name:
                return self.values[:, i]
        raise DermisError(
            "no such channel", where=self.spec.name, value=name, limit=", ".join(c.name for c in self.channels)
        )

    @property
    def duration(self) -> float:
        """Time between the first and the last sample [s]."""
        return float(self.times[-1] - self.times[0]) if len(self.times) else 0.0

    def resampled(self, rate: float, method: Method = "linear") -> CommandTrack:
        """Return the track at another rate.

        The first sample stays at the same time. The last is at the track's last time or just before it.

        Args:
            rate: samples per second [Hz], also set in the new track's `spec`.
            method: 'linear', or 'pchip' (piecewise cubic, C1, monotone between samples). Neither overshoots.

        Raises:
            DermisError: the rate is not positive or needs too many samples, the method is unknown, the track is empty,
                or its times are not finite or not increasing.
        """
        if len(self.times) == 0:
            raise DermisError("the track is empty", where=self._place())
        if not np.isfinite(self.times).all():
            raise DermisError("a time is not a finite number", where=self._place())
        stuck = self._not_rising()
        if len(stuck):
            before, after = self.times[stuck[0]], self.times[stuck[0] + 1]
            raise DermisError(
                "times do not rise",
                where=f"{self._place()}, sample {stuck[0] + 1}",
                value=f"{after:g} s",
                limit=f"> {before:g} s",
            )
        if np.isfinite(rate) and self.duration * rate * len(self.channels) > MAX_SAMPLES:
            raise DermisError(
                "more samples than a track can hold",
                where=self._place(),
                value=f"{rate:g} Hz",
                limit=f"{MAX_SAMPLES / (self.duration * len(self.channels)):.6g} Hz, {MAX_SAMPLES} values in all",
            )
        times = grid(float(self.times[0]), float(self.times[-1]), rate)
        values = interpolate(self.times, self.values, times, method)
        return replace(self, spec=replace(self.spec, rate=float(rate)), times=times, values=values)

    def within_limits(
        self, *, start_at_rest: bool = False, ramp_in: float = 0.0, ramp_out: float = 0.0
    ) -> CommandTrack:
        """Return the track as the device can follow it.

        All samples are kept. The limits are applied in this order: values that are not finite are replaced by the last
        finite value, then ramps, range, round range and largest speed. The number of samples changed by each is added
        to the counts in `limited`.

        Args:
            start_at_rest: True if the device is at rest at the first sample and moves to the track from there.
            ramp_in: time over which the start is blended with rest [s].
            ramp_out: time over which the end is blended with rest [s].

        Raises:
            DermisError: a ramp is negative, or the times are not finite or not increasing.
        """
        for name, seconds in (("ramp_in", ramp_in), ("ramp_out", ramp_out)):
            if not (math.isfinite(seconds) and seconds >= 0):
                raise DermisError(f"{name} must not be negative", where=self._place(), value=seconds, limit=">= 0 s")
        if len(self.times) == 0:
            return self
        ends = math.isfinite(self.times[0]) and math.isfinite(self.times[-1])
        if not ends or np.count_nonzero(self.times[1:] > self.times[:-1]) < len(self.times) - 1:
            raise DermisError("times do not rise, so no speed can be limited", where=self._place())
        limiter = Limiter(self.spec, self.times, self.values)
        limiter.hold_finite()
        if ramp_in or ramp_out:
            limiter.ramp(ramp_in, ramp_out)
        limiter.range()
        limiter.disc()
        limiter.slew(start_at_rest)
        counts = dict(self.limited)
        for key, count in limiter.counts.items():
            counts[key] = counts.get(key, 0) + count
        return CommandTrack(self.spec, self.times, limiter.values, self.meta, counts)

    def check(self) -> tuple[Finding, ...]:
        """Return findings about the track: problems for the device or for a reader, and counts of limited samples.

        Errors have the codes 'empty', 'times-not-rising', 'not-finite', 'rate', 'out-of-range', 'too-fast' and
        'duplicate-actuator'. 'wire-budget' is a warning. Each kind in `limited` has a finding 'limited-KIND'.
        """
        return (
            *self._check_times(),
            *self._check_values(),
            *self._check_actuators(),
            *self._check_link_budget(),
            *self._check_limited(),
        )

    # -- checks

    def _check_times(self) -> Iterator[Finding]:
        if len(self.times) == 0:
            yield Finding("error", "empty", "the track has no samples", where=self._place(), count=0)
        bad = np.flatnonzero(~np.isfinite(self.times))
        if len(bad):
            yield Finding(
                "error",
                "not-finite",
                "a time is not a finite number",
                where=self._place(),
                value=float(self.times[bad[0]]),
                count=len(bad),
            )
        stuck = self._not_rising()
        if len(stuck):
            yield Finding(
                "error",
                "times-not-rising",
                "times do not rise",
                where=f"{self._place()}, sample {stuck[0] + 1}",
                value=float(self.times[stuck[0] + 1]),
                limit=f"> {self.times[stuck[0]]:g} s",
                count=len(stuck),
            )

        elif not len(bad) and len(self.times) > 1:
            yield from self._check_rate()

    def _check_rate(self) -> Iterator[Finding]:
        """Compare the stated rate with two rates of the samples: by the median and by the mean of their intervals.

        It is enough that one of the two agrees. A track with a gap, or with a few extra samples, therefore passes.
        """
        found = 1.0 / float(np.median(np.diff(self.times)))
        mean = (len(self.times) - 1) / self.duration
        if min(abs(found - self.spec.rate), abs(mean - self.spec.rate)) > RATE_SLACK * self.spec.rate:
            yield Finding(
                "error",
                "rate",
                "the stated rate is not that of the samples",
                where=self._place(),
                value=f"{self.spec.rate:g} Hz",
                limit=f"{found:.6g} Hz, by the median interval of the times",
                remedy="Correct the rate, or resample the track",
            )

    def _check_values(self) -> Iterator[Finding]:
        low = np.array([-np.inf if c.low is None else c.low - DIGITS * abs(c.low) for c in self.channels])
        high = np.array([np.inf if c.high is None else c.high + DIGITS * abs(c.high) for c in self.channels])
        finite = np.isfinite(self.values)
        beyond = finite & ((self.values < low) | (self.values > high))
        odd, far = np.any(~finite, axis=0), np.any(beyond, axis=0)
        for i, channel in enumerate(self.channels):
            values, place = self.values[:, i], self._place(channel.name)
            if odd[i]:
                what = "a value is not a finite number"
                yield self._finding("not-finite", what, place, ~finite[:, i], values, "finite numbers")
            if far[i]:
                what = "outside the channel's range"
                limit = f"{_number(channel.low)} to {_number(channel.high)} {channel.unit}"
                yield self._finding("out-of-range", what, place, beyond[:, i], values, limit)
            if channel.slew is not None and len(values) > 1 and not len(self._not_rising()):
                yield from self._check_speed(channel, values, place)
        pair = range_disc(self.spec)
        if pair is not None:
            i, j, radius = pair
            reach = np.hypot(self.values[:, i], self.values[:, j])
            bad = np.isfinite(reach) & (reach > radius * (1 + 2 * DIGITS))
            if bad.any():
                place = self._place(f"{self.channels[i].name} and {self.channels[j].name}")
                limit = f"a radius of {radius:g} {self.channels[i].unit}"
                yield self._finding("out-of-range", "outside the round range", place, bad, reach, limit)

    def _check_speed(self, channel: Channel, values: Array, place: str) -> Iterator[Finding]:
        assert channel.slew is not None
        step, width = np.abs(np.diff(values)), np.diff(self.times)
        size = np.maximum(np.abs(values[:-1]), np.abs(values[1:]))
        fast = np.isfinite(step) & (step > channel.slew * width * (1 + 2 * SLEW_SLACK) + 2 * DIGITS * size)
        if fast.any():
            speed = np.concatenate([[0.0], step / width])
            limit = f"{channel.slew:g} {channel.unit}/s"
            yield self._finding(
                "too-fast", "changes faster than the channel can", place, np.r_[False, fast], speed, limit
            )

    def _check_actuators(self) -> Iterator[Finding]:
        used: dict[str, str] = {}
        for channel in self.channels:
            if channel.actuator and channel.actuator in used:
                yield Finding(
                    "error",
                    "duplicate-actuator",
                    "two channels drive one actuator",
                    where=self._place(f"{used[channel.actuator]} and {channel.name}"),
                    value=channel.actuator,
                    limit="one channel for each actuator",
                    remedy="Correct the device preset",
                )
            used.setdefault(channel.actuator, channel.name)

    def _check_link_budget(self) -> Iterator[Finding]:
        budget = self.spec.link_budget
        bandwidth = budget.get("bandwidth", 0.0)
        if not bandwidth or self.duration <= 0:
            return
        driven = sum(bool(c.actuator) for c in self.channels)
        cost = budget.get("bits_per_sample", 0.0) + driven * budget.get("bits_per_channel", 0.0)
        rate = (len(self.times) - 1) / self.duration
        if cost * rate > bandwidth * (1 + DIGITS):
            yield Finding(
                "warning",
                "wire-budget",
                "the link cannot carry the track at its rate",
                where=self._place(),
                value=f"{cost * rate:.6g} bit/s",
                limit=f"{bandwidth:.6g} bit/s",
                remedy=f"Resample to {bandwidth / cost:.4g} Hz or less, or use a faster link",
            )

    def _check_limited(self) -> Iterator[Finding]:
        for key in sorted(self.limited):
            count = self.limited[key]
            name, _, kind = key.rpartition(".")
            severity, what = LIMITED.get(kind, ("warning", "samples were changed by a limiter"))
            if count:
                yield Finding(
                    severity,
                    f"limited-{kind.replace('_', '-')}",
                    f"{count} of {len(self.times)} {what}",
                    where=self._place(name or key),
                    count=count,
                )

    def _finding(self, code: str, what: str, place: str, bad: NDArray[np.bool_], values: Array, limit: str) -> Finding:
        """Return one finding for all bad samples: frame of the first, and the value that is farthest from zero."""
        rows = np.flatnonzero(bad)
        sizes = np.abs(values[rows])
        worst = float(values[rows[int(np.argmax(np.where(np.isnan(sizes), np.inf, sizes)))]])
        return Finding(
            "error",
            code,
            what,
            where=f"{place}, first at {self.times[rows[0]]:.6g} s",
            value=worst,
            limit=limit,
            frame=self._frame(float(self.times[rows[0]])),
            count=len(rows),
        )

    def _not_rising(self) -> NDArray[np.intp]:
        with np.errstate(invalid="ignore"):
            return np.flatnonzero(np.diff(self.times) <= 0)

    def _place(self, channel: str = "") -> str:
        owner = f"finger '{self.meta['finger']}', {self.spec.key}" if "finger" in self.meta else self.spec.key
        return f"{owner}, {channel}" if channel else owner

    def _frame(self, time: float) -> float | None:
        """Return the scene frame at a time [s]; None if `meta` has no valid frame range and fps."""
        try:
            first, fps = float(self.meta["frame_range"].split()[0]), Fraction(self.meta["fps"])
        except (KeyError, ValueError, IndexError, ZeroDivisionError):
            return None
        return round(first + time * float(fps), 6)


def _number(limit: float | None) -> str:
    return "any" if limit is None else f"{limit:g}"

"""Limiter: commands limited to the ranges and speeds of a device."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..devices.spec import DeviceSpec, range_disc
from ..following import follow
from ..interpolate import smoothstep

# Relative tolerance of a value: rounding to the nine digits of a file is off by up to half a unit of the ninth digit. A
# step between two such values is off by up to twice as much.
DIGITS = 5e-9
SLEW_SLACK = 1e-9  # relative tolerance of the largest step, since times and sums are rounded


class Limiter:
    """A copy of command values to which limits are applied one by one.

    Each method applies one limit and counts the samples that the limit changes.

    Args:
        spec: device whose channels state the limits.
        times: time of each sample [s], strictly increasing, shape (n,).
        values: one column for each channel, in its unit, shape (n, channels).

    Attributes:
        values: values after the limits that were applied so far, shape (n, channels).
        counts: number of samples that a limit changed, by 'CHANNEL.KIND'; it may be 0.
    """

    def __init__(self, spec: DeviceSpec, times: Array, values: Array) -> None:
        self.spec, self.times, self._pair = spec, times, range_disc(spec)
        self.values = np.array(values, dtype=np.float64)
        self.counts: dict[str, int] = {}

    def hold_finite(self) -> None:
        """Replace values that are not finite by the channel's last finite value.

        Before the first finite value of a channel, its rest value is used.
        """
        finite = np.isfinite(self.values)
        if np.count_nonzero(finite) == finite.size:
            return
        rows = np.arange(len(self.values))
        for i, channel in enumerate(self.spec.channels):
            bad = ~finite[:, i]
            if bad.any():
                last = np.maximum.accumulate(np.where(bad, -1, rows))
                filled = np.where(last < 0, channel.rest, self.values[last, i])
                self.values[:, i] = np.where(bad, filled, self.values[:, i])
                self._count(channel.name, "not_finite", int(bad.sum()))

    def ramp(self, seconds_in: float, seconds_out: float) -> None:
        """Blend the start and the end with the rest values by a smooth step.

        Args:
            seconds_in: duration of the ramp at the start [s].
            seconds_out: duration of the ramp at the end [s].
        """
        weight = np.ones(len(self.times))
        if seconds_in > 0:
            weight = np.minimum(weight, smoothstep((self.times - self.times[0]) / seconds_in))
        if seconds_out > 0:
            weight = np.minimum(weight, smoothstep((self.times[-1] - self.times) / seconds_out))
        rest = np.array([c.rest for c in self.spec.channels])
        blended = np.where(weight[:, None] < 1, rest + (self.values - rest) * weight[:, None], self.values)
        for i, channel in enumerate(self.spec.channels):
            self._replace(i, channel.name, "ramp", blended[:, i])

    def range(self) -> None:
        """Clip every channel to the range from its low to its high."""
        channels = self.spec.channels
        low = np.array([-np.inf if c.low is None else c.low for c in channels])
        high = np.array([np.inf if c.high is None else c.high for c in channels])
        beyond = (self.values < low) | (self.values > high)
        some = np.count_nonzero(beyond) > 0
        for i, channel in enumerate(channels):
            count = int(np.count_nonzero(beyond[:, i])) if some else 0
            if channel.low is not None or channel.high is not None:
                self._count(channel.name, "range", count)
            if count:
                self.values[:, i] = np.clip(self.values[:, i], low[i], high[i])

    def disc(self) -> None:
        """Move values outside the round range of two channels to its rim.

        They are moved along the radius.
        """
        if self._pair is None:
            return
        i, j, radius = self._pair
        x, y = self.values[:, i], self.values[:, j]
        reach = np.hypot(x, y)
        outside = reach > radius
        if not np.count_nonzero(outside):
            for column in (i, j):
                self._count(self.spec.channels[column].name, "disc", 0)
            return
        scale = np.where(outside, radius / np.where(outside, reach, 1.0), 1.0)
        for column, values in ((i, x * scale), (j, y * scale)):
            self._replace(column, self.spec.channels[column].name, "disc", values)

    def slew(self, start_at_rest: bool) -> None:
        """Limit the speed of every channel to its largest speed.

        Two channels with a common round range move along a straight line, so both are slowed down by the same factor.

        Args:
            start_at_rest: True if the device is at rest at the first sample and moves to the track from there.
        """
        pair = self._pair
        groups = [[i] for i in range(len(self.spec.channels)) if pair is None or i not in pair[:2]]
        if pair is not None:
            groups.append([pair[0], pair[1]])
        slews = np.array([np.inf if c.slew is None else c.slew for c in self.spec.channels])
        steps = (self.times[1:] - self.times[:-1])[:, None] * slews
        leaps = start_at_rest or np.count_nonzero(_leaps(self.values, steps)) > 0
        for group in groups:
            channels, own = [self.spec.channels[i] for i in group], slews[group]
            if all(channel.slew is None or np.isinf(channel.slew) for channel in channels):
                continue
            if not leaps:
                for channel in channels:
                    self._count(channel.name, "slew" if channel.slew is not None else "slew_of_pair", 0)
                continue
            start = np.array([c.rest for c in channels]) if start_at_rest else None
            followed = within_slews(self.times, self.values[:, group], own, start)
            for k, channel in enumerate(channels):
                if channel.slew is not None:
                    self._replace(group[k], channel.name, "slew", followed[:, k])
                else:  # slowed down by the other channel of the pair
                    self._replace(group[k], channel.name, "slew_of_pair", followed[:, k])

    def _replace(self, column: int, name: str, kind: str, values: Array) -> None:
        changed = int(np.count_nonzero(values != self.values[:, column]))
        self._count(name, kind, changed)
        if changed:
            self.values[:, column] = values

    def _count(self, name: str, kind: str, count: int) -> None:
        key = f"{name}.{kind}"
        self.counts[key] = self.counts.get(key, 0) + count


def within_slews(times: Array, target: Array, slews: Array, start: Array | None = None) -> Array:
    """Return the values with which a device follows a target at limited speed.

    All columns are slowed down by the same factor, so that they move along a straight line to the target.

    Args:
        times: [s], strictly increasing, shape (n,).
        target: values to be followed, shape (n, columns).
        slews: largest change of each column per second, shape (columns,).
        start: values at the first time, shape (columns,); None for those of the target.

    Returns:
        Shape (n, columns); equal to the target wherever the target can be reached.
    """
    steps = np.diff(times)[:, None] * slews
    leaps = np.flatnonzero(_leaps(target, steps).any(axis=1)) + 1
    if start is not None and len(target):
        target, leaps = np.vstack([start, target[1:]]), np.union1d([1], leaps)

    def advance(row: int, place: list[float], goal: list[float]) -> list[float] | None:
        share = 1.0
        for v, g, most in zip(place, goal, steps[row - 1].tolist(), strict=True):
            if abs(g - v) > most * (1 + SLEW_SLACK):
                share = min(share, most / abs(g - v))
        return None if share == 1.0 else [v + (g - v) * share for v, g in zip(place, goal, strict=True)]

    return follow(target, leaps, advance)


def _leaps(target: Array, steps: Array) -> NDArray[np.bool_]:
    """Return which changes of a target are too large, shape (n - 1, columns).

    Args:
        target: values, shape (n, columns).
        steps: largest change from each row to the next, shape (n - 1, columns).
    """
    return np.asarray(np.abs(target[1:] - target[:-1]) > steps * (1 + SLEW_SLACK))

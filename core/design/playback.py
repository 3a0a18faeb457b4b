"""A track played back with the sensor in the device: target, estimate and measurement side by side, on one clock.

The sensor's recorder can record a pulse too. The pulse tells when the track began. The readings still lag
behind the track; this lag is the device's delay. Without a pulse the clocks are brought together by the readings
themselves, and nobody can tell a delay from an offset of the clocks.

Source: [S2] V.B (estimated against created, averaged over channels and time), [S0] 6.1 (relative RMS, three components)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..devices.coupling import coupling_of
from ..errors import DermisError, Finding
from ..interpolate import interpolate
from ..matching.lookup import readings_for
from ..matching.table import SkinTable, belongs
from ..track.command_track import CommandTrack
from .recorded_table import rest_finding
from .recordings import Recording, same_channels

# Comparisons are drawn along this many principal components of the target; without a target, of the estimate.
# Source: [S0] 6.1
COMPONENTS = 3
LATEST = 0.5  # longest delay of the device that is searched for [s]; a slower platform does not follow its track
COARSE = 0.02  # step of the first search, over all lags [s]
FINE = 1e-3  # step near its best lag [s]
NEAR = 5e-3  # a parabola is fitted to lags within this distance of the best [s]
ALIKE = 0.5  # least correlation of estimate and measurement; below it they belong to different touches
LEAST = 10  # least number of common samples


@dataclass(frozen=True, eq=False)
class Difference:
    """How far one series of readings is from another.

    Attributes:
        name: such as 'target, measured'.
        relative: root mean square of the difference, divided by that of the first series' distance from rest.
        mean, deviation: mean and standard deviation of the difference, by channel, in the readings' unit, shape
            (channels,).
        by_component: relative RMS, mean and deviation of the difference along each of `directions`, (components, 3).
    """

    name: str
    relative: float
    mean: Array
    deviation: Array
    by_component: Array

    @property
    def absolute(self) -> tuple[float, float]:
        """Mean over channels of the absolute mean difference, and its deviation. Source: [S2] V.B."""
        each = np.abs(self.mean)
        return float(each.mean()), float(each.std())


@dataclass(frozen=True, eq=False)
class Playback:
    """Result of a playback.

    Attributes:
        times: times of the track, at which all readings are compared [s], shape (n,).
        target: the readings that the track follows, shape (n, channels); None if they were not given.
        estimated: the table's readings for the commands, shape (n, channels).
        measured: the sensor's readings, shape (n, channels).
        channels: names of the channels.
        rest: the table's readings at rest, shape (channels,).
        directions: the components in which readings are drawn, shape (channels, components).
        delay: delay of the device after the track [s]; None if it was not measured.
        unsure: half the time between the last sample before the pulse's edge and the first after it [s].
        gain: gain of the measurement over the estimate.
        correlation: correlation of measurement and estimate.
        differences: difference between each pair of series.
        findings: reasons to doubt the comparison.
    """

    times: Array
    target: Array | None
    estimated: Array
    measured: Array
    channels: tuple[str, ...]
    rest: Array
    directions: Array
    delay: float | None
    unsure: float
    gain: float
    correlation: float
    differences: tuple[Difference, ...]
    findings: tuple[Finding, ...]

    def series(self) -> dict[str, Array]:
        """Return each series' difference from rest along `directions`, by the name of the series."""
        given = {"target": self.target, "estimated": self.estimated, "measured": self.measured}
        return {name: (own - self.rest) @ self.directions for name, own in given.items() if own is not None}


def playback(
    track: CommandTrack,
    table: SkinTable,
    recording: Recording,
    target: Recording | None = None,
    *,
    sync: tuple[Array, float] | None = None,
) -> Playback:
    """Compare target, estimate and the readings that a sensor took while a track was played.

    Args:
        table: look-up table of the device and the sensor.
        recording: the measured readings.
        target: the recording that the track follows.
        sync: the recorded pulse, shape (samples,), and the track's time at the pulse's first rising edge [s].

    Raises:
        DermisError: channels or motors that are not the table's, a pulse without an edge, readings that do not
            correlate with the track, a delay below 0 or above `LATEST`, or a target that ends before the track.
    """
    same_channels(recording, table)
    findings = [*_belonging(table, track), *rest_finding(table)]
    rest = table.exact_readings[table.rest]
    times = track.times - track.times[0]
    estimated = readings_for(table, _commands(track))
    measured = recording.tared(rest)
    clock, unsure = recording.times - recording.times[0], 0.0
    if sync is not None:
        edge, unsure = rising_edge(clock, sync[0])
        clock = clock - edge + sync[1]
        span = (-COARSE, LATEST)
    else:
        span = (-float(times[-1]), float(clock[-1]))
    shift, correlation = _shift(times, estimated, clock, measured, span)
    if correlation < ALIKE:
        raise DermisError(
            "the recording does not match this track at any delay that was tried",
            where=f"recording '{recording.name}'",
            value=f"correlation {correlation:.2f}",
            limit=f">= {ALIKE:g}",
            remedy="Give the recording that was made while this track was played, and the table of this sensor",
        )
    if sync is not None and not -COARSE < shift < LATEST:  # the best is at an end of the searched range
        raise DermisError(
            "pulse and readings do not belong together: no device is ahead of its track"
            if shift < 0.0
            else "pulse and readings do not belong together: no device is so late",
            where=f"recording '{recording.name}', sync pulse",
            value="negative" if shift < 0.0 else f"{1e3 * LATEST:g} ms or more",
            limit=f"0 to {1e3 * LATEST:.0f} ms",
            remedy="Give the pulse's time on the track with --sync-at, or leave the pulse out",
        )
    common = (times + shift >= clock[0]) & (times + shift <= clock[-1])
    share = float(common.mean())
    if share < 0.99:
        what = "the recording does not hold the whole track: only the recorded part is compared"
        findings.append(
            Finding("warning", "partly-recorded", what, f"recording '{recording.name}'", f"{100 * share:.0f} %")
        )
    at = times[common]
    estimated, own = estimated[common], interpolate(clock, measured, at + shift)
    wanted = None
    if target is not None:
        same_channels(target, table)
        findings += _lasting(target, times, track.spec.rate)
        wanted = interpolate(target.times - target.times[0], target.tared(rest), at)
    directions = _directions((estimated if wanted is None else wanted) - rest)
    gain = _gain(estimated, own)
    pairs = [] if wanted is None else [("target, estimated", wanted, estimated), ("target, measured", wanted, own)]
    pairs.append(("estimated, measured", estimated, own))
    return Playback(
        at,
        wanted,
        estimated,
        own,
        recording.channels,
        rest,
        directions,
        shift if sync is not None else None,
        unsure,
        gain,
        correlation,
        tuple(_difference(name, a, b, rest, directions) for name, a, b in pairs),
        tuple(findings),
    )


def rising_edge(times: Array, pulse: Array) -> tuple[float, float]:
    """Return when a pulse first rises through the middle of its range, and the uncertainty of this time [s].

    The uncertainty is half the time between the last sample before the rise and the first sample after it.


    Raises:
        DermisError: the pulse never rises, or it is high from the first sample on.
    """
    middle = 0.5 * (float(pulse.min()) + float(pulse.max()))
    if pulse[0] >= middle > pulse.min():
        raise DermisError(
            "the sync pulse is high from the first sample on: when it rose was not recorded",
            where="sync pulse",
            value=float(pulse[0]),
            limit=f"< {middle:g} at first",
            remedy="Begin to record before the track is played",
        )
    rises = np.flatnonzero((pulse[:-1] < middle) & (pulse[1:] >= middle))
    if not len(rises):
        raise DermisError("the sync pulse never rises", where="sync pulse", value=f"{pulse.min():g} to {pulse.max():g}")
    i = int(rises[0])
    part = (middle - pulse[i]) / (pulse[i + 1] - pulse[i])
    step = float(times[i + 1] - times[i])
    return float(times[i] + part * step), 0.5 * step


def as_text(found: Playback) -> str:
    """Return the comparison as text."""
    delay = "not measured: there is no sync pulse, the clocks were brought together by the readings"
    if found.delay is not None:
        delay = f"{1e3 * found.delay:.1f} ms, the pulse's edge being known to {1e3 * found.unsure:.1f} ms"
    lines = [
        f"{len(found.times)} samples, {found.times[-1] - found.times[0]:.2f} s; delay {delay}",
        f"gain of the measurement over the estimate {found.gain:.3f}, correlation {found.correlation:.3f}",
        "",
        "                       relative RMS [%]   |mean difference|, over channels",
    ]
    for each in found.differences:
        mean, deviation = each.absolute
        lines.append(f"{each.name:22s} {100 * each.relative:16.1f}   {mean:.4g} +- {deviation:.4g}")
    lines += ["", "By principal component (relative RMS [%], mean, standard deviation):"]
    for each in found.differences:
        shown = "; ".join(f"{100 * r:.1f}, {m:.4g}, {d:.4g}" for r, m, d in each.by_component.tolist())
        lines.append(f"{each.name:22s} {shown}")
    return "\n".join([*lines, *map(str, found.findings)]) + "\n"


def as_csv(found: Playback) -> str:
    """Return each difference as CSV.

    The first row of a difference has the relative RMS over all channels. Then each channel has a row with its mean and
    standard deviation. Then each component has a row with relative RMS, mean and standard deviation.
    """
    lines = ["difference,of,relative_rms,mean,standard_deviation"]
    for each in found.differences:
        name = each.name.replace(", ", " - ")
        lines.append(f"{name},all,{each.relative:.9g},,")
        rows = zip(found.channels, each.mean.tolist(), each.deviation.tolist(), strict=True)
        lines += [f"{name},{channel},,{mean:.9g},{deviation:.9g}" for channel, mean, deviation in rows]
        lines += [
            f"{name},component {k + 1},{relative:.9g},{mean:.9g},{deviation:.9g}"
            for k, (relative, mean, deviation) in enumerate(each.by_component.tolist())
        ]
    return "\n".join(lines) + "\n"


def _commands(track: CommandTrack) -> Array:
    """Return the track in the table's commands.

    For coupled motors these are the commands of the original motors; for a thimble, pitch, roll and distance.
    """
    if track.spec.kind == "thimble":
        return np.column_stack([track.column(name) for name in ("pitch", "roll", "distance")])
    coupling = coupling_of(track.spec)
    return track.values if coupling is None else coupling.original(track.values)


def _belonging(table: SkinTable, track: CommandTrack) -> Sequence[Finding]:
    return () if track.spec.kind == "thimble" else belongs(table, track.spec)


def _lasting(target: Recording, times: Array, rate: float) -> list[Finding]:
    """Refuse a target that ends before the track, and tell of one that goes on after it."""
    lasts, ends = float(target.times[-1] - target.times[0]), float(times[-1])
    where = f"recording '{target.name}'"
    if lasts < ends - 1.0 / rate:
        what = "the target ends before the track: the track follows another recording"
        raise DermisError(what, where=where, value=f"{lasts:.4g} s", limit=f">= {ends:.4g} s")
    if lasts <= ends + 2.0 / rate:
        return []
    what = "the target goes on after the track: only the track's time is compared"
    return [Finding("warning", "target-longer", what, where, f"{lasts:.4g} s", f"{ends:.4g} s, of the track")]


def _shift(
    times: Array, estimated: Array, clock: Array, measured: Array, span: tuple[float, float]
) -> tuple[float, float]:
    """Return the delay of the measurement after the estimate [s], and their correlation at this delay."""
    axes = _directions(estimated - estimated.mean(axis=0))
    few = times[:: max(int(COARSE * (len(times) - 1) / max(float(times[-1]), 1e-9)), 1)]
    coarse, read = interpolate(times, estimated @ axes, few), measured @ axes
    lags = np.arange(span[0], span[1] + COARSE, COARSE)
    scores = [_score(few, coarse, clock, read, float(lag))[0] for lag in lags]
    best = float(lags[int(np.argmax(scores))])
    for reach, step in ((COARSE, FINE), (NEAR, FINE)):
        lags = best + np.arange(-reach, reach + 0.5 * step, step)
        scores = [_score(times, estimated, clock, measured, float(lag))[0] for lag in lags]
        best = float(lags[int(np.argmax(scores))])
    # Noise and interpolation make the peak uneven; a parabola fitted to all scores near it has one top.
    bend, slope, _ = np.polyfit(lags - best, scores, 2)
    lag = best - 0.5 * slope / bend if bend < 0.0 and abs(slope) < 2.0 * NEAR * abs(bend) else best
    return lag, _score(times, estimated, clock, measured, lag)[1]


def _score(times: Array, one: Array, clock: Array, other: Array, lag: float) -> tuple[float, float]:
    """Return how well two series fit at a lag, and the correlation of their deviations from the mean.

    Both are taken in the time that the series have in common. The fit is the correlation times the share of the first
    series' movement that lies in this time: an overlap in which nothing moves says nothing.
    """
    common = (times + lag >= clock[0]) & (times + lag <= clock[-1])
    if common.sum() < max(LEAST, 0.1 * min(len(times), len(clock))):
        return 0.0, 0.0
    a = one[common] - one[common].mean(axis=0)
    b = interpolate(clock, other, times[common] + lag)
    b = b - b.mean(axis=0)
    scale = float(np.sqrt((a**2).sum() * (b**2).sum()))
    if scale <= 0.0:
        return 0.0, 0.0
    shared = float((a**2).sum() / ((one - one.mean(axis=0)) ** 2).sum())
    correlation = float((a * b).sum()) / scale
    return correlation * min(shared, 1.0), correlation


def _gain(estimated: Array, measured: Array) -> float:
    a, b = estimated - estimated.mean(axis=0), measured - measured.mean(axis=0)
    return float((a * b).sum() / max((a * a).sum(), 1e-300))


def _directions(values: Array) -> Array:
    _, _, axes = np.linalg.svd(values - values.mean(axis=0), full_matrices=False)
    axes = axes[:COMPONENTS]
    return (axes * np.where(axes.sum(axis=1) < 0.0, -1.0, 1.0)[:, None]).T


def _difference(name: str, one: Array, other: Array, rest: Array, directions: Array) -> Difference:
    off = other - one
    size = float(np.sqrt(((one - rest) ** 2).sum(axis=1).mean()))
    along, own = off @ directions, (one - rest) @ directions
    sizes = np.maximum(np.sqrt((own**2).mean(axis=0)), 1e-300)
    rows = np.column_stack([np.sqrt((along**2).mean(axis=0)) / sizes, along.mean(axis=0), along.std(axis=0)])
    relative = float(np.sqrt((off**2).sum(axis=1).mean())) / max(size, 1e-300)
    return Difference(name, relative, off.mean(axis=0), off.std(axis=0), rows)

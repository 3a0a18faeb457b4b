"""Recordings from outside: channels of a sensor over time.

They are CSV with one line of names: a column 'time' [s] and one for each channel, any number of them, in any unit,
whole or fractional.

Source: [S2] III, whose sensor has 19 electrodes and DC pressure, 12 bits
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..column_names import columns_of
from ..errors import DermisError
from ..matching.table import SkinTable
from ..number_rows import Rows
from ..skin.sensor import noise_of
from .sensor_columns import check_channels, sensor_columns

# A change of unit: in as many channels, by more than this factor, alike in all but for this. Units differ by 1,000, or
# by the size of a converter's count; no touch multiplies three channels or more by one number within a sample.
MANY, FACTOR, ALIKE = 3, 8.0, 1.2
# Between noisy samples: readings and their steps alike, in so many samples before and after, by more than `LARGE` in
# each channel. A touch that sets in changes steps less than readings, since the sensor's noise stays.
BESIDE, LARGE, ABOUT = 10, 100.0, 4.0
GAP, MISSED = 0.2, 10.0  # [s], and in samples: a touch can begin and end in a longer gap, so no line bridges it


@dataclass(frozen=True, eq=False)
class Recording:
    """Sensor channels over time.

    Attributes:
        name: name of the file.
        times: time of each sample [s], rising, shape (n,).
        readings: readings in the sensor's own unit, shape (n, channels).
        channels: the readings' names, in their order.
        rest: the part in which nothing is touched, from and to [s], counted from the first sample; None where nobody
            says it.
        beside: columns that are no channels of the sensor, such as a sync pulse, by name, shape (n,) each.
    """

    name: str
    times: Array
    readings: Array
    channels: tuple[str, ...]
    rest: tuple[float, float] | None = None
    beside: Mapping[str, Array] = field(default_factory=dict)

    @property
    def noise(self) -> float:
        """Standard deviation of one channel's noise, in the readings' unit: at rest, else by second differences."""
        if self.rest is None:
            return noise_of(self.readings)
        return float(np.sqrt(self._resting().var(axis=0, ddof=1).mean()))

    def tared(self, rest: Array) -> Array:
        """Return the readings moved so that those at rest are, on average, those of a table's rest row, shape (c,).

        A sensor's rest drifts from day to day. If the rest is not given, the readings are not changed.
        """
        return self.readings if self.rest is None else self.readings + (rest - self._resting().mean(axis=0))

    def _resting(self) -> Array:
        assert self.rest is not None
        after = self.times - self.times[0]
        return self.readings[(after >= self.rest[0]) & (after <= self.rest[1])]


def read_recording(path: Path, rest: tuple[float, float] | None = None, beside: Sequence[str] = ()) -> Recording:
    """Read a recording of a sensor.

    Args:
        rest: the part in which nothing is touched, from and to [s], counted from the first sample.
        beside: names of columns that are no channels of the sensor.

    Raises:
        DermisError: no channels, one that is constant or saturated, rows of different lengths, a transposed file,
            a column without a name, values that are no numbers, times that do not rise, a gap, times whose unit nobody
            says and that can hardly be seconds, a unit that changes; a rest with fewer than two samples.
    """
    path = Path(path)
    rows = sensor_columns(path, 1, "a column 'time' and one a channel")
    names, where = rows.names, rows.where
    columns = columns_of(names, where)
    if columns[0].meaning != "time":
        raise DermisError("the first column must be the time", where=where, value=names[0], limit="time")
    for name in beside:
        if name not in names[1:]:
            raise DermisError("no such column", where=where, value=name, limit=", ".join(names[1:])[:200])
    own = [i for i, name in enumerate(names) if i and name not in beside]
    readings, channels = rows.values[:, own], tuple(names[i] for i in own)
    if len(readings) < 2 or not channels:
        raise DermisError("too few samples", where=where, value=readings.shape, limit=">= 2 samples of >= 1 channel")
    times = rows.seconds(0, columns[0].unit)
    check_channels(readings, channels, where)
    _gaps(times, rows)
    _units(readings, rows)
    made = Recording(path.stem, times, readings, channels, rest, {n: rows.values[:, names.index(n)] for n in beside})
    if rest is not None and (len(made._resting()) < 2 or rest[1] > times[-1] - times[0] + GAP):
        raise DermisError(
            "too few samples at rest" if len(made._resting()) < 2 else "the rest goes on after the recording",
            where=where,
            value=f"{rest[0]:g} to {rest[1]:g} s: {len(made._resting())}",
            limit=f">= 2, within 0 to {times[-1] - times[0]:g} s",
        )
    return made


def same_channels(recording: Recording, table: SkinTable) -> None:
    """Refuse a recording whose channels are not a table's: their number, and a recorded table's names and order.

    Raises:
        DermisError: another number, another name, or another order.
    """
    channels = table.readings.shape[1]
    if len(recording.channels) != channels:
        raise DermisError(
            "the recording has another number of channels than the table",
            where=f"recording '{recording.name}'",
            value=len(recording.channels),
            limit=f"{channels}, as in {table.meta.get('source', 'the table')}",
            remedy="Use a table that was recorded with the same sensor",
        )
    known = table.meta.get("channels")
    if known is None or tuple(known) == recording.channels:
        return
    i = next(i for i, (own, other) in enumerate(zip(recording.channels, known, strict=True)) if own != other)
    what = (
        "the channels stand in another order than in the table"
        if set(known) == set(recording.channels)
        else ("a channel is not one of the table's")
    )
    raise DermisError(
        what,
        where=f"recording '{recording.name}', channel {i + 1}",
        value=recording.channels[i],
        limit=f"'{known[i]}', as in {table.meta.get('source', 'the table')}",
    )


def _gaps(times: Array, rows: Rows) -> None:
    """Refuse a recording in which samples are missing for long."""
    steps = np.diff(times)
    usual = float(np.median(steps))
    short = np.flatnonzero(steps < usual / MISSED)
    if usual > GAP and len(short) >= MANY:
        row = int(short[0]) + 1
        raise DermisError(
            "the time between samples changes: the unit of the times may",
            where=rows.place(row, 0),
            value=f"{steps[row - 1]:.4g} s; most samples are {usual:.4g} s apart",
            limit=f">= {usual / MISSED:.4g} s",
            remedy="Write all times in one unit, or cut the recording where its rate changes",
        )
    wide = np.flatnonzero(steps > max(GAP, MISSED * usual))
    if len(wide):
        row = int(wide[0]) + 1
        raise DermisError(
            "samples are missing",
            where=rows.place(row, 0),
            value=f"{steps[row - 1]:.4g} s without one",
            limit=f"{max(GAP, MISSED * usual):.4g} s; samples are {usual:.4g} s apart",
            remedy="Cut the recording there, and give the parts as files of their own",
        )


def _units(readings: Array, rows: Rows) -> None:
    """Refuse a recording in which all channels are multiplied by one factor at once: its unit changes there."""
    if readings.shape[1] < MANY:
        return
    before, after = readings[:-1], readings[1:]
    known = ((before > 0.0) & (after > 0.0)).all(axis=1) | ((before < 0.0) & (after < 0.0)).all(axis=1)
    ratio = np.log(after[known] / before[known])
    same = (np.ptp(ratio, axis=1) < np.log(ALIKE)) & (np.abs(ratio.mean(axis=1)) > np.log(FACTOR))
    found = [(int(np.flatnonzero(known)[at]) + 1, float(ratio[at].mean())) for at in np.flatnonzero(same)[:1]]
    found += _noisy_change(readings)
    if found:
        row, change = min(found)
        raise DermisError(
            "the unit of the readings changes",
            where=f"{rows.where}, line {rows.lines[row]}, all channels",
            value=f"{np.exp(change):.4g} times the rows before",
            limit=f"less than {FACTOR:g} times in all channels alike",
            remedy="Convert the whole recording to one unit",
        )


def _noisy_change(readings: Array) -> list[tuple[int, float]]:
    """Return the first row from which on all channels and their steps are multiplied, and the logarithm of by what."""
    size, most = np.abs(readings), 0.5 * readings.shape[1]
    up, down = ((FACTOR * a < b).sum(axis=1) > most for a, b in ((size[:-1], size[1:]), (size[1:], size[:-1])))
    for row in (np.flatnonzero(up | down) + 1).tolist():
        parts = readings[max(row - BESIDE, 0) : row], readings[row : row + BESIDE]
        if min(map(len, parts)) < MANY:
            continue
        before, after = (
            np.concatenate([np.median(np.abs(own), axis=0) for own in (part, np.diff(part, axis=0))]) for part in parts
        )
        seen = np.minimum(before, after) > 0.0
        if seen.sum() < max(2 * MANY, 2 * most):
            continue
        change = np.log(after[seen] / before[seen])
        middle = float(np.median(change))
        if abs(middle) > np.log(LARGE) and np.abs(change - middle).max() < np.log(ABOUT):
            return [(row, middle)]
    return []

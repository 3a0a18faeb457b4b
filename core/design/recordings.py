"""Imported recordings: channels of a sensor over time.

A recording is a CSV file with one line of names. Its columns are 'time' [s] and any number of channels, in any unit,
as whole or fractional numbers.

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

# A change of unit multiplies all channels, at least MANY, by more than FACTOR (or by less than 1 / FACTOR) between two
# samples, and the factors of the channels differ by less than ALIKE times. Units differ by 1,000, or by the size of a
# converter's count. No touch multiplies three channels or more by one number within a sample.
MANY, FACTOR, ALIKE = 3, 8.0, 1.2
# In noisy recordings a change of unit shows in medians over BESIDE samples before and after it. The median size of the
# readings and that of their steps change by more than LARGE times, alike in all channels but for less than ABOUT times.
# At the beginning of a touch the steps change less than the readings, because the sensor's noise stays the same.
BESIDE, LARGE, ABOUT = 10, 100.0, 4.0
# GAP [s] and MISSED [median intervals]: a gap longer than both is refused, because a touch can begin and end in it.
GAP, MISSED = 0.2, 10.0


@dataclass(frozen=True, eq=False)
class Recording:
    """Sensor channels over time.

    Attributes:
        name: name of the file.
        times: time of each sample [s], rising, shape (n,).
        readings: readings in the sensor's own unit, shape (n, channels).
        channels: names of the readings, in their order.
        rest: start and end of the interval in which nothing is touched [s], from the first sample; None if unknown.
        beside: values of columns that are not channels of the sensor, such as a sync pulse, by name, shape (n,) each.
    """

    name: str
    times: Array
    readings: Array
    channels: tuple[str, ...]
    rest: tuple[float, float] | None = None
    beside: Mapping[str, Array] = field(default_factory=dict)

    @property
    def noise(self) -> float:
        """Standard deviation of one channel's noise, in the readings' unit.

        It is computed from the samples at rest, or from second differences if the rest is unknown.
        """
        if self.rest is None:
            return noise_of(self.readings)
        return float(np.sqrt(self._resting().var(axis=0, ddof=1).mean()))

    def tared(self, rest: Array) -> Array:
        """Return the readings, shifted to the rest row of a table.

        After the shift the mean of the readings at rest is the rest row. The shift compensates for the sensor's
        drift from day to day. If the interval of rest is unknown, the readings are returned unchanged.

        Args:
            rest: readings of the table's rest row, shape (channels,).
        """
        return self.readings if self.rest is None else self.readings + (rest - self._resting().mean(axis=0))

    def _resting(self) -> Array:
        assert self.rest is not None
        after = self.times - self.times[0]
        return self.readings[(after >= self.rest[0]) & (after <= self.rest[1])]


def read_recording(path: Path, rest: tuple[float, float] | None = None, beside: Sequence[str] = ()) -> Recording:
    """Read a recording of a sensor.

    Args:
        path: the CSV file.
        rest: start and end of the interval in which nothing is touched [s], from the first sample; None if unknown.
        beside: names of columns that are not channels of the sensor.

    Raises:
        DermisError: the file has no channels, a constant or saturated channel, rows of different lengths, a column
            without a name, values that are not numbers, or times that do not rise; it is transposed, has a gap, or its
            unit changes; the times have no unit and can hardly be seconds; or `rest` has fewer than two samples or goes
            on after the recording.
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
            "too few samples at rest" if len(made._resting()) < 2 else "the rest lasts longer than the recording",
            where=where,
            value=f"{rest[0]:g} to {rest[1]:g} s: {len(made._resting())}",
            limit=f">= 2, within 0 to {times[-1] - times[0]:g} s",
        )
    return made


def same_channels(recording: Recording, table: SkinTable) -> None:
    """Check that the channels of a recording are those of a table.

    Raises:
        DermisError: the number of channels differs or, for a recorded table, their names or their order.
    """
    channels = table.readings.shape[1]
    if len(recording.channels) != channels:
        raise DermisError(
            "recording and table have different numbers of channels",
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
    """Refuse a recording with a long gap, or with times whose unit changes."""
    steps = np.diff(times)
    usual = float(np.median(steps))
    short = np.flatnonzero(steps < usual / MISSED)
    if usual > GAP and len(short) >= MANY:
        row = int(short[0]) + 1
        raise DermisError(
            "the time between samples changes; perhaps the unit of the times changes",
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
    """Refuse a recording whose unit changes.

    A change of unit multiplies all channels by one factor at once.
    """
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
    """Find the first change of unit in noisy readings.

    Returns:
        The first row in the new unit, and the logarithm of the factor; empty if there is none.
    """
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

"""Recordings from outside: sensor channels over time, and tables of motor commands with what was sensed.

Both are CSV with one line of names. A recording has a column 'time' [s] and one for each channel: any number of them,
in any unit, whole or fractional; a table has a column for each motor, in SI, and the same channels.

Source: [S2] III, whose sensor has 19 electrodes and DC pressure, 12 bits
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..column_names import columns_of, length_or_angle
from ..errors import DermisError
from ..matching.nearest import NEIGHBOURS
from ..matching.readings import SATURATED, at_the_end
from ..matching.table import SkinTable
from ..number_rows import Rows, lines_of, number

SLACK = 0.01  # of a motor's range, that a recorded command may lie beyond its ends
LONGEST = 4_000_000  # lines; a whole day at 100 Hz is about twice that, and no interaction


@dataclass(frozen=True, eq=False)
class Recording:
    """Sensor channels over time.

    Attributes:
        name: of the file. times: [s], rising, shape (n,). readings: in the sensor's own unit, shape (n, channels).
        channels: the readings' names, in their order.
    """

    name: str
    times: Array
    readings: Array
    channels: tuple[str, ...]


def read_recording(path: Path) -> Recording:
    """Read a recording of a sensor.

    Raises:
        DermisError: no channels, one that is constant or saturated, rows of different lengths, a transposed file,
            trailing separators, values that are no numbers, times that do not rise, or whose unit nobody says and that
            can hardly be seconds.
    """
    path = Path(path)
    rows = _columns(path, 1, "a column 'time' and one a channel")
    names, where = rows.names, rows.where
    columns = columns_of(names, where)
    if columns[0].meaning != "time":
        raise DermisError("the first column must be the time", where=where, value=names[0], limit="time")
    readings = rows.values[:, 1:]
    if len(readings) < 2:
        raise DermisError("too few samples", where=where, value=len(readings), limit=">= 2")
    times = rows.seconds(0, columns[0].unit)
    _channels(readings, names[1:], where)
    return Recording(path.stem, times, readings, tuple(names[1:]))


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


def read_table(path: Path, scale: Array, ends: Array | None = None) -> SkinTable:
    """Read a table of motor commands with sensor readings; its rest row is the one that reads most others alike.

    The rest row of an outside table is not marked. It is the row whose reading occurs most often, or, where all differ,
    the one with the least pressure; other rows with that reading are dropped.

    Args:
        scale: range of each motor, SI, shape (motors,). ends: least and greatest command, shape (2, motors).

    Raises:
        DermisError: as in `read_recording`, fewer rows than neighbours, or commands that the motors cannot do.
    """
    path = Path(path)
    motors = len(scale)
    rows = _columns(path, motors, f"{motors} motors and one a channel")
    names, where = rows.names, rows.where
    units = [length_or_angle(name) for name in names[:motors]]
    commands, readings = rows.values[:, :motors] * units, rows.values[:, motors:]
    if len(commands) < NEIGHBOURS:
        raise DermisError(
            "too few rows",
            where=where,
            value=len(commands),
            limit=f">= {NEIGHBOURS}",
            remedy="Record more configurations of the device",
        )
    _channels(readings, names[motors:], where)
    if ends is not None:
        outside = np.argwhere((commands < ends[0] - SLACK * scale) | (commands > ends[1] + SLACK * scale))
        if len(outside):
            i, j = outside[0]
            raise DermisError(
                "a command is beyond the motor's range",
                where=f"{where}, line {rows.lines[i]}, {names[j]}",
                value=float(commands[i, j]),
                limit=f"{ends[0, j]:.4g} to {ends[1, j]:.4g}, in SI",
                remedy="Write rad and m, or the unit into the column's name, or mend the preset's range",
            )
    still = np.flatnonzero(np.ptp(commands, axis=0) == 0.0)
    if len(still):
        raise DermisError("a motor never moves", where=where, value=names[int(still[0])])
    _, first, inverse, count = np.unique(readings, axis=0, return_index=True, return_inverse=True, return_counts=True)
    group = int(count.argmax()) if count.max() > 1 else int(inverse.ravel()[readings[:, -1].argmin()])
    rest = int(first[group])
    keep = inverse.ravel() != group
    keep[rest] = True
    meta = {
        "source": path.name,
        "asked": len(commands),
        "rest_rows": int((~keep).sum()) + 1,
        "channels": list(names[motors:]),
    }
    return SkinTable(commands[keep], _smallest(readings[keep]), int(keep[:rest].sum()), scale, 0.0, meta)


def _columns(path: Path, leading: int, wanted: str) -> Rows:
    """Read names and numbers; say what is wrong with the shape of the file, not only that it is wrong."""
    where = str(path)
    lines, separator, _ = lines_of(path)
    if len(lines) < 2:
        raise DermisError("no data", where=where, value=f"{len(lines)} lines", limit="a line of names, and values")
    if len(lines) > LONGEST:
        raise DermisError("too long", where=where, value=len(lines), limit=f"{LONGEST} lines")
    names = lines[0].cells
    columns = len(names)
    if names[-1] == "":
        raise DermisError(
            "lines end with a separator",
            where=where,
            value=", ".join(names)[-12:],
            remedy="Remove it: it stands for an empty channel",
        )
    numbers = [number(name, separator) is not None for name in names]
    if columns > 1 and not numbers[0] and all(numbers[1:]):
        raise DermisError(
            "the file is transposed",
            where=where,
            value=f"{len(lines)} lines of {columns} values",
            limit=wanted,
            remedy="Write one line for each sample, one column for each channel",
        )
    if columns <= leading:
        raise DermisError("channels are missing", where=where, value=f"{columns} columns", limit=wanted)
    if numbers[0]:
        raise DermisError("the line of names is missing", where=where, value=names[0], limit=wanted)
    if len(set(names)) != len(names):
        seen: set[str] = set()
        twice = next(name for name in names if name in seen or seen.add(name))  # type: ignore[func-returns-value]
        raise DermisError("two columns have one name", where=where, value=twice)
    values = np.empty((len(lines) - 1, columns))
    for i, line in enumerate(lines[1:]):
        place = f"{where}, line {line.number}"
        read = line.numbers()
        if len(read) != columns:
            if len(read) == columns + 1 and line.cells[-1] == "":
                raise DermisError("the line ends with a separator", where=place, remedy="Remove it")
            raise DermisError(
                "the line has another length", where=place, value=f"{len(read)} values", limit=str(columns)
            )
        if None in read:
            bad = read.index(None)
            raise DermisError("not a number", where=f"{place}, {names[bad]}", value=line.cells[bad])
        values[i] = read
    rows = Rows(where, names, values, tuple(line.number for line in lines[1:]))
    wrong = np.argwhere(~np.isfinite(values))
    if len(wrong):
        i, j = wrong[0]
        raise DermisError(
            "a value is not finite",
            where=f"{where}, line {rows.lines[i]}, {names[j]}",
            value=str(values[i, j]),
            remedy="Leave the sample out, or repair it",
        )
    return rows


def _channels(readings: Array, names: Sequence[str], where: str) -> None:
    """Refuse channels that are dead or saturated."""
    for name, series, full in zip(names, readings.T, at_the_end(readings).tolist(), strict=True):
        if full > SATURATED:
            raise DermisError(
                "the channel is saturated",
                where=f"{where}, {name}",
                value=f"{100 * full:.0f} % of the time",
                limit=f"{100 * SATURATED:.0f} %",
                remedy="Touch less deeply, or leave the part out",
            )
        if np.ptp(series) == 0.0:
            raise DermisError(
                "the channel is constant",
                where=f"{where}, {name}",
                value=float(series[0]),
                remedy="Look at the sensor: an electrode that reads one value is dead; or leave the column out",
            )


def _smallest(readings: Array) -> NDArray[Any]:
    """Return whole counts in 16 bits, which tables are fast and small with, and all else as it is."""
    whole = readings.astype(np.uint16) if 0.0 <= readings.min() and readings.max() < 2**16 else readings
    return whole if np.array_equal(whole, readings) else readings

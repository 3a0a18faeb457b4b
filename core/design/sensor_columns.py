"""Reading and checking of imported files with a sensor's readings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from ..matching.readings import SATURATED, at_the_end
from ..number_rows import Rows, lines_of, number, numbers_of

LONGEST = 4_000_000  # largest number of lines of a file: half a day at 100 Hz, longer than any interaction


def sensor_columns(path: Path, leading: int, wanted: str) -> Rows:
    """Read the names and the numbers of a file.

    Args:
        path: the file.
        leading: number of columns before those of the sensor.
        wanted: description of the expected columns, for errors.

    Raises:
        DermisError: the file has no data, too many lines, too few columns or no line of names; it is transposed; two
            columns have the same name or one has none; lines differ in length; or a value is not a finite number.
    """
    where = str(path)
    lines, separator, _ = lines_of(path)
    if len(lines) < 2:
        raise DermisError("no data", where=where, value=f"{len(lines)} lines", limit="a line of names, and values")
    if len(lines) > LONGEST:
        raise DermisError("too long", where=where, value=len(lines), limit=f"{LONGEST} lines")
    names = lines[0].cells
    columns = len(names)
    if "" in names:
        raise DermisError("a column has no name", where=where, value=f"column {names.index('') + 1}", limit=wanted)
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
    whole = numbers_of(lines[1:], columns)
    values = np.empty((len(lines) - 1, columns)) if whole is None else whole
    for i, line in enumerate(lines[1:] if whole is None else ()):
        place = f"{where}, line {line.number}"
        read = line.numbers()
        if len(read) != columns:
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


def check_channels(readings: Array, names: Sequence[str], where: str) -> None:
    """Refuse constant and saturated channels.

    Raises:
        DermisError: a channel is constant, or at an end of its scale for long.
    """
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

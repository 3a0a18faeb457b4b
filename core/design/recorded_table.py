"""Imported tables: motor commands with a sensor's readings at each.

Commands are in SI units, or in the unit that a column's name gives.

Source: [S2] III
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..column_names import length_or_angle
from ..errors import DermisError, Finding
from ..matching.nearest import NEIGHBOURS
from ..matching.table import SkinTable
from ..number_rows import Rows
from .sensor_columns import check_channels, sensor_columns

# A change of unit multiplies the readings of all channels by more than this factor. Units differ by 1,000, or by the
# size of a converter's count; two parts of a table in one unit do not differ by this factor in every channel.
FACTOR = 8.0
SLACK = 0.01  # share of a motor's range by which a recorded command may lie outside the range


def read_table(
    path: Path, scale: Array, ends: Array | None = None, at_rest: Array | None = None, rest_rows: Sequence[int] = ()
) -> SkinTable:
    """Read a table of commands with readings, and find its rest row.

    If `rest_rows` are given, the rest row is the one among them whose readings are nearest to their mean. Otherwise it
    is the row whose command is nearest to the device at rest. The other rows given, and all rows with the same readings
    as the rest row, are dropped. The result does not depend on the order or on the unit of the channels.

    Args:
        path: the CSV file.
        scale: range of each motor in SI units, shape (motors,).
        ends: least and greatest command of each motor, shape (2, motors); None to leave out the check.
        at_rest: command of the device at rest in SI units, shape (motors,); None for the least commands in the table.
        rest_rows: rows in which nothing is touched, counted from 1 below the line of names.

    Raises:
        DermisError: see `sensor_columns` and `check_channels`; also if the unit of a motor is neither a length nor an
            angle, there are too few rows, a command is out of range, a motor never moves, the unit of the readings
            changes, or a row of rest does not exist.
    """
    path = Path(path)
    motors = len(scale)
    rows = sensor_columns(path, motors, f"{motors} motors and one a channel")
    names, where = rows.names, rows.where
    units = [length_or_angle(name, where) for name in names[:motors]]
    commands, readings = rows.values[:, :motors] * units, rows.values[:, motors:]
    if len(commands) < NEIGHBOURS:
        raise DermisError(
            "too few rows",
            where=where,
            value=len(commands),
            limit=f">= {NEIGHBOURS}",
            remedy="Record more configurations of the device",
        )
    check_channels(readings, names[motors:], where)
    _units(readings, rows)
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
    given = np.array(sorted({int(row) for row in rest_rows}), np.intp) - 1
    if len(given) and not 0 <= given[0] <= given[-1] < len(commands):
        raise DermisError("no such row of rest", where=where, value=list(rest_rows), limit=f"1 to {len(commands)}")
    if len(given):
        own = readings[given]
        rest = int(given[((own - own.mean(axis=0)) ** 2).sum(axis=1).argmin()])
    else:
        home = commands.min(axis=0) if at_rest is None else np.asarray(at_rest, np.float64)
        rest = int((((commands - home) / scale) ** 2).sum(axis=1).argmin())
    same = (readings == readings[rest]).all(axis=1)
    same[given] = True
    keep = ~same
    keep[rest] = True
    meta = {
        "source": path.name,
        "asked": len(commands),
        "rest_rows": int(same.sum()),
        "rest_line": rows.lines[rest],
        "rest_said": bool(len(given)),
        "channels": list(names[motors:]),
    }
    return SkinTable(commands[keep], _smallest(readings[keep]), int(keep[:rest].sum()), scale, 0.0, meta)


def _units(readings: Array, rows: Rows) -> None:
    """Refuse a table whose unit changes.

    This is the case if, in every channel, all rows from one row on are larger, or smaller, than all rows before by more
    than `FACTOR`.
    """
    size = np.abs(readings)
    least, most = (np.minimum.accumulate, np.maximum.accumulate)
    for one, up in ((size, True), (size[::-1], False)):
        before, after = most(one, axis=0)[:-1], least(one[::-1], axis=0)[::-1][1:]
        apart = np.asarray((after > FACTOR * before).all(axis=1))
        apart[: NEIGHBOURS - 1], apart[-NEIGHBOURS + 1 :] = False, False
        if apart.any():
            at = int(apart.argmax())
            row = at + 1 if up else len(size) - 1 - at
            raise DermisError(
                "the unit of the readings changes",
                where=f"{rows.where}, line {rows.lines[row]}, all channels",
                value=f"{'above' if up else 'below'} {FACTOR if up else 1.0 / FACTOR:g} times all rows before",
                limit="one unit for all rows",
                remedy="Convert the whole table to one unit",
            )


def rest_finding(table: SkinTable) -> tuple[Finding, ...]:
    """Report the rest row of a recorded table if it was not stated."""
    if table.meta.get("rest_said", True):
        return ()
    return (
        Finding(
            "info",
            "rest-guessed",
            "the rows without touch are not stated: the row nearest to the device at rest is taken",
            str(table.meta["source"]),
            f"line {table.meta['rest_line']}",
            remedy="Name the untouched rows: --rest-rows on the command line",
        ),
    )


def _smallest(readings: Array) -> NDArray[Any]:
    """Return readings as 16-bit integers if possible, else unchanged.

    It is possible for whole counts from 0 to 65535. Tables of 16-bit integers are smaller and faster.
    """
    whole = readings.astype(np.uint16) if 0.0 <= readings.min() and readings.max() < 2**16 else readings
    return whole if np.array_equal(whole, readings) else readings

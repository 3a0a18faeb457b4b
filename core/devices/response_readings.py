"""Measured curve of an actuator from readings in order of time."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..column_names import ANGLES, LENGTHS, size_of_unit
from ..errors import DermisError
from ..number_rows import read_rows
from ..units import UNITS
from .response import Points, Response

# If both ways were measured: least number of readings after the play, in the pass of each way that has the most.
LEAST = 3
LEFT = 0.5  # [share of a pass's median slope] below this slope, the play is still being taken up


def of_readings(driven: ArrayLike, reached: ArrayLike, **more: Any) -> Response:
    """Return a measured curve from readings in order of time.

    The readings may go up and down any number of times. A pass counts if it covers more than half of the driven range.
    After a reversal an actuator holds still until its play is taken up, and readings there belong to no curve. So, if
    both ways were measured, the beginning of every pass is left out, at least its first reading, see `_moving`. The
    passes of one way are averaged. The scatter is the largest difference between readings of one way at one driven
    value.

    Args:
        driven, reached: commanded and reached values [unit of the channel], shape (n,) each.
        more: the other attributes of `Response`: latency, measured_on and valid_days.

    Raises:
        DermisError: there are too few readings, or they are no curve of an actuator.
    """
    table = np.array([driven, reached], np.float64).T
    if len(table) < 2:
        raise DermisError("too few readings", where="measured curve", value=len(table), limit=">= 2")
    if bad := np.flatnonzero(~np.isfinite(table).all(axis=1)).tolist():
        raise DermisError("a reading is not finite", where=f"measured curve, reading {bad[0] + 1}")
    passes = _passes(table)
    ways = {up for up, _ in passes}
    ends = float(np.ptp(table[:, 0]))
    whole = [
        (up, _moving(points) if len(ways) == 2 else points)
        for up, points in passes
        if np.ptp(points[:, 0]) > 0.5 * ends
    ]
    curves: dict[bool, Points] = {}
    apart = 0.0
    for way in ways:
        mine = [points for up, points in whole if up is way and len(points) > 1]
        if not mine or (len(ways) == 2 and max(map(len, mine)) < LEAST):
            raise DermisError(
                "too few readings from one end to the other",
                where=f"measured curve, {'way up' if way else 'way down'}",
                value=max(map(len, mine), default=0),
                limit=f">= {LEAST} that are on the curve",
                remedy="Take five or more in each direction: after a reversal the actuator moves only "
                "when its play is taken up",
            )
        curves[way], scatter = _averaged(mine)
        apart = max(apart, scatter)
    rising = curves.get(True) or curves[False]
    return Response(rising, curves.get(False) or rising, scatter=apart, **more)


def read_csv(path: Path, unit: str = "", **more: Any) -> Response:
    """Read a measured curve from the readings in a CSV file.

    The columns are 'driven' (or 'commanded') and 'reached' (or 'measured'). Rows are in the order in which they were
    taken. A name may have a unit, such as 'driven [deg]'; values without a unit are in SI.

    Args:
        path: path of the file.
        unit: SI unit of the channel, such as 'm' or 'rad'. A column may have this unit, and other units of length or
            angle for 'm' or 'rad'. '' accepts units of length and angle, and any SI unit.
        more: as in `of_readings`.

    Raises:
        DermisError: the file cannot be read or has no such columns, a column has another unit, or the readings are no
            curve of an actuator.
    """
    rows = read_rows(path)
    columns, allowed = {}, _allowed(unit)
    for names in (("driven", "commanded"), ("reached", "measured")):
        found = [k for k, name in enumerate(rows.names) if name.lower().lstrip("# ").startswith(names)]
        if len(found) != 1:
            raise DermisError(
                f"no column, or more than one, is called '{names[0]}'",
                where=str(path),
                value=", ".join(rows.names)[:80] or "no line of names",
                limit="driven, reached; with a unit: 'driven [deg]', 'reached [deg]'",
            )
        columns[names[0]] = rows.values[:, found[0]] * size_of_unit(rows.names[found[0]], allowed, str(path))
        if bad := np.flatnonzero(~np.isfinite(columns[names[0]])).tolist():
            raise DermisError("a reading is missing or not finite", where=rows.place(bad[0], found[0]))
    try:
        return of_readings(columns["driven"], columns["reached"], **more)
    except DermisError as error:
        raise error.changed(where=f"{path}: {error.where}") from error


def _allowed(unit: str) -> dict[str, float]:
    """Return the units that columns for a channel may have, with their sizes in SI."""
    if unit in ("m", "rad"):
        return LENGTHS if unit == "m" else ANGLES
    return {unit: 1.0} if unit else {**LENGTHS, **ANGLES, **{si: 1.0 for si, _ in UNITS.values()}}


def _passes(table: Array) -> list[tuple[bool, Array]]:
    """Split readings into passes, each in one direction.

    Args:
        table: driven and reached values, shape (n, 2).

    Returns:
        For each pass, whether it goes up, and its readings. The turning point between two passes belongs to both.
    """
    passes: list[tuple[bool, Array]] = []
    step = np.sign(np.diff(table[:, 0]))
    moves = np.flatnonzero(step)
    if not len(moves):
        raise DermisError("all readings are at one driven value", where="measured curve", value=float(table[0, 0]))
    start = 0
    for k, following in zip(moves, [*moves[1:], None], strict=True):
        if following is None or step[following] != step[k]:
            end = k + 1 if following is None else int(following)
            passes.append((bool(step[k] > 0), table[start : end + 1]))
            start = end
    return passes


def _moving(points: Array) -> Array:
    """Return a pass without its beginning, in which the play is taken up.

    The play has ended at the end of the first step whose slope is at least `LEFT` times the median slope.
    """
    slope = np.diff(points[:, 1]) / np.where(np.diff(points[:, 0]) == 0, np.nan, np.diff(points[:, 0]))
    usual = np.nanmedian(slope)
    moves = np.flatnonzero(slope >= LEFT * usual)
    return points[int(moves[0]) + 1 :] if len(moves) else points[:0]


def _averaged(passes: list[Array]) -> tuple[Points, float]:
    """Return the mean of passes at each driven value, rising, and the scatter."""
    at: dict[float, list[float]] = defaultdict(list)
    for points in passes:
        for driven, reached in points.tolist():
            at[driven].append(reached)
    curve = tuple((driven, float(np.mean(at[driven]))) for driven in sorted(at))
    return curve, max(max(values) - min(values) for values in at.values())

"""RecordedPoses: places over time from a text file, with or without how the thing was turned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import tau
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..column_names import Column, columns_of
from ..errors import DermisError
from ..number_rows import Rows, check_times, read_rows
from .rotation import matrices

PLACE = ("x", "y", "z")
QUATERNION, VECTOR, EULER = ("qw", "qx", "qy", "qz"), ("vx", "vy", "vz"), ("rx", "ry", "rz")
OFF_UNIT = 0.01  # of a quaternion's length: what rounding its four numbers to two decimals can take off or add
REACH = 3.0  # [m] that no hand moves, so that places which do are no metres
SLOW, MANY = 1.0, 60  # rows as far apart [s], so many of them: nobody records so, their times have another unit
TURNS = {
    "none": (),
    "wxyz": ("qw", "qx", "qy", "qz"),
    "xyzw": ("qx", "qy", "qz", "qw"),
    "euler_deg": ("rx_deg", "ry_deg", "rz_deg"),
    "euler_rad": ("rx_rad", "ry_rad", "rz_rad"),
    "vector_rad": ("rotvec_x_rad", "rotvec_y_rad", "rotvec_z_rad"),
    "vector_deg": ("rotvec_x_deg", "rotvec_y_deg", "rotvec_z_deg"),
}
"""How rows may tell a rotation, and the names of its columns."""
TIMES = {"none": (), "s": ("time_s",), "ms": ("time_ms",), "us": ("time_us",), "frame": ("frame",)}
"""How rows may tell their time."""
NOT_SAID = "columns-not-said"  # the code of a refusal that `columns` answers


@dataclass(frozen=True, eq=False)
class RecordedPoses:
    """Poses over time.

    Attributes:
        times: [s] from 0, rising, shape (n,). places: [m], shape (n, 3).
        turns: rotation matrices, shape (n, 3, 3); None where the file has none.
        unused: names of columns that are no part of it.
    """

    times: Array
    places: Array
    turns: Array | None
    unused: tuple[str, ...]


@dataclass(frozen=True)
class Guess:
    """What a file without names may hold: keys of `TIMES` and `TURNS`, and the unit of places."""

    time: str
    turn: str
    unit: str


def read(path: Path, *, columns: str = "", rate: float = 100.0, unit: float = 1.0) -> RecordedPoses:
    """Read recorded poses.

    The file's line of names says which column is what, and in which unit: 'time [ms]', 'x_mm', 'rx_deg', 'qw'. Times
    without a unit are seconds. Angles `rx, ry, rz` and `roll, pitch, yaw` are turns about the fixed X, then Y, then Z.

    Args:
        columns: names with commas between, for a file that has none, or instead of its own.
        rate: rows or frames a second, of a file that counts frames or has no times.
        unit: of places whose names have none [m].

    Raises:
        DermisError: the code is 'columns-not-said' where the file does not say what it holds; numbers that contradict
            the names: a quaternion far from unit length, times that do not rise or last longer than a day.
    """
    return of_rows(read_rows(path), columns=columns, rate=rate, unit=unit)


def of_rows(rows: Rows, *, columns: str = "", rate: float = 100.0, unit: float = 1.0) -> RecordedPoses:
    """Read poses from rows of numbers; see `read`."""
    known = _known(rows, columns)
    place = {column.meaning: index for index, column in enumerate(known) if column.meaning}
    if len(rows.values) < 2:
        raise DermisError("a single row is no motion", where=rows.where, value=len(rows.values), limit=">= 2 rows")
    turn = next((kind for kind in (QUATERNION, VECTOR, EULER) if all(name in place for name in kind)), ())
    used = [place[name] for name in (*PLACE, *turn)]
    _check_finite(rows, used)
    time = place.get("time", place.get("frame"))
    if time is None:
        times = np.arange(len(rows.values)) / rate
    else:
        used.append(time)
        factor = known[time].unit or 1.0
        times = rows.values[:, time] * (factor if "time" in place else 1.0 / rate)
        check_times(times, rows, time)
        if "time" in place and known[time].unit is None and not columns and _slow(times):
            raise _not_said("nobody says in which unit the times are, and as seconds they are slow", rows, "_ms")
    numbers = {name: rows.values[:, place[name]] for name in (*PLACE, *turn)}
    for name in numbers:
        own = known[place[name]].unit
        numbers[name] = numbers[name] * ((unit if name in PLACE else 1.0) if own is None else own)
    turns = None
    if turn:
        given = np.stack([numbers[name] for name in turn], axis=1)
        turns = matrices(_quaternions(given, turn, rows, place[turn[0]]))
    unused = tuple(column.name for index, column in enumerate(known) if index not in used)
    return RecordedPoses(times - times[0], np.stack([numbers[name] for name in PLACE], axis=1), turns, unused)


def guess(rows: Rows) -> Guess:
    """Return what rows without names most likely hold."""
    values, count = rows.values, rows.values.shape[1]
    rises = bool((np.diff(values[:, 0]) > 0.0).all())
    timed = count in (4, 8) or (count == 7 and rises and not _unit_length(values[:, 3:]))
    rest = values[:, 3 + timed :]
    turn = {3: "euler", 4: "wxyz"}.get(rest.shape[1], "none")
    if turn == "euler":
        turn += _angle_unit(rest)
    moved = np.nanmax(np.ptp(values[:, timed : timed + 3], axis=0), initial=0.0)
    time = ("ms" if _slow(values[:, 0]) else "s") if timed else "none"
    return Guess(time, turn, "mm" if moved > REACH else "m")


def suggestion(rows: Rows, time_unit: str = "") -> str:
    """Return the names of columns that most likely answer for what a file does not say; '' where nothing fits.

    Args:
        time_unit: behind the name of the times, where these have none.

    Raises:
        DermisError: see `column_names.columns_of`.
    """
    known = rows.columns()
    if not set(PLACE) <= {column.meaning for column in known}:
        found = guess(rows)
        usual = names_of(found.time, found.turn, found.unit)
        return usual if usual.count(",") + 1 == rows.values.shape[1] else ""
    unit = _angle_unit(rows.values[:, [i for i, column in enumerate(known) if column.meaning in EULER]])
    missing = {**dict.fromkeys(EULER, unit), "time": time_unit}
    named = [c.meaning + missing[c.meaning] if c.unit is None and c.meaning in missing else c.name for c in known]
    return ", ".join(name if column.meaning else "-" for name, column in zip(named, known, strict=True))


def names_of(time: str, turn: str, unit: str = "m") -> str:
    """Return the names of columns in the usual order: the time, the place, the rotation.

    Args:
        time, turn: keys of `TIMES` and `TURNS`. unit: of the places.
    """
    return ", ".join((*TIMES[time], *(f"{axis}_{unit}" for axis in PLACE), *TURNS[turn]))


def _slow(times: Array) -> bool:
    """Return whether times are too far apart to be seconds."""
    return bool(len(times) >= MANY and np.ptp(times) >= SLOW * (len(times) - 1))


def _angle_unit(angles: Array) -> str:
    """Return '_deg' where angles go beyond a whole turn in radians, else '_rad'."""
    return "_deg" if np.nanmax(np.abs(angles), initial=0.0) > tau else "_rad"


def _known(rows: Rows, columns: str) -> tuple[Column, ...]:
    """Return what each column is.

    Raises:
        DermisError: nobody says so, or what is said is not enough.
    """
    if columns.strip():
        names = [name.strip() for name in columns.split(",")]
        if len(names) != rows.values.shape[1]:
            raise DermisError(
                "another number of columns is named than the file has",
                where=rows.where,
                value=len(names),
                limit=f"{rows.values.shape[1]}",
            )
        known = columns_of(names, rows.where)
        unknown = [name for name, column in zip(names, known, strict=True) if not column.meaning and name != "-"]
        if unknown:
            raise DermisError(
                "a column is named by something that is not known",
                where=rows.where,
                value=unknown[0],
                limit="time, frame, x, y, z, qw, qx, qy, qz, rx, ry, rz, rotvec_x, ... with a unit; '-' for no use",
            )
    elif rows.names:
        known = rows.columns()
    else:
        raise _not_said("the file does not say what its columns are", rows)
    meanings = {column.meaning for column in known}
    if not set(PLACE) <= meanings:
        raise _not_said("the names of the columns do not say where x, y and z are", rows)
    for kind in (QUATERNION, VECTOR, EULER):
        part = [name for name in kind if name in meanings]
        if part and len(part) < len(kind):
            missing = ", ".join(name for name in kind if name not in meanings)
            raise _not_said(f"a part of the rotation is missing: {missing}", rows)
    if not set(QUATERNION) & meanings and not set(VECTOR) & meanings:
        angles = [column for column in known if column.meaning in EULER]
        if any(column.unit is None for column in angles):
            raise _not_said("nobody says whether the angles are degrees or radians", rows)
    return known


def _not_said(what: str, rows: Rows, time_unit: str = "") -> DermisError:
    suggested = suggestion(rows, time_unit)
    said = f"columns='{suggested}'" if suggested else "columns='time_s, x_mm, y_mm, z_mm, qw, qx, qy, qz' or similar"
    return DermisError(
        what,
        where=rows.where,
        value=", ".join(rows.names)[:80] or f"{rows.values.shape[1]} columns without names",
        limit="columns x, y, z; before, behind or between them a time and a rotation",
        remedy=f"Say it, such as {said}, or write a line of names into the file",
        code=NOT_SAID,
    )


def _check_finite(rows: Rows, used: Sequence[int]) -> None:
    bad = np.argwhere(~np.isfinite(rows.values[:, used]))
    if len(bad):
        row, index = bad[0]
        raise DermisError("a value is missing or no number", where=rows.place(int(row), used[index]))


def _unit_length(values: Array) -> bool:
    return bool((np.abs(np.linalg.norm(values, axis=1) - 1.0) <= OFF_UNIT).all())


def _quaternions(given: Array, turn: Sequence[str], rows: Rows, column: int) -> Array:
    """Return quaternions w, x, y, z of a rotation as rows have it, shape (n, 4)."""
    if turn == VECTOR:
        angle = np.linalg.norm(given, axis=1)
        return np.column_stack([np.cos(0.5 * angle), given * (0.5 * np.sinc(angle / tau))[:, None]])
    if turn == EULER:
        cosines, sines = np.cos(0.5 * given).T, np.sin(0.5 * given).T
        (cx, cy, cz), (sx, sy, sz) = cosines, sines
        return np.column_stack(
            [
                cx * cy * cz + sx * sy * sz,
                sx * cy * cz - cx * sy * sz,
                cx * sy * cz + sx * cy * sz,
                cx * cy * sz - sx * sy * cz,
            ]
        )
    length = np.linalg.norm(given, axis=1)
    off = np.flatnonzero(np.abs(length - 1.0) > OFF_UNIT)
    if len(off):
        row = int(off[0])
        raise DermisError(
            "these four numbers are no rotation: a quaternion has the length 1",
            where=rows.place(row, column),
            value=f"{length[row]:.4g}",
            limit=f"{1 - OFF_UNIT:g} to {1 + OFF_UNIT:g}",
            remedy="Name the columns as what they are, or scale the quaternions",
        )
    return given

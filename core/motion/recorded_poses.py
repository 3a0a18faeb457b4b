"""RecordedPoses: positions from a text file, with or without rotations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import tau
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..column_names import Column, columns_of
from ..errors import DermisError
from ..number_rows import UNIT_NOT_SAID, Rows, check_times, read_rows, slow, time_unit
from .rotation import matrices

PLACE = ("x", "y", "z")
QUATERNION, VECTOR, EULER = ("qw", "qx", "qy", "qz"), ("vx", "vy", "vz"), ("rx", "ry", "rz")
OFF_UNIT = 0.01  # largest deviation of a quaternion's length from 1, as from numbers rounded to two decimals
REACH = 3.0  # [m] no hand moves farther, so positions over a larger range are not in metres
ROOM = 10.0  # [m] no tracker reaches farther from its origin: SteamVR's largest room is 10 m wide and long
TURNS = {
    "none": (),
    "wxyz": ("qw", "qx", "qy", "qz"),
    "xyzw": ("qx", "qy", "qz", "qw"),
    "euler_deg": ("rx_deg", "ry_deg", "rz_deg"),
    "euler_rad": ("rx_rad", "ry_rad", "rz_rad"),
    "vector_rad": ("rotvec_x_rad", "rotvec_y_rad", "rotvec_z_rad"),
    "vector_deg": ("rotvec_x_deg", "rotvec_y_deg", "rotvec_z_deg"),
}
"""Names of the columns of a rotation, by its notation and unit."""
TIMES = {"none": (), "s": ("time_s",), "ms": ("time_ms",), "us": ("time_us",), "ns": ("time_ns",), "frame": ("frame",)}
"""Names of the columns of the time, by its unit."""
NOT_SAID = "columns-not-said"  # code of errors that the argument `columns` of `read` can avoid


@dataclass(frozen=True, eq=False)
class RecordedPoses:
    """Poses over time.

    Attributes:
        times: times from 0 [s], rising, shape (n,).
        places: positions [m], shape (n, 3).
        turns: rotation matrices, shape (n, 3, 3); None if the file has no rotations.
        unused: names of the columns that are not used.
    """

    times: Array
    places: Array
    turns: Array | None
    unused: tuple[str, ...]


@dataclass(frozen=True)
class Guess:
    """Most likely columns of a file without names.

    Attributes:
        time: key of `TIMES`; '' if the numbers do not decide it.
        turn: key of `TURNS`; '' if the numbers do not decide it.
        unit: unit of the positions, 'm' or 'mm'; '' if neither fits.
    """

    time: str
    turn: str
    unit: str


def read(path: Path, *, columns: str = "", rate: float = 100.0, unit: float | None = None) -> RecordedPoses:
    """Read recorded poses.

    The names in the file give meaning and unit of its columns: 'time [ms]', 'x_mm', 'rx_deg', 'qw'. Times without a
    unit are in seconds. The angles `rx, ry, rz` and `roll, pitch, yaw` are rotations about the fixed X axis, then Y,
    then Z.

    Args:
        path: path of the file.
        columns: names separated by commas, for a file without names, or in place of the file's own names.
        rate: for a file without times, rows per second [Hz], or frames per second if a column numbers the frames.
        unit: unit of positions whose names have no unit [m]; None for metres.

    Raises:
        DermisError: with the code 'columns-not-said' if the columns are not named, if the angles `rx, ry, rz` have no
            unit, or if times or positions have no unit and cannot be in seconds or metres. With other codes if the
            numbers contradict the names (a quaternion is far from unit length, times do not rise or last longer than a
            day), if a number is missing, or if there is only one row.
    """
    return of_rows(read_rows(path), columns=columns, rate=rate, unit=unit)


def of_rows(rows: Rows, *, columns: str = "", rate: float = 100.0, unit: float | None = None) -> RecordedPoses:
    """Read poses from rows of numbers; see `read`."""
    known = _known(rows, columns)
    place = {column.meaning: index for index, column in enumerate(known) if column.meaning}
    if len(rows.values) < 2:
        raise DermisError(
            "a motion needs at least two rows", where=rows.where, value=len(rows.values), limit=">= 2 rows"
        )
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
        unsaid_unit = "time" in place and known[time].unit is None
        if unsaid_unit and slow(times) and (np.diff(times) > 0.0).all():
            raise _not_said(UNIT_NOT_SAID, rows, known)
        check_times(times, rows, time)
    unsaid = [place[name] for name in PLACE if known[place[name]].unit is None]
    if unit is None and unsaid and _far(rows.values[:, unsaid]):
        raise _not_said("the unit of the positions is not stated, and they are too far away for metres", rows, known)
    numbers = {name: rows.values[:, place[name]] for name in (*PLACE, *turn)}
    for name in numbers:
        own = known[place[name]].unit
        numbers[name] = numbers[name] * ((unit or 1.0 if name in PLACE else 1.0) if own is None else own)
    turns = None
    if turn:
        given = np.stack([numbers[name] for name in turn], axis=1)
        turns = matrices(_quaternions(given, turn, rows, place[turn[0]]))
    unused = tuple(column.name for index, column in enumerate(known) if index not in used)
    return RecordedPoses(times - times[0], np.stack([numbers[name] for name in PLACE], axis=1), turns, unused)


def guess(rows: Rows) -> Guess:
    """Return the most likely columns of rows without names."""
    values, count = rows.values, rows.values.shape[1]
    rises = bool((np.diff(values[:, 0]) > 0.0).all())
    timed = count in (4, 8) or (count == 7 and rises and not _unit_length(values[:, 3:]))
    rest = values[:, 3 + timed :]
    unit = _length_unit(values[:, timed : timed + 3])
    as_tum = rows.spaced and count == 8  # the TUM format, whose positions are in metres
    turn = "none"
    if rest.shape[1] == 3:
        turn = "euler" + _angle_unit(rest)
    elif rest.shape[1] == 4:
        turn = _order(rest, as_tum)
    time = time_unit(values[:, 0]) if timed else "none"
    return Guess(time, turn, "" if as_tum and unit != "m" else unit)


def suggestion(rows: Rows, known: Sequence[Column] = ()) -> str:
    """Return the most likely names of a file's columns; '' if none fit.

    Args:
        rows: rows of the file.
        known: columns from the names that were given; empty for the file's own names.

    Raises:
        DermisError: see `column_names.columns_of`.
    """
    known = known or rows.columns()
    if not set(PLACE) <= {column.meaning for column in known}:
        found = guess(rows)
        if not (found.time and found.turn and found.unit) or (rows.names and found.turn != "none"):
            # Nothing is suggested if the numbers do not decide the names, or if the file has names of its own and the
            # guess has a rotation.
            return ""
        usual = names_of(found.time, found.turn, found.unit)
        return usual if usual.count(",") + 1 == rows.values.shape[1] else ""

    def of(*meanings: str) -> Array:
        unsaid = [i for i, column in enumerate(known) if column.meaning in meanings and column.unit is None]
        return np.asarray(rows.values[:, unsaid])

    missing = dict.fromkeys(EULER, _angle_unit(of(*EULER)))
    if slow(of("time").ravel()):
        missing["time"] = f"_{time_unit(of('time').ravel())}"
    if _far(of(*PLACE)):
        missing.update(dict.fromkeys(PLACE, f"_{_length_unit(of(*PLACE))}"))
    if "_" in missing.values():
        return ""
    named = [c.meaning + missing[c.meaning] if c.unit is None and c.meaning in missing else c.name for c in known]
    return ", ".join(name if column.meaning else "-" for name, column in zip(named, known, strict=True))


def names_of(time: str, turn: str, unit: str = "m") -> str:
    """Return names of columns in the usual order: time, position, rotation.

    Args:
        time, turn: keys of `TIMES` and `TURNS`.
        unit: unit of the positions, 'm' or 'mm'.
    """
    return ", ".join((*TIMES[time], *(f"{axis}_{unit}" for axis in PLACE), *TURNS[turn]))


def _far(places: Array) -> bool:
    """Return whether positions are too far apart or too far away for metres."""
    return bool(np.nanmax(np.ptp(places, axis=0), initial=0.0) > REACH or np.nanmax(np.abs(places), initial=0.0) > ROOM)


def _length_unit(places: Array) -> str:
    """Return 'm' if positions fit metres, else 'mm' if possible, else ''."""
    return "m" if not _far(places) else "mm" if not _far(1e-3 * places) else ""


def _order(turns: Array, as_tum: bool) -> str:
    """Return the key of `TURNS` for four columns of a quaternion, or ''.

    Distances between rows do not show the order, because they are the same in either order. The order is known if a
    row has no rotation, since then w is 1 or -1; recordings often begin with such a row. It is also known from the
    layout of the TUM format, which is eight numbers separated by spaces.
    """
    still = np.any(np.abs(np.abs(turns) - 1.0) < 1e-6, axis=0).tolist()
    told = {key for key, index in (("wxyz", 0), ("xyzw", 3)) if still[index]} | ({"xyzw"} if as_tum else set())
    return told.pop() if len(told) == 1 else ""


def _angle_unit(angles: Array) -> str:
    """Return '_deg' if an angle exceeds a full turn in radians, else '_rad'."""
    return "_deg" if np.nanmax(np.abs(angles), initial=0.0) > tau else "_rad"


def _known(rows: Rows, columns: str) -> tuple[Column, ...]:
    """Return the columns: name, meaning and unit.

    Raises:
        DermisError: names are missing, unknown or too few, or the unit of an angle is missing.
    """
    if columns.strip():
        names = [name.strip() for name in columns.split(",")]
        if len(names) != rows.values.shape[1]:
            raise DermisError(
                "the number of named columns differs from that of the file",
                where=rows.where,
                value=len(names),
                limit=f"{rows.values.shape[1]}",
            )
        known = columns_of(names, rows.where)
        unknown = [name for name, column in zip(names, known, strict=True) if not column.meaning and name != "-"]
        if unknown:
            raise DermisError(
                "unknown name of a column",
                where=rows.where,
                value=unknown[0],
                limit="time, frame, x, y, z, qw, qx, qy, qz, rx, ry, rz, rotvec_x, ... with a unit; '-' for no use",
            )
    elif rows.names:
        known = rows.columns()
    else:
        raise _not_said("the file does not name its columns", rows)
    meanings = {column.meaning for column in known}
    if not set(PLACE) <= meanings:
        raise _not_said("the names of the columns lack x, y or z", rows)
    for kind in (QUATERNION, VECTOR, EULER):
        part = [name for name in kind if name in meanings]
        if part and len(part) < len(kind):
            missing = ", ".join(name for name in kind if name not in meanings)
            raise _not_said(f"a part of the rotation is missing: {missing}", rows)
    if not set(QUATERNION) & meanings and not set(VECTOR) & meanings:
        angles = [column for column in known if column.meaning in EULER]
        if any(column.unit is None for column in angles):
            raise _not_said("the unit of the angles is not stated: degrees or radians", rows)
    return known


def _not_said(what: str, rows: Rows, known: Sequence[Column] = ()) -> DermisError:
    suggested = suggestion(rows, known)
    said, more = f"columns='{suggested or 'time_s, x_mm, y_mm, z_mm, qw, qx, qy, qz'}'", ""
    if not suggested and not rows.names and not guess(rows).turn:
        more = "; the numbers do not show whether w is the first or the last: qw, qx, qy, qz or qx, qy, qz, qw"
    return DermisError(
        what,
        where=rows.where,
        value=", ".join(rows.names)[:80] or f"{rows.values.shape[1]} columns without names",
        limit="columns x, y and z, and optionally a time and a rotation, in any order",
        remedy=f"State the columns, such as {said}, or write a line of names into the file{more}",
        code=NOT_SAID,
    )


def _check_finite(rows: Rows, used: Sequence[int]) -> None:
    bad = np.argwhere(~np.isfinite(rows.values[:, used]))
    if len(bad):
        row, index = bad[0]
        raise DermisError("a value is missing or is not a number", where=rows.place(int(row), used[index]))


def _unit_length(values: Array) -> bool:
    return bool((np.abs(np.linalg.norm(values, axis=1) - 1.0) <= OFF_UNIT).all())


def _quaternions(given: Array, turn: Sequence[str], rows: Rows, column: int) -> Array:
    """Return the quaternions (w, x, y, z) of rotations, shape (n, 4).

    Args:
        given: numbers of the rotations, shape (n, 3) or (n, 4).
        turn: meanings of the columns of `given`: `QUATERNION`, `VECTOR` or `EULER`.
        rows: rows of the file, for errors.
        column: index of the first column of `given` in the file, for errors.

    Raises:
        DermisError: a quaternion is not of unit length.
    """
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
            "these four numbers are not a rotation: a quaternion has the length 1",
            where=rows.place(row, column),
            value=f"{length[row]:.4g}",
            limit=f"{1 - OFF_UNIT:g} to {1 + OFF_UNIT:g}",
            remedy="Give the columns their right names, or scale the quaternions",
        )
    return given

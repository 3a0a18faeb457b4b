"""Meaning of columns' names in files of poses and recordings.

A name gives the quantity of its column, and often the unit.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import radians

from .errors import DermisError

TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # [s] size of each unit of time
LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}  # [m] size of each unit of length
ANGLES = {"rad": 1.0, "deg": radians(1.0)}  # [rad] size of each unit of angle
LONGEST = 80  # [characters] longest name in which a unit is looked for
# Other spellings of units, in lower case, and the unit of each.
_SPELLED = {
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "msec": "ms", "millisecond": "ms", "milliseconds": "ms",
    "usec": "us", "microsecond": "us", "microseconds": "us", "\u00b5s": "us", "\u03bcs": "us", "nsec": "ns",
    "nanosecond": "ns", "nanoseconds": "ns", "meter": "m", "meters": "m", "metre": "m", "metres": "m",
    "centimeters": "cm", "centimetres": "cm", "millimeters": "mm", "millimetres": "mm", "\u00b5m": "um",
    "\u03bcm": "um", "micrometers": "um", "micrometres": "um", "radian": "rad", "radians": "rad", "degree": "deg",
    "degrees": "deg", "\u00b0": "deg",
}  # fmt: skip
# Words that make a column the time, the frame, a position, Euler angles, a rotation vector or a quaternion; in lower
# case, without other characters than letters and digits.
_OF_TIME = {"time", "t", "times", "timestamp", "timestamps", "elapsed", "elapsedtime", "timesec"}
_OF_FRAMES = {"frame", "frames", "framenumber", "frameno"}
_PLACE = {"", "p", "pos", "position", "loc", "location", "translation", "trans"}
_TURN = {"r", "rot", "rotation", "euler", "angle", "eulerangle", "orientation", "ori"}
_VECTOR = {"rv", "rotvec", "rotvector", "rotationvector", "axisangle"}
_QUATERNION = {"q", "quat", "quaternion", "rotquat"}
_FORCES, _TORQUES = (("fx", "fy", "fz"), ("forcex", "forcey", "forcez")), ("tx", "ty", "tz")
_ANGLES = {"roll": "rx", "pitch": "ry", "yaw": "rz"}
# Allowed units by kind of column: time, frame, position, Euler angles, rotation vector, quaternion.
_DIMENSIONS: Mapping[str, Mapping[str, float]] = {
    "t": TIMES,
    "f": {},
    "p": LENGTHS,
    "r": ANGLES,
    "v": ANGLES,
    "q": {"1": 1.0},
}


@dataclass(frozen=True)
class Column:
    """Meaning of a column's name.

    Attributes:
        name: the name in the file.
        meaning: 'time'; 'frame'; 'x', 'y', 'z' (a position); 'rx', 'ry', 'rz' (Euler angles); 'vx', 'vy', 'vz' (a
            rotation vector); 'qw', 'qx', 'qy', 'qz' (a quaternion); '' for any other name.
        unit: size of the column's unit in SI, such as 1e-3 for mm; None if the name has no unit.
    """

    name: str
    meaning: str
    unit: float | None = None


def columns_of(names: Sequence[str], where: str) -> tuple[Column, ...]:
    """Return the meanings of columns' names, in the same order.

    The names of a quaternion may be `rotation_x` to `rotation_w`. After the `x, y, z` of a position, they may also be
    `w, x, y, z` or `x, y, z, w`. If a file has forces `fx, fy, fz`, then `tx, ty, tz` are torques, whose meaning is ''.

    Args:
        names: the names.
        where: name of the file, for the message.

    Raises:
        DermisError: a unit in brackets does not fit the quantity of its column, or two columns have the same meaning.
    """
    bare = [re.sub(r"[^a-z0-9]", "", _unit(name)[0].lower()) for name in names]
    torques = _TORQUES if any(set(forces) <= set(bare) for forces in _FORCES) else ()
    found = [Column(n, "") if b in torques else _column(n, where) for n, b in zip(names, bare, strict=True)]
    _short_quaternion(found)
    if any(column.meaning == "rw" for column in found):
        turned = {"rw": "qw", "rx": "qx", "ry": "qy", "rz": "qz"}
        found = [Column(c.name, turned.get(c.meaning, c.meaning), c.unit) for c in found]
    seen: dict[str, str] = {}
    for column in found:
        if column.meaning and seen.setdefault(column.meaning, column.name) is not column.name:
            raise DermisError(
                "two columns have the same meaning",
                where=where,
                value=f"{seen[column.meaning]}, {column.name}",
                remedy="Rename or remove one of them",
            )
    return tuple(found)


def time_column(columns: Sequence[Column], where: str) -> int:
    """Return the index of the column of times.

    Raises:
        DermisError: no column has the meaning 'time'.
    """
    for index, column in enumerate(columns):
        if column.meaning == "time":
            return index
    raise DermisError(
        "no column has the name of a time",
        where=where,
        value=", ".join(column.name for column in columns)[:80],
        limit="time, t, timestamp, with a unit or in seconds: 'time [ms]', 't_ms'",
        remedy="Rename the column of times",
    )


def length_or_angle(name: str, where: str) -> float:
    """Return the size in SI of the unit of length or angle in a name.

    The size is 1 if the name has no unit.

    Args:
        name: name of the column.
        where: name of the file, for the message.

    Raises:
        DermisError: see `size_of_unit`.
    """
    return size_of_unit(name, {**LENGTHS, **ANGLES}, where)


def size_of_unit(name: str, allowed: Mapping[str, float], where: str) -> float:
    """Return the size in SI of the unit in a column's name.

    The size is 1 if the name has no unit. Units are compared without regard to case.

    Args:
        name: name of the column.
        allowed: sizes of the units that the column may have.
        where: name of the file, for the message.

    Raises:
        DermisError: the name has another unit, or text in brackets that is no unit.
    """
    unit, sizes = unit_of(name), {allowed_unit.lower(): size for allowed_unit, size in allowed.items()}
    if unit and unit not in sizes:
        raise DermisError(
            "the unit does not fit this channel",
            where=f"{where}, column '{name}'",
            value=unit,
            limit=", ".join(allowed),
            remedy="Convert the column to one of these, or remove the brackets if they hold no unit",
        )
    return sizes[unit] if unit else 1.0


def unit_of(name: str) -> str:
    """Return the unit in a name, in lower case; '' if it has none.

    Text in brackets counts as a unit even if there is no such unit. Without brackets, units of time, length and angle
    are recognised.
    """
    inside = re.search(r"[\[(]([^\[\]()]*)[\])]", name)
    word = inside[1].strip().lower() if inside else ""
    return _unit(name)[1] or _SPELLED.get(word, word)


def _column(name: str, where: str) -> Column:
    base, unit, bracketed = _unit(name)
    meaning = _meaning(base)
    if not meaning:
        base, unit, bracketed = name, "", False  # the last word is not a unit but a part of the name
        meaning = _meaning(base)
    if not meaning or not unit:
        return Column(name, meaning)
    kind = "t" if meaning == "time" else "f" if meaning == "frame" else meaning[0] if len(meaning) == 2 else "p"
    units = _DIMENSIONS[kind]
    if unit not in units:
        if not bracketed:
            return Column(name, "")
        raise DermisError(
            "the unit does not fit this column",
            where=f"{where}, column '{name}'",
            value=unit,
            limit=", ".join(units) or "no unit",
            remedy="Write one of these, or convert the column",
        )
    return Column(name, meaning, units[unit])


def _unit(name: str) -> tuple[str, str, bool]:
    """Return a name without its unit, the unit, and if it was in brackets.

    The unit is '' if the name has none.
    """
    text = name.strip().strip("\"'").strip().lstrip("#").strip()
    if len(text) > LONGEST:
        return text, "", False
    match = re.fullmatch(r"(.+?)\s*[\[(]([^\])]*)[\])]", text)
    if match:
        unit = match[2].strip().lower()
        return match[1], _SPELLED.get(unit, unit), True
    match = re.fullmatch(r"(.+?)[\s_.:/-]+([^\s_.:/-]+)", text)
    if match:
        last = match[2].lower()
        last = _SPELLED.get(last, last)
        if last in TIMES or last in LENGTHS or last in ANGLES:
            return match[1], last, False
    if text.lower() in _SPELLED and _SPELLED[text.lower()] in TIMES:  # 'milliseconds'
        return "time", _SPELLED[text.lower()], False
    return text, "", False


def _meaning(name: str) -> str:
    """Return the meaning of a name without its unit, see `Column.meaning`.

    A prefix is ignored, such as 'left_hand' in 'left_hand.position.x'.
    """
    if re.fullmatch(r"[pq](_[A-Z][A-Za-z]*)+_[wxyz]", name):  # 'p_RS_R_x', with the names of two coordinate systems
        return _meaning_of(name[0] + name[-1])
    parts = re.split(r"[\s_.:/-]+", name)
    short = _meaning_of(name)
    if not short and len(parts) > 2 and len(parts[-2]) > 1:  # 'left_hand.position.x'
        short = _meaning_of("".join(parts[-2:]))
    return short


def _meaning_of(name: str) -> str:
    key = re.sub(r"[^a-z0-9]", "", name.lower())
    if key in _OF_TIME:
        return "time"
    if key in _OF_FRAMES:
        return "frame"
    if key in _ANGLES:
        return _ANGLES[key]
    for axis in "xyzw":
        rest = [key.removesuffix(axis)] if key.endswith(axis) else []
        rest += [key.removeprefix(axis)] if key.startswith(axis) else []  # 'x_pos'
        for word in rest:
            if word in _QUATERNION:
                return f"q{axis}"
            if word in _TURN:
                return f"r{axis}"
            if word in _VECTOR and axis != "w":
                return f"v{axis}"
            if word in _PLACE | {"t"} and axis != "w":  # 'tx' of translations
                return axis
    return "w" if key == "w" else ""


def _short_quaternion(found: list[Column]) -> None:
    """Set the meanings of four columns that are a quaternion with short names.

    The four are 'w, x, y, z' or 'x, y, z, w' after the 'x, y, z' of a position. If there are none, any column 'w'
    becomes 'qw'.
    """
    meanings = [column.meaning for column in found]
    for i in range(3, len(found) - 3):
        four = meanings[i : i + 4]
        if four in (["w", "x", "y", "z"], ["x", "y", "z", "w"]) and "x" in meanings[:i]:
            found[i : i + 4] = [Column(c.name, f"q{c.meaning}", c.unit and 1.0) for c in found[i : i + 4]]
            return
    for i, column in enumerate(found):
        if column.meaning == "w":
            found[i] = Column(column.name, "qw", column.unit)

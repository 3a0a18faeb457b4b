"""Command tracks as JSON, version 1: exact floats.

Every float is written as the shortest decimal that reads back as the same float. A file is
`{"schema": "dermis-track-json 1", "device": ..., "channels": [...], "times": ..., "meta": ..., "limited": ...,
"values": {"tactor_x": [...], ...}}`, with one list in `values` for each channel. `times` has the number of samples,
`count`. On a regular grid it also has `first` and `rate`: sample k is at (first + k) / rate seconds. Other times are
the list "t_s" in `values`.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from ..files import read_text, write_bytes
from ..foreign import MAX_TEXT, json_of
from .command_track import CommandTrack
from .track_header import check_finite, check_schema, grid_of, header_of, text_of, track_of

SCHEMA = "dermis-track-json 1"


def write(track: CommandTrack, path: Path) -> None:
    """Write a track as JSON in one atomic step.

    Raises:
        DermisError: see `dumps`; or the file cannot be written.
    """
    write_bytes(Path(path), dumps(track).encode("utf-8"))


def dumps(track: CommandTrack) -> str:
    """Return a track as JSON text; equal tracks give equal text.

    Raises:
        DermisError: a time or a value is not finite, the times do not rise, or the file cannot hold an entry.
    """
    check_finite(track)
    header = header_of(track, SCHEMA)
    columns = [(c.name, track.values[:, i]) for i, c in enumerate(track.channels)]
    if "first" not in header["times"]:
        if "t_s" in dict(columns):
            raise DermisError("a channel has the name of the column of times", where=track.spec.key, value="t_s")
        columns.insert(0, ("t_s", track.times))
    lines = [f"{text_of({'name': n})[9:-1]}: [{', '.join(map(repr, v.tolist()))}]" for n, v in columns]
    head = text_of(header)[:-1]
    return f'{head},\n"values": {{\n' + ",\n".join(lines) + "\n}}\n"


def read(path: Path) -> CommandTrack:
    """Read a track from a JSON file.

    Raises:
        DermisError: the file cannot be read, is no JSON track of this version, or is not well formed.
    """
    where = str(path)
    return loads(read_text(path), where=where)


def loads(text: str, *, where: str = "track") -> CommandTrack:
    """Read a track from JSON text.

    Raises:
        DermisError: the text is no JSON track of this version, or is not well formed.
    """
    header = check_schema(json_of(text, where, MAX_TEXT), SCHEMA, ("values",), where)
    number, times = grid_of(header, where)
    columns, channels = header["values"], header["channels"]
    if not isinstance(columns, dict) or not isinstance(channels, list):
        raise DermisError("'values' must be an object with one list per column", where=where)
    names = [c.get("name") if isinstance(c, dict) else None for c in channels]
    wanted = [*(["t_s"] if times is None else []), *names]
    if list(columns) != wanted:
        raise DermisError("the columns are not the channels", where=where, value=", ".join(columns)[:200])
    table = [_column(columns[name], number, f"{where}, values, {name}") for name in wanted]
    if times is None:
        times = table.pop(0)
    values = np.stack(table, axis=1) if table else np.empty((number, 0))
    return track_of(header, times, values, where)


def _column(numbers: Any, count: int, where: str) -> Array:
    if not isinstance(numbers, list) or len(numbers) != count:
        raise DermisError(
            "the number of samples is not the one stated",
            where=where,
            limit=str(count),
            value=len(numbers) if isinstance(numbers, list) else str(numbers)[:80],
        )
    for i, n in enumerate(numbers):
        if type(n) is not float and type(n) is not int:
            raise DermisError("not a number", where=f"{where}, sample {i}", value=str(n)[:80])
    try:
        column = np.array([float(n) for n in numbers])
    except OverflowError as error:
        raise DermisError("a number too large", where=where) from error
    if not all(map(math.isfinite, column.tolist())):
        raise DermisError("not a finite number", where=where)
    return column

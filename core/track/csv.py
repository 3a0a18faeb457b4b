"""Command tracks as CSV, version 1.

A header describes the device completely. Times and channels follow, in SI:

```
# dermis-track 1
# device: haptip
# ... one `# key: value` line each ...
t_s,tactor_x[m],tactor_y[m]
0,0,0
0.001,1.25e-06,0
```
Files are UTF-8 with LF, and numbers are written as `%.9g`. Nothing is quoted, so no name of a column contains a comma.
In header values, `\\`, line breaks and other control characters are escaped. Lines that end in CRLF are read too, since
editors and version control may change the line ends. Everything else that version 1 does not know is an error that
names the line: keys, kinds of devices, fields of the wire, kinds of limiting. Only keys that begin with `x.` are free.
They are for notes of other programs, and are kept and written again.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..devices.spec import NAME
from ..errors import DermisError
from ..files import opened, read_bytes, write_bytes
from ..foreign import MAX_TEXT
from ..units import UNITS
from .command_track import CommandTrack
from .csv_header import MAGIC, VERSION, count, entries_of, escaped, spec_of, split
from .known_keys import KEY, check_known, check_limited, check_meta, is_own

_NOT_NUMERIC = re.compile(r"[^0-9eE+\-.,\n]")
_ROWS_AT_ONCE = 4096  # rows that are formatted by one operation
_DIGITS = 5.001e-9  # relative tolerance of a time: rounding to nine digits is off by half a unit of the ninth digit


def write(track: CommandTrack, path: Path | str) -> None:
    """Write a track as CSV in one atomic step.

    Raises:
        DermisError: the track cannot be written as version 1 (see `dumps`), or the file cannot be written.
    """
    write_bytes(Path(path), dumps(track).encode("utf-8"))


def dumps(track: CommandTrack) -> str:
    """Return a track as CSV text; equal tracks give equal text.

    Raises:
        DermisError: a value is not finite, the times do not rise in nine digits, or the format cannot hold a name.
    """
    _check_writable(track)
    lines = [f"{MAGIC} {VERSION}"]
    lines += [f"# {key}: {escaped(value)}" if value else f"# {key}:" for key, value in entries_of(track)]
    lines.append(",".join(["t_s", *(f"{c.name}[{c.unit}]" for c in track.channels)]))
    row = ",".join(["%.9g"] * (1 + len(track.channels))) + "\n"
    table = np.column_stack([track.times, track.values]) + 0.0  # turns -0.0 into 0.0
    body = [
        (row * len(part)) % tuple(part.ravel().tolist())
        for part in (table[i : i + _ROWS_AT_ONCE] for i in range(0, len(table), _ROWS_AT_ONCE))
    ]
    return "\n".join(lines) + "\n" + "".join(body)


def read(path: Path | str) -> CommandTrack:
    """Read a track from a CSV file in the format of `write`.

    Raises:
        DermisError: the file cannot be read, is not version 1 or is not well formed; the error names the line.
    """
    path, where = Path(path), str(path)
    with opened(path) as (file, _):
        first = file.readline(200)
    if not first.startswith(MAGIC.encode()):
        loads(first.decode("utf-8", "replace"), where=where)  # raises the error that names the reason
    data = read_bytes(path, most=MAX_TEXT)
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise DermisError(
            "not UTF-8 text",
            where=f"{where}, line {data.count(10, 0, error.start) + 1}",
            value=f"byte 0x{data[error.start]:02x}",
            limit="UTF-8",
            remedy="Save the file as UTF-8",
        ) from error
    return loads(text, where=where)


def loads(text: str, *, where: str = "track") -> CommandTrack:
    """Read a track from CSV text.

    The device is rebuilt from the header. Keys that begin with `x.` are kept in `meta`. If all times agree with a
    regular grid at the stated rate in the nine digits of the file, the exact times of the grid are returned.

    Raises:
        DermisError: the text is not version 1 or not well formed; the error names the line.
    """
    if "\r" in text:
        text = text.replace("\r\n", "\n")
    entries, heading, body = split(text, where)
    fields = {key: value for key, (value, _) in entries.items()}
    spec = spec_of(entries, heading, where)
    names = {c.name: None for c in spec.channels}
    for key, (value, line) in entries.items():
        if key.startswith("limited."):
            check_limited(key.removeprefix("limited."), names, f"{where}, line {line}")
        elif not is_own(key):
            check_meta(key, value, f"{where}, line {line}")
    first_line = len(entries) + 3
    table = _table(body, 1 + len(spec.channels), where, first_line)
    _check_rising(table[:, 0], where, first_line)
    if "samples" in fields and fields["samples"] != str(len(table)):
        raise DermisError(
            "the number of rows is not the one stated",
            where=where,
            value=len(table),
            limit=fields["samples"],
            remedy="The file may be cut short; if rows were edited on purpose, remove the line '# samples'",
        )
    return CommandTrack(
        spec=spec,
        times=_on_grid(table[:, 0], spec.rate),
        values=np.ascontiguousarray(table[:, 1:]),
        meta={k: v for k, v in fields.items() if not is_own(k)},
        limited={
            key.removeprefix("limited."): count(value, f"{where}, line {line}")
            for key, (value, line) in entries.items()
            if key.startswith("limited.")
        },
    )


def _check_writable(track: CommandTrack) -> None:
    where = f"track of '{track.meta.get('finger', track.spec.key)}'"
    for channel in track.channels:
        if not NAME.fullmatch(channel.name) or channel.unit not in UNITS:
            raise DermisError(
                "a channel's name or unit that the format cannot hold",
                where=where,
                value=f"{channel.name}[{channel.unit}]",
            )
    names = [c.name for c in track.channels]
    if len(set(names)) != len(names):
        raise DermisError("two channels have one name", where=where, value=", ".join(names))
    if not names:
        raise DermisError("the device has no channels", where=where)
    for key, value in track.meta.items():
        if not KEY.fullmatch(key) or is_own(key):
            raise DermisError(
                "a key that the header cannot hold",
                where=where,
                value=key,
                limit="letters, digits, '_', '.', '-', and none of the format's own keys",
            )
        if not isinstance(value, str):
            raise DermisError("a header value must be a text", where=f"{where}, {key}", value=value)
    check_known(track, where)
    for key in (*track.spec.parameters, *track.spec.link_budget, *track.limited):
        if not KEY.fullmatch(key):
            raise DermisError(
                "a key that the header cannot hold", where=where, value=key, limit="letters, digits, '_', '.', '-'"
            )
    if not np.isfinite(track.times).all():
        row = int(np.flatnonzero(~np.isfinite(track.times))[0])
        raise DermisError("a time is not a finite number", where=f"{where}, sample {row}", value=track.times[row])
    bad = np.argwhere(~np.isfinite(track.values))
    if len(bad):
        row, column = bad[0]
        raise DermisError(
            "a value is not a finite number",
            where=f"{where}, sample {row}, {track.channels[column].name}",
            value=track.values[row, column],
            remedy="Limit the track first: that replaces such values by the last finite one, and counts them",
        )
    if len(track.times) > 1:
        written = np.array([float(f"{t:.9g}") for t in track.times.tolist()])
        stuck = np.flatnonzero(np.diff(written) <= 0)
        if len(stuck):
            raise DermisError(
                "times do not rise in the nine digits of the format",
                where=f"{where}, sample {stuck[0] + 1}",
                value=f"{track.times[stuck[0]]!r} s, then {track.times[stuck[0] + 1]!r} s",
                remedy="Export a shorter range, or resample at a lower rate",
            )


def _table(body: str, columns: int, where: str, first_line: int) -> Array:
    """Return the rows as numbers, shape (n, columns).

    Every row must have all columns, and every cell must be a finite number.
    """
    if not body:
        return np.empty((0, columns))
    lines = body[:-1].split("\n")
    for number, line in enumerate(lines, start=first_line):
        if line.count(",") != columns - 1 or not line:
            what = "an empty line" if not line else "a row of another length"
            raise DermisError(
                what, where=f"{where}, line {number}", value=f"{line.count(',') + 1} values", limit=f"{columns} values"
            )
    numbers: list[float] = []
    if _NOT_NUMERIC.search(body) is None:
        try:
            numbers = list(map(float, body[:-1].replace("\n", ",").split(",")))
        except ValueError:
            pass
    table = np.array(numbers).reshape(-1, columns)
    if not numbers or not np.isfinite(table).all():
        _refuse_cell(lines, where, first_line)
    return table


def _refuse_cell(lines: list[str], where: str, first_line: int) -> None:
    """Raise an error that names the first cell without a finite number."""
    for number, line in enumerate(lines, start=first_line):
        for column, cell in enumerate(line.split(","), start=1):
            try:
                good = _NOT_NUMERIC.search(cell) is None and math.isfinite(float(cell))
            except ValueError:
                good = False
            if not good:
                raise DermisError(
                    "not a finite number", where=f"{where}, line {number}, column {column}", value=cell[:80]
                )


def _check_rising(times: Array, where: str, first_line: int) -> None:
    stuck = np.flatnonzero(np.diff(times) <= 0)
    if len(stuck):
        i = int(stuck[0])
        raise DermisError(
            "times do not rise",
            where=f"{where}, line {first_line + i + 1}",
            value=f"{times[i + 1]:g} s",
            limit=f"> {times[i]:g} s",
        )


def _on_grid(times: Array, rate: float) -> Array:
    """Return the exact times of a regular grid at `rate` [Hz].

    If the times do not agree with such a grid in nine digits, they are returned as they are.
    """
    if len(times) == 0:
        return times
    start = np.rint(times[0] * rate)
    grid = (start + np.arange(len(times))) / rate
    return grid if (np.abs(grid - times) <= _DIGITS * np.abs(times)).all() else times

"""Command tracks as CSV, version 1: a header that rebuilds the device, then times and channels in SI.

```
# dermis-track 1
# device: haptip
# ... one `# key: value` line each ...
t_s,tactor_x[m],tactor_y[m]
0,0,0
0.001,1.25e-06,0
```
UTF-8, LF, values as `%.9g`, no quoting: no name in it may hold a comma. In values of the header `\\`, line breaks and
other control characters are escaped. Lines that end in CRLF are read too, since editors and version control change
them on the way; everything else that version 1 does not know is refused with its line.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..devices.spec import NAME, Channel, DeviceSpec
from ..errors import DermisError
from ..files import read_bytes, write_bytes
from ..track import Array, CommandTrack
from ..units import UNITS

VERSION = 1
MAGIC = "# dermis-track"
UNIT_SYSTEM = "SI"

FIRST_META = ("generator", "finger", "scene", "frame_range", "fps", "content_hash")
OWN_KEYS = ("device", "device_name", "kind", "spec_hash", "rate", "units", "samples")
OWN_GROUPS = ("channel", "parameter", "wire", "limited")

_KEY = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
_UNSAFE = re.compile("[\\\\\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff\ufeff]")
_ESCAPE = re.compile(r"\\(\\|n|r|t|u[0-9a-f]{4}|.?)", re.DOTALL)
_SHORT = {"\\": "\\\\", "\n": "\\n", "\r": "\\r", "\t": "\\t"}
_LONG = {"\\": "\\", "n": "\n", "r": "\r", "t": "\t"}
_NOT_NUMERIC = re.compile(r"[^0-9eE+\-.,\n]")
_ROWS_AT_ONCE = 4096


def write(track: CommandTrack, path: Path) -> None:
    """Write a track as CSV, whole or not at all.

    Raises:
        DermisError: the track cannot be written as version 1 (see `dumps`), or the file cannot be written.
    """
    write_bytes(Path(path), dumps(track).encode("utf-8"))


def dumps(track: CommandTrack) -> str:
    """Return a track as CSV text; equal tracks give equal text.

    Raises:
        DermisError: a value that is not finite, times that do not rise in nine digits, or a name that the
            format cannot hold.
    """
    _check_writable(track)
    lines = [f"{MAGIC} {VERSION}"]
    lines += [f"# {key}: {_escaped(value)}" if value else f"# {key}:" for key, value in _header(track)]
    lines.append(",".join(["t_s", *(f"{c.name}[{c.unit}]" for c in track.channels)]))
    row = ",".join(["%.9g"] * (1 + len(track.channels))) + "\n"
    table = np.column_stack([track.times, track.values]) + 0.0  # no minus zeros
    body = [
        (row * len(part)) % tuple(part.ravel().tolist())
        for part in (table[i : i + _ROWS_AT_ONCE] for i in range(0, len(table), _ROWS_AT_ONCE))
    ]
    return "\n".join(lines) + "\n" + "".join(body)


def read(path: Path) -> CommandTrack:
    """Read a track that `write` wrote, or that something else wrote to the same rules.

    Raises:
        DermisError: not version 1, or not well formed; says in which line.
    """
    where = str(path)
    data = read_bytes(Path(path))
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise DermisError(
            "not UTF-8 text", where=f"{where}, line {data.count(10, 0, error.start) + 1}",
            value=f"byte 0x{data[error.start]:02x}", limit="UTF-8", remedy="Save the file as UTF-8",
        ) from error  # fmt: skip
    return loads(text, where=where)


def loads(text: str, *, where: str = "track") -> CommandTrack:
    """Read a track from CSV text; the device is rebuilt from the header, unknown keys are kept in `meta`.

    Where the times are a regular grid at the stated rate to within the nine digits written, they come back exact.

    Raises:
        DermisError: not version 1, or not well formed; says in which line.
    """
    if "\r" in text:
        text = text.replace("\r\n", "\n")
    entries, heading, body = _split(text, where)
    fields = {key: value for key, (value, _) in entries.items()}
    spec = _spec(entries, heading, where)
    first_line = len(entries) + 3
    table = _table(body, 1 + len(spec.channels), where, first_line)
    _check_rising(table[:, 0], where, first_line)
    if "samples" in fields and fields["samples"] != str(len(table)):
        raise DermisError(
            "the number of rows is not the one stated", where=where, value=len(table), limit=fields["samples"],
            remedy="The file may be cut short; if rows were edited on purpose, remove the line '# samples'",
        )  # fmt: skip
    return CommandTrack(
        spec=spec,
        times=_on_grid(table[:, 0], spec.rate),
        values=np.ascontiguousarray(table[:, 1:]),
        meta={k: v for k, v in fields.items() if not _is_own(k)},
        limited={
            key.removeprefix("limited."): _count(value, f"{where}, line {line}")
            for key, (value, line) in entries.items() if key.startswith("limited.")
        },
    )  # fmt: skip


# -- writing


def _header(track: CommandTrack) -> Iterator[tuple[str, str]]:
    """Give the header's keys and values in their order."""
    spec, meta = track.spec, track.meta
    for key in (*(k for k in FIRST_META if k in meta), *sorted(set(meta) - set(FIRST_META))):
        yield key, meta[key]
    yield "device", spec.key
    yield "device_name", spec.name
    yield "kind", spec.kind
    yield "spec_hash", spec.hash
    yield "rate", repr(float(spec.rate))
    yield "units", UNIT_SYSTEM
    yield "samples", str(len(track.times))
    for channel in spec.channels:
        yield (
            f"channel.{channel.name}",
            _json({k: getattr(channel, k) for k in ("low", "high", "slew", "rest", "actuator")}),
        )
    for key in sorted(spec.parameters):
        yield f"parameter.{key}", _json(spec.parameters[key])
    for key in sorted(spec.wire):
        yield f"wire.{key}", _json(spec.wire[key])
    for key in sorted(track.limited):
        yield f"limited.{key}", str(int(track.limited[key]))


def _check_writable(track: CommandTrack) -> None:
    where = f"track of '{track.meta.get('finger', track.spec.key)}'"
    for channel in track.channels:
        if not NAME.fullmatch(channel.name) or channel.unit not in UNITS:
            raise DermisError("a channel's name or unit that the format cannot hold", where=where,
                              value=f"{channel.name}[{channel.unit}]")  # fmt: skip
    names = [c.name for c in track.channels]
    if len(set(names)) != len(names):
        raise DermisError("two channels have one name", where=where, value=", ".join(names))
    if not names:
        raise DermisError("the device has no channels", where=where)
    for key, value in track.meta.items():
        if not _KEY.fullmatch(key) or _is_own(key):
            raise DermisError("a key that the header cannot hold", where=where, value=key,
                              limit="letters, digits, '_', '.', '-', and none of the format's own keys")  # fmt: skip
        if not isinstance(value, str):
            raise DermisError("a header value must be a text", where=f"{where}, {key}", value=value)
    for key in (*track.spec.parameters, *track.spec.wire, *track.limited):
        if not _KEY.fullmatch(key):
            raise DermisError("a key that the header cannot hold", where=where, value=key,
                              limit="letters, digits, '_', '.', '-'")  # fmt: skip
    if not np.isfinite(track.times).all():
        row = int(np.flatnonzero(~np.isfinite(track.times))[0])
        raise DermisError("a time is not a finite number", where=f"{where}, sample {row}", value=track.times[row])
    bad = np.argwhere(~np.isfinite(track.values))
    if len(bad):
        row, column = bad[0]
        raise DermisError(
            "a value is not a finite number", where=f"{where}, sample {row}, {track.channels[column].name}",
            value=track.values[row, column], remedy="Limit the track first: it holds the last good value and counts",
        )  # fmt: skip
    if len(track.times) > 1:
        written = np.array([float(f"{t:.9g}") for t in track.times.tolist()])
        stuck = np.flatnonzero(np.diff(written) <= 0)
        if len(stuck):
            raise DermisError(
                "times do not rise in the nine digits of the format", where=f"{where}, sample {stuck[0] + 1}",
                value=f"{track.times[stuck[0]]!r} s, then {track.times[stuck[0] + 1]!r} s",
                remedy="Export a shorter range, or resample at a lower rate",
            )  # fmt: skip


def _json(value: Any) -> str:
    """Write a plain value on one line; floats so that they read back as the same floats."""
    try:
        return json.dumps(value, ensure_ascii=False, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise DermisError("a device setting that the header cannot hold", value=repr(value)) from error


def _escaped(value: str) -> str:
    return _UNSAFE.sub(lambda m: _SHORT.get(m[0], f"\\u{ord(m[0]):04x}"), value)


# -- reading


def _split(text: str, where: str) -> tuple[dict[str, tuple[str, int]], str, str]:
    """Separate header entries with their line numbers, the heading, and the rows."""
    first, _, rest = text.partition("\n")
    if first != f"{MAGIC} {VERSION}":
        _refuse_first_line(first, where)
    if not text.endswith("\n"):
        raise DermisError(
            "the file ends in the middle of a line", where=f"{where}, line {text.count(chr(10)) + 1}",
            remedy="Copy or export it again",
        )  # fmt: skip
    entries: dict[str, tuple[str, int]] = {}
    number = 2
    while rest.startswith("#"):
        line, _, rest = rest.partition("\n")
        key, colon, value = line[1:].removeprefix(" ").partition(":")
        place = f"{where}, line {number}"
        if not colon or not _KEY.fullmatch(key) or (value and not value.startswith(" ")):
            raise DermisError("not a header line", where=place, value=line[:80], limit="# key: value")
        if key in entries:
            raise DermisError("a key stands twice", where=place, value=key)
        entries[key] = (_unescaped(value.removeprefix(" "), place), number)
        number += 1
    heading, _, body = rest.partition("\n")
    if not heading:
        raise DermisError("the row of column names is missing", where=f"{where}, line {number}")
    return entries, heading, body


def _refuse_first_line(first: str, where: str) -> None:
    place = f"{where}, line 1"
    if first.startswith("\ufeff"):
        raise DermisError("starts with a byte order mark", where=place, remedy="Save as UTF-8 without it")
    match = re.fullmatch(rf"{MAGIC} (\d+)", first)
    if match:
        newer = int(match[1]) > VERSION
        raise DermisError(
            "written by a newer version of Dermis" if newer else "a version that does not exist", where=place,
            value=f"version {match[1]}", limit=f"version {VERSION}", remedy="Update Dermis" if newer else "",
        )  # fmt: skip
    raise DermisError("not a Dermis command track", where=place, value=first[:80], limit=f"{MAGIC} {VERSION}")


def _spec(entries: Mapping[str, tuple[str, int]], heading: str, where: str) -> DeviceSpec:
    """Rebuild the device from the header and the row of column names."""
    for key in ("device", "kind", "spec_hash", "rate", "units"):
        if key not in entries:
            raise DermisError(f"'# {key}' is missing in the header", where=where)
    units, line = entries["units"]
    if units != UNIT_SYSTEM:
        raise DermisError("unknown system of units", where=f"{where}, line {line}", value=units, limit=UNIT_SYSTEM)
    for key, (_, line) in entries.items():
        if key.partition(".")[0] in OWN_GROUPS and not key.partition(".")[2]:
            raise DermisError("nothing is named", where=f"{where}, line {line}", value=key)
    key = entries["device"][0]
    return DeviceSpec(
        key=key,
        name=entries.get("device_name", (key, 0))[0],
        kind=entries["kind"][0],
        rate=_rate(*entries["rate"], where=where),
        channels=_channels(entries, heading, where),
        parameters=_group(entries, "parameter", where),
        wire={k: _number(v, f"{where}, wire.{k}") for k, v in _group(entries, "wire", where).items()},
        stated_hash=entries["spec_hash"][0],
    )


def _channels(entries: Mapping[str, tuple[str, int]], heading: str, where: str) -> tuple[Channel, ...]:
    place = f"{where}, line {len(entries) + 2}"
    names = heading.split(",")
    if names[0] != "t_s":
        raise DermisError("the first column is not the time", where=place, value=names[0][:80], limit="t_s")
    stated = {k.removeprefix("channel."): k for k in entries if k.startswith("channel.")}
    channels: list[Channel] = []
    for number, name in enumerate(names[1:], start=2):
        match = re.fullmatch(rf"({NAME.pattern})\[([^\[\],]+)\]", name)
        if match is None or match[2] not in UNITS or UNITS[match[2]][0] != match[2]:
            raise DermisError("not a column name", where=f"{place}, column {number}", value=name[:80],
                              limit="name[unit] with an SI unit")  # fmt: skip
        if match[1] in {c.name for c in channels}:
            raise DermisError("a column stands twice", where=f"{place}, column {number}", value=match[1])
        if match[1] not in stated:
            raise DermisError(
                f"'# channel.{match[1]}' is missing in the header", where=f"{place}, column {number}",
                remedy='Write at least {} there: a channel without limits',
            )  # fmt: skip
        channels.append(_channel(match[1], match[2], *entries[stated.pop(match[1])], where=where))
    if stated:
        key = next(iter(stated.values()))
        raise DermisError("a channel without a column", where=f"{where}, line {entries[key][1]}", value=key)
    if not channels:
        raise DermisError("no column but the time", where=place)
    return tuple(channels)


def _channel(name: str, unit: str, text: str, line: int, *, where: str) -> Channel:
    place = f"{where}, line {line}"
    value = _from_json(text, place)
    known = ("low", "high", "slew", "rest", "actuator")
    if not isinstance(value, dict) or not set(value) <= set(known):
        raise DermisError("not the limits of a channel", where=place, value=text[:80], limit=", ".join(known))
    numbers = {k: _number(v, f"{place}, {k}") for k, v in value.items() if k != "actuator" and v is not None}
    actuator = value.get("actuator", "")
    if not isinstance(actuator, str):
        raise DermisError("the actuator is not a name", where=place, value=actuator)
    if numbers.get("low", -math.inf) > numbers.get("high", math.inf):
        raise DermisError("low is above high", where=place, value=numbers["low"], limit=f"<= {numbers['high']}")
    if numbers.get("slew", 1.0) <= 0:
        raise DermisError("slew must be above zero", where=place, value=numbers["slew"], limit="> 0")
    return Channel(name, unit, actuator=actuator, **numbers)


def _table(body: str, columns: int, where: str, first_line: int) -> Array:
    """Parse the rows; every one must have all columns, and nothing but finite numbers."""
    if not body:
        return np.empty((0, columns))
    lines = body[:-1].split("\n")
    for number, line in enumerate(lines, start=first_line):
        if line.count(",") != columns - 1 or not line:
            what = "an empty line" if not line else "a row of another length"
            raise DermisError(what, where=f"{where}, line {number}", value=f"{line.count(',') + 1} values",
                              limit=f"{columns} values")  # fmt: skip
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
    """Name the first cell that is not a finite number."""
    for number, line in enumerate(lines, start=first_line):
        for column, cell in enumerate(line.split(","), start=1):
            try:
                good = _NOT_NUMERIC.search(cell) is None and math.isfinite(float(cell))
            except ValueError:
                good = False
            if not good:
                raise DermisError("not a finite number", where=f"{where}, line {number}, column {column}",
                                  value=cell[:80])  # fmt: skip


def _check_rising(times: Array, where: str, first_line: int) -> None:
    stuck = np.flatnonzero(np.diff(times) <= 0)
    if len(stuck):
        i = int(stuck[0])
        raise DermisError("times do not rise", where=f"{where}, line {first_line + i + 1}", value=f"{times[i + 1]:g} s",
                          limit=f"> {times[i]:g} s")  # fmt: skip


def _on_grid(times: Array, rate: float) -> Array:
    """Return exact times where they are a regular grid at `rate` but for the nine digits written."""
    if len(times) == 0:
        return times
    start = np.rint(times[0] * rate)
    grid = (start + np.arange(len(times))) / rate
    return grid if (np.abs(grid - times) <= 5.001e-9 * np.abs(times)).all() else times


def _rate(text: str, line: int, *, where: str) -> float:
    rate = _number(_from_json(text, f"{where}, line {line}"), f"{where}, line {line}")
    if not rate > 0:
        raise DermisError("the rate must be above zero", where=f"{where}, line {line}", value=rate, limit="> 0 Hz")
    return rate


def _group(entries: Mapping[str, tuple[str, int]], group: str, where: str) -> dict[str, Any]:
    prefix = f"{group}."
    return {
        key.removeprefix(prefix): _from_json(text, f"{where}, line {line}")
        for key, (text, line) in entries.items()
        if key.startswith(prefix)
    }


def _from_json(text: str, where: str) -> Any:
    def refuse(name: str) -> Any:
        raise DermisError("not a finite number", where=where, value=name)

    try:
        return json.loads(text, parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        if isinstance(error, DermisError):
            raise
        raise DermisError("not a value", where=where, value=text[:80]) from error


def _number(value: Any, where: str) -> float:
    try:
        if not isinstance(value, bool) and isinstance(value, int | float) and math.isfinite(value):
            return float(value)
    except OverflowError:
        pass
    raise DermisError("not a finite number", where=where, value=str(value)[:80])


def _count(text: str, where: str) -> int:
    if not re.fullmatch(r"[0-9]{1,15}", text):
        raise DermisError("not a count", where=where, value=text[:80], limit="0 or more")
    return int(text)


def _is_own(key: str) -> bool:
    return key in OWN_KEYS or key.partition(".")[0] in OWN_GROUPS


def _unescaped(text: str, where: str) -> str:
    def one(match: re.Match[str]) -> str:
        code = match[1]
        if code.startswith("u") and len(code) == 5:
            return chr(int(code[1:], 16))
        if code not in _LONG:
            raise DermisError("an unknown escape", where=where, value=match[0], limit=r"\\, \n, \r, \t, \uXXXX")
        return _LONG[code]

    return _ESCAPE.sub(one, text) if "\\" in text else text

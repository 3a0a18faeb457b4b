"""Header of a CSV track: `# key: value` lines with its origin and device."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

from ..devices.spec import NAME, WIRE, Channel, DeviceSpec
from ..errors import DermisError
from ..foreign import json_of
from ..units import UNITS
from .command_track import CommandTrack
from .known_keys import FIRST_META, KEY, OWN_GROUPS, check_kind

VERSION = 1
MAGIC = "# dermis-track"
UNIT_SYSTEM = "SI"

EMPTY = '{"rest": 0}'  # value of a channel's line for a channel without limits

Entries = Mapping[str, tuple[str, int]]  # by key: the value, and the number of its line

_UNSAFE = re.compile("[\\\\\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff\ufeff]")
_ESCAPE = re.compile(r"\\(\\|n|r|t|u[0-9a-f]{4}|.?)", re.DOTALL)
_SHORT = {"\\": "\\\\", "\n": "\\n", "\r": "\\r", "\t": "\\t"}
_LONG = {"\\": "\\", "n": "\n", "r": "\r", "t": "\t"}


def entries_of(track: CommandTrack) -> Iterator[tuple[str, str]]:
    """Yield the keys and values of the header in the order of the file."""
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
    for key in sorted(spec.link_budget):
        yield f"wire.{key}", _json(spec.link_budget[key])
    for key in sorted(track.limited):
        yield f"limited.{key}", str(int(track.limited[key]))


def _json(value: Any) -> str:
    """Return a plain value as JSON on one line; floats are written exactly."""
    try:
        return json.dumps(value, ensure_ascii=False, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise DermisError("a device setting that the header cannot hold", value=repr(value)) from error


def escaped(value: str) -> str:
    return _UNSAFE.sub(lambda m: _SHORT.get(m[0], f"\\u{ord(m[0]):04x}"), value)


def split(text: str, where: str) -> tuple[dict[str, tuple[str, int]], str, str]:
    """Return the header's entries, the line of column names, and the rows.

    Each entry has its value and the number of its line. The rows are one text.

    Raises:
        DermisError: the text is not version 1, ends in the middle of a line, or has an invalid header.
    """
    first = text.partition("\n")[0]
    if first != f"{MAGIC} {VERSION}":
        _refuse_first_line(first, where)
    if not text.endswith("\n"):
        raise DermisError(
            "the file ends in the middle of a line",
            where=f"{where}, line {text.count(chr(10)) + 1}",
            remedy="Copy or export it again",
        )
    entries: dict[str, tuple[str, int]] = {}
    number, at = 2, len(first) + 1
    while text.startswith("#", at):
        end = text.index("\n", at)
        line, at = text[at:end], end + 1
        key, colon, value = line[1:].removeprefix(" ").partition(":")
        place = f"{where}, line {number}"
        if not colon or not KEY.fullmatch(key) or (value and not value.startswith(" ")):
            raise DermisError("not a header line", where=place, value=line[:80], limit="# key: value")
        if key in entries:
            raise DermisError("a key appears twice", where=place, value=key)
        entries[key] = (_unescaped(value.removeprefix(" "), place), number)
        number += 1
    heading, _, body = text[at:].partition("\n")
    if not heading:
        raise DermisError("the row of column names is missing", where=f"{where}, line {number}")
    return entries, heading, body


def _refuse_first_line(first: str, where: str) -> None:
    place = f"{where}, line 1"
    if first.startswith("\ufeff"):
        raise DermisError("starts with a byte order mark", where=place, remedy="Save as UTF-8 without it")
    match = re.fullmatch(rf"{MAGIC} ([0-9]{{1,9}})", first)
    if match:
        newer = int(match[1]) > VERSION
        raise DermisError(
            "written by a newer version of Dermis" if newer else "a version that does not exist",
            where=place,
            value=f"version {match[1]}",
            limit=f"version {VERSION}",
            remedy="Update Dermis" if newer else "",
        )
    raise DermisError("not a Dermis command track", where=place, value=first[:80], limit=f"{MAGIC} {VERSION}")


def spec_of(entries: Entries, heading: str, where: str) -> DeviceSpec:
    """Return the device that the header and the line of column names describe.

    Raises:
        DermisError: a key is missing or unknown, a value is invalid, or the columns do not fit the header.
    """
    for key in ("device", "kind", "spec_hash", "rate", "units"):
        if key not in entries:
            raise DermisError(f"'# {key}' is missing in the header", where=where)
    units, line = entries["units"]
    if units != UNIT_SYSTEM:
        raise DermisError("unknown system of units", where=f"{where}, line {line}", value=units, limit=UNIT_SYSTEM)
    for key, (_, line) in entries.items():
        if key.partition(".")[0] in OWN_GROUPS and not key.partition(".")[2]:
            raise DermisError("a name is missing after the group", where=f"{where}, line {line}", value=key)
    kind, line = entries["kind"]
    check_kind(kind, f"{where}, line {line}")
    for key, (_, line) in entries.items():
        if key.startswith("wire.") and key.removeprefix("wire.") not in WIRE:
            raise DermisError(
                "unknown field of the wire",
                where=f"{where}, line {line}",
                value=key,
                limit=", ".join(f"wire.{k}" for k in WIRE),
            )
    key = entries["device"][0]
    return DeviceSpec(
        key=key,
        name=entries.get("device_name", (key, 0))[0],
        kind=kind,
        rate=_rate(*entries["rate"], where=where),
        channels=_channels(entries, heading, where),
        parameters=_group(entries, "parameter", where),
        link_budget={k: _number(v, f"{where}, wire.{k}") for k, v in _group(entries, "wire", where).items()},
        stated_hash=entries["spec_hash"][0],
    )


def _channels(entries: Entries, heading: str, where: str) -> tuple[Channel, ...]:
    place = f"{where}, line {len(entries) + 2}"
    names = heading.split(",")
    if names[0] != "t_s":
        raise DermisError("the first column is not the time", where=place, value=names[0][:80], limit="t_s")
    stated = {k.removeprefix("channel."): k for k in entries if k.startswith("channel.")}
    channels: dict[str, Channel] = {}
    for number, name in enumerate(names[1:], start=2):
        match = re.fullmatch(rf"({NAME.pattern})\[([^\[\],]+)\]", name)
        if match is None or match[2] not in UNITS or UNITS[match[2]][0] != match[2]:
            raise DermisError(
                "not a column name",
                where=f"{place}, column {number}",
                value=name[:80],
                limit="name[unit] with an SI unit",
            )
        if match[1] in channels:
            raise DermisError("a column appears twice", where=f"{place}, column {number}", value=match[1])
        if match[1] not in stated:
            raise DermisError(
                f"'# channel.{match[1]}' is missing in the header",
                where=f"{place}, column {number}",
                remedy=f"Write '# channel.{match[1]}: {EMPTY}' for a channel without limits",
            )
        channels[match[1]] = _channel(match[1], match[2], *entries[stated.pop(match[1])], where=where)
    if stated:
        key = next(iter(stated.values()))
        raise DermisError("a channel without a column", where=f"{where}, line {entries[key][1]}", value=key)
    if not channels:
        raise DermisError("no column but the time", where=place)
    return tuple(channels.values())


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


def _rate(text: str, line: int, *, where: str) -> float:
    rate = _number(_from_json(text, f"{where}, line {line}"), f"{where}, line {line}")
    if not rate > 0:
        raise DermisError("the rate must be above zero", where=f"{where}, line {line}", value=rate, limit="> 0 Hz")
    return rate


def _group(entries: Entries, group: str, where: str) -> dict[str, Any]:
    prefix = f"{group}."
    return {
        key.removeprefix(prefix): _from_json(text, f"{where}, line {line}")
        for key, (text, line) in entries.items()
        if key.startswith(prefix)
    }


def _from_json(text: str, where: str) -> Any:
    try:
        return json_of(text, where)
    except DermisError as error:
        if error.code != "not-json":
            raise
        raise DermisError("not a JSON value", where=where, value=text[:80]) from error


def _number(value: Any, where: str) -> float:
    try:
        if not isinstance(value, bool) and isinstance(value, int | float) and math.isfinite(value):
            return float(value)
    except OverflowError:
        pass
    raise DermisError("not a finite number", where=where, value=str(value)[:80])


def count(text: str, where: str) -> int:
    if not re.fullmatch(r"[0-9]{1,15}", text):
        raise DermisError("not a count", where=where, value=text[:80], limit="0 or more")
    return int(text)


def _unescaped(text: str, where: str) -> str:
    def one(match: re.Match[str]) -> str:
        code = match[1]
        if code.startswith("u") and len(code) == 5:
            return chr(int(code[1:], 16))
        if code not in _LONG:
            raise DermisError("an unknown escape", where=where, value=match[0], limit=r"\\, \n, \r, \t, \uXXXX")
        return _LONG[code]

    return _ESCAPE.sub(one, text) if "\\" in text else text

"""Header of JSON, binary and WAV tracks: a track without its samples.

JSON and binary tracks are read back. Their headers are checked by the rules of the CSV header.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from ..foreign import is_newer
from .command_track import MAX_SAMPLES, CommandTrack
from .csv_header import count, spec_of
from .known_keys import KEY, check_known, check_limited, check_meta, is_own

LIMITS = ("low", "high", "slew", "rest", "actuator")  # fields of a channel besides its name and unit
FIELDS = ("schema", "device", "channels", "times", "meta", "limited")  # fields of every header
DEVICE = ("key", "name", "kind", "rate", "spec_hash", "parameters", "wire")  # fields of `device`


def header_of(track: CommandTrack, schema: str) -> dict[str, Any]:
    """Return the header of a track as plain JSON values.

    Args:
        schema: name and version of the file's format.

    Raises:
        DermisError: readers would refuse the kind of device, an entry of `meta` or a key of `limited`.
    """
    check_known(track, f"track of '{track.meta.get('finger', track.spec.key)}'")
    spec = track.spec
    return {
        "schema": schema,
        "device": {
            "key": spec.key,
            "name": spec.name,
            "kind": spec.kind,
            "rate": float(spec.rate),
            "spec_hash": spec.hash,
            "parameters": dict(spec.parameters),
            "wire": dict(spec.link_budget),
        },
        "channels": [{"name": c.name, "unit": c.unit, **{k: getattr(c, k) for k in LIMITS}} for c in spec.channels],
        "times": times_of(track),
        "meta": dict(track.meta),
        "limited": {k: int(v) for k, v in track.limited.items()},
    }


def times_of(track: CommandTrack) -> dict[str, Any]:
    """Return the field `times` of a header: the number of samples, and a grid.

    The grid is stated only if it gives the times to the last bit: sample k is at (first + k) / rate seconds.
    """
    times, rate = track.times, float(track.spec.rate)
    grid: dict[str, Any] = {"count": len(times)}
    if len(times):
        first = int(np.rint(times[0] * rate))
        if np.array_equal((first + np.arange(len(times))) / rate, times):
            grid |= {"first": first, "rate": rate}
    return grid


def text_of(header: Mapping[str, Any], *, ascii_only: bool = False) -> str:
    """Return a header as JSON text; equal headers give equal text.

    Args:
        ascii_only: whether characters outside ASCII are written as escapes.

    Raises:
        DermisError: a number is not finite, or JSON cannot hold a value.
    """
    try:
        text = json.dumps(header, ensure_ascii=ascii_only, allow_nan=False, sort_keys=True)
        text.encode("utf-8")  # fails for half of a surrogate pair, which only CSV can hold
        return text
    except (TypeError, ValueError) as error:
        raise DermisError("a setting that the file cannot hold", where="track", value=str(error)) from error


def check_schema(header: Any, schema: str, extra: tuple[str, ...], where: str) -> dict[str, Any]:
    """Return a header from a file if it has the right schema and fields.

    Args:
        header: value that was read from JSON.
        schema: name and version of the file's format.
        extra: names of the fields besides `FIELDS`.

    Raises:
        DermisError: the header is no object, has another schema or a newer version, or fields are missing or unknown.
    """
    if not isinstance(header, dict):
        raise DermisError("not a track", where=where, value=type(header).__name__, limit="a JSON object")
    found = header.get("schema")
    if found != schema:
        newer = is_newer(found, schema)
        raise DermisError(
            "written by a newer version of Dermis" if newer else "not a track of this format",
            where=where,
            value=str(found)[:80],
            limit=schema,
            remedy="Update Dermis" if newer else "",
        )
    _keys(header, (*FIELDS, *extra), where)
    return header


def track_of(header: Mapping[str, Any], times: Array, values: Array, where: str) -> CommandTrack:
    """Return a track from its header and samples.

    Args:
        times: [s], shape (n,).
        values: one column for each channel, in its unit, shape (n, channels).

    Raises:
        DermisError: the header is not well formed or does not fit the samples, or the times do not rise.
    """
    device = _mapping(header["device"], f"{where}, device")
    _keys(device, DEVICE, f"{where}, device")
    entries = {
        key: (_text(device[name], f"{where}, device {name}"), 0)
        for key, name in (("device", "key"), ("device_name", "name"), ("kind", "kind"), ("spec_hash", "spec_hash"))
    }
    entries |= {"rate": (json.dumps(device["rate"]), 0), "units": ("SI", 0)}
    for group, name in (("parameter", "parameters"), ("wire", "wire")):
        for key, value in _mapping(device[name], f"{where}, {name}").items():
            entries[f"{group}.{_key(key, where)}"] = (json.dumps(value), 0)
    heading = ["t_s"]
    if not isinstance(header["channels"], list):
        raise DermisError("the channels are no list", where=where)
    for channel in header["channels"]:
        _keys(_mapping(channel, f"{where}, channels"), ("name", "unit", *LIMITS), f"{where}, channels")
        name, unit = (_text(channel[k], f"{where}, channel {k}") for k in ("name", "unit"))
        entries[f"channel.{_key(name, where)}"] = (json.dumps({k: channel[k] for k in LIMITS}), 0)
        heading.append(f"{name}[{unit}]")
    spec = spec_of(entries, ",".join(heading), where)
    meta = {_key(k, where): _text(v, f"{where}, meta {k}") for k, v in _mapping(header["meta"], where).items()}
    own = [k for k in meta if is_own(k)]
    if own:
        raise DermisError("'meta' has a key that the format itself uses", where=where, value=own[0])
    for key, value in meta.items():
        check_meta(key, value, f"{where}, meta")
    limited = {
        _key(k, where): count(json.dumps(v), f"{where}, limited {k}")
        for k, v in _mapping(header["limited"], where).items()
    }
    names = {c.name: None for c in spec.channels}
    for key in limited:
        check_limited(key, names, f"{where}, limited")
    if values.shape != (len(times), len(spec.channels)):
        raise DermisError(
            "the samples do not fit times and channels",
            where=where,
            value=values.shape,
            limit=f"({len(times)}, {len(spec.channels)})",
        )
    stuck = np.flatnonzero(np.diff(times) <= 0)
    if len(stuck):
        raise DermisError(
            "times do not rise",
            where=f"{where}, sample {stuck[0] + 1}",
            value=f"{times[stuck[0] + 1]:g} s",
            limit=f"> {times[stuck[0]]:g} s",
        )
    return CommandTrack(spec, times, values, meta, limited)


def grid_of(header: Mapping[str, Any], where: str) -> tuple[int, Array | None]:
    """Return the number of samples, and the times that a header states.

    The times [s] have the shape (n,). They are None if the header states no grid.

    Raises:
        DermisError: the number or the grid is invalid, or a grid has too many samples.
    """
    times = _mapping(header["times"], f"{where}, times")
    number = count(json.dumps(times.get("count")), f"{where}, times count")
    if set(times) == {"count"}:
        return number, None
    _keys(times, ("count", "first", "rate"), f"{where}, times")
    first, rate = times["first"], times["rate"]
    good = isinstance(first, int) and not isinstance(first, bool) and abs(first) < 2**53
    if not good or not isinstance(rate, int | float) or isinstance(rate, bool) or not 0 < rate < 1e12:
        raise DermisError("the times are not evenly spaced", where=f"{where}, times", value=str(dict(times))[:80])
    if number > MAX_SAMPLES:
        raise DermisError("more samples than a track can hold", where=where, value=number, limit=str(MAX_SAMPLES))
    with np.errstate(over="ignore"):
        grid = (first + np.arange(number)) / float(rate)
    if not np.isfinite(grid).all():
        raise DermisError("the times are not evenly spaced", where=f"{where}, times", value=str(dict(times))[:80])
    return number, grid


def check_finite(track: CommandTrack) -> None:
    """Raise an error for a track that no format can store.

    Raises:
        DermisError: a time or a value is not finite, or the times do not rise.
    """
    where = f"track of '{track.meta.get('finger', track.spec.key)}'"
    if not np.isfinite(track.times).all() or not np.isfinite(track.values).all():
        raise DermisError(
            "a time or a value is not a finite number",
            where=where,
            remedy="Limit the track first: that replaces such values by the last finite one, and counts them",
        )
    if (np.diff(track.times) <= 0).any():
        raise DermisError("times do not rise", where=where)


def _keys(found: Mapping[str, Any], wanted: tuple[str, ...], where: str) -> None:
    if set(found) != set(wanted):
        raise DermisError(
            "fields missing or unknown", where=where, value=", ".join(sorted(map(str, set(found) ^ set(wanted))))[:200]
        )


def _mapping(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise DermisError("the value must be an object", where=where, value=str(value)[:80])
    return value


def _text(value: Any, where: str) -> str:
    if not isinstance(value, str):
        raise DermisError("the value must be a text", where=where, value=str(value)[:80])
    return value


def _key(key: str, where: str) -> str:
    if not KEY.fullmatch(key):
        raise DermisError(
            "a key that no header can hold", where=where, value=key[:80], limit="letters, digits, '_', '.', '-'"
        )
    return key

"""Writing, reading and cutting of tracks.

Tracks are written in all `FORMATS`. They are read from CSV, JSON and binary files.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from ..errors import DermisError, Finding
from ..files import opened
from .check import findings_of
from .command_track import CommandTrack
from .formats import FORMATS, Format

NO_SETTINGS: Mapping[str, Any] = MappingProxyType({})


class EmptyRange(DermisError):
    """Error for a range without duration or without a sample of the track."""


def write(
    track: CommandTrack,
    path: Path,
    form: str = "csv",
    *,
    force: bool = False,
    settings: Mapping[str, Any] = NO_SETTINGS,
) -> tuple[Finding, ...]:
    """Check a track and write it in one of the `FORMATS`; return all findings.

    The findings are those of the check and of the format.

    Args:
        form: name of the format in `FORMATS`.
        force: whether a track with errors is written. It is written as it is, and the entry `forced` of its header
            has the codes of the errors.
        settings: settings of the format, in SI, by name; settings that are left out have their defaults.

    Raises:
        DermisError: the format or a setting is unknown; the track has errors and `force` is False; the format cannot
            hold the track; the file cannot be written.
    """
    entry = format_of(form)
    strange = sorted(set(settings) - set(entry.settings))
    if strange:
        known = ", ".join(entry.settings) or "none"
        raise DermisError("the format has no such setting", where=form, value=", ".join(strange), limit=known)
    found = findings_of(track, levels=entry.levels)
    errors = [f for f in found if f.severity == "error"]
    if errors and not force:
        more = f" and {len(errors) - 1} more" if len(errors) > 1 else ""
        raise DermisError(
            f"not written: {errors[0].what}{more}",
            where=errors[0].where,
            value=errors[0].value,
            limit=errors[0].limit,
            remedy="Limit or correct the track, or force the export",
            code="track-refused",
        )
    if errors:
        codes = ", ".join(sorted({f"{f.code} ({f.count})" for f in errors}))
        track = replace(track, meta={**track.meta, "forced": codes})
    module = import_module(f".{entry.module}", __package__)
    if entry.settings:
        return (*found, *module.write(track, Path(path), settings))
    return (*found, *(module.write(track, Path(path)) or ()))


def read(path: Path) -> CommandTrack:
    """Read a CSV, JSON or binary track; the file's content tells the format.

    Raises:
        DermisError: the file cannot be read, has none of these formats, or is not well formed.
    """
    with opened(path) as (file, _):
        first = file.read(200)
    if first.startswith(b"\x89DRMT"):
        from . import binary

        return binary.read(Path(path))
    if first.lstrip()[:1] == b"{":
        from . import json_track

        return json_track.read(Path(path))
    from . import csv

    return csv.read(Path(path))


def format_of(form: str) -> Format:
    """Return a format by its name.

    Raises:
        DermisError: there is no format of this name.
    """
    if form not in FORMATS:
        raise DermisError("no such format", value=form, limit=", ".join(FORMATS))
    return FORMATS[form]


def cut(track: CommandTrack, first: float, last: float, *, name: str = "") -> CommandTrack:
    """Return the part of a track between two times; it starts at 0 s.

    Args:
        first, last: times of the track at which the part begins and ends [s], both included.
        name: name of the range; stored as `range` in `meta` if it is not empty.

    Raises:
        EmptyRange: the range has no duration, or no sample lies in it.
        DermisError: the range begins more than half a sample before the track, or ends a sample or more after it.
    """
    where = f"range '{name}'" if name else "range"
    rate = track.spec.rate
    # A track's last sample may be up to one sample before the end of the scene's range, so the part may end as late.
    early, late = 0.5 / rate, (1 - 1e-6) / rate
    if not (np.isfinite(first) and np.isfinite(last) and last > first):
        raise EmptyRange("the range is empty", where=where, value=f"{first:g} to {last:g} s")
    if len(track.times) == 0 or first < track.times[0] - early or last > track.times[-1] + late:
        held = f"{track.times[0]:g} to {track.times[-1]:g} s" if len(track.times) else "nothing"
        raise DermisError(
            "the range reaches beyond the track",
            where=where,
            value=f"{first:g} to {last:g} s",
            limit=held,
            remedy="Bake the whole range first",
        )
    kept = np.flatnonzero((track.times >= first - 1e-6 / rate) & (track.times <= last + 1e-6 / rate))
    if not len(kept):
        raise EmptyRange("no sample lies in the range", where=where, value=f"{first:g} to {last:g} s")
    times = track.times[kept] - track.times[kept[0]]
    even = np.arange(len(kept)) / rate
    if np.abs(even - times).max() < 1e-9:
        times = even
    meta: dict[str, Any] = dict(track.meta)
    if name:
        meta["range"] = name
    try:
        start, fps = float(meta["frame_range"].split()[0]), float(Fraction(meta["fps"]))
        meta["frame_range"] = f"{start + first * fps:g} {start + last * fps:g}"
    except (KeyError, ValueError, IndexError, ZeroDivisionError):
        meta.pop("frame_range", None)
    return replace(track, times=times, values=track.values[kept], meta=meta)

"""Checks of a track before it is exported or streamed.

They extend `CommandTrack.check`. Among its parameters, a device preset may state three limits of a channel:
`acceleration.CHANNEL` [unit/s^2], `bandwidth.CHANNEL` [Hz] and `resolution.CHANNEL` [unit]. A limit that is not stated
is not checked.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array
from ..errors import DermisError, Finding
from .command_track import CommandTrack

if TYPE_CHECKING:
    from ..devices.spec import DeviceSpec
    from ..presets import Library

SLACK = 1e-6  # relative tolerance of an acceleration: second differences of values that are rounded to nine digits
ABOVE = 0.01  # largest share of a channel's power above its bandwidth that gives no warning


def findings_of(track: CommandTrack, *, levels: int | None = None) -> tuple[Finding, ...]:
    """Return the findings about a track, those of its own check included.

    Codes beyond `CommandTrack.check`: 'acceleration', 'no-range' (errors), 'bandwidth', 'coarse',
    'quantisation' (warnings).

    Args:
        levels: number of counts that the format has for the range of a channel; None if the format does not quantise.

    Raises:
        DermisError: the preset states a limit that is not a number above zero.
    """
    found = list(track.check())
    if len(track.times) and np.isfinite(track.values).all() and (np.diff(track.times) > 0).all():
        for column in range(len(track.channels)):
            found += _accelerations(track, column)
            found += _spectrum(track, column)
            found += _steps(track, column, levels)
    return tuple(found)


def preset_findings(track: CommandTrack, library: Library, key: str = "") -> tuple[Finding, ...]:
    """Return the differences between a track and its device's preset.

    Codes: 'no-preset' (an info if the library has no such preset, a warning if the preset cannot be read),
    'other-preset', 'other-limits' (warnings), 'other-channels' (error).

    Args:
        library: presets on this computer.
        key: key of the preset; empty for the key that the track states.
    """
    where = f"device preset '{key or track.spec.key}'"
    preset = _preset(track, library, key)
    if preset is None or isinstance(preset, DermisError):
        why = "there is no such preset here" if preset is None else f"it cannot be read: {preset.what}"
        return (
            Finding(
                "info" if preset is None else "warning",
                "no-preset",
                f"{why}, so the track is judged by the limits in its own file",
                where=where,
            ),
        )
    found = []
    if track.spec.hash != preset.hash:
        found.append(
            Finding(
                "warning",
                "other-preset",
                "the track was made for another version of the preset",
                where=where,
                value=track.spec.hash,
                limit=preset.hash,
                remedy="Bake or export it again with the preset as it is now",
            )
        )
    own, theirs = ({c.name: c for c in spec.channels} for spec in (track.spec, preset))
    strangers = [n for n in own if n not in theirs or own[n].unit != theirs[n].unit]
    missing = [n for n, c in theirs.items() if c.actuator and n not in own]
    if strangers or missing:
        found.append(
            Finding(
                "error",
                "other-channels",
                "the track's channels are not those of the preset",
                where=where,
                value=", ".join(strangers + missing)[:200],
                limit=", ".join(theirs)[:200],
                remedy="Bake it again",
            )
        )
    for name in (n for n in own if n in theirs and n not in strangers):
        for field in ("low", "high", "slew", "rest", "actuator"):
            mine, wanted = getattr(own[name], field), getattr(theirs[name], field)
            if mine != wanted:
                found.append(
                    Finding(
                        "warning",
                        "other-limits",
                        f"the file states another '{field}' than the preset",
                        where=f"{where}, {name}",
                        value=mine,
                        limit=str(wanted),
                    )
                )
    return tuple(found)


def by_preset(track: CommandTrack, library: Library) -> CommandTrack:
    """Return a track with the limits of its device's preset.

    They replace the limits that the track's file states. A channel keeps the limits of the file if the preset has no
    channel of the same name and unit. The track is not changed if the library has no such preset, or if the preset
    cannot be read. Values, times and rate always stay.
    """
    preset = _preset(track, library)
    if preset is None or isinstance(preset, DermisError):
        return track
    theirs = {(c.name, c.unit): c for c in preset.channels}
    channels = tuple(theirs.get((c.name, c.unit), c) for c in track.spec.channels)
    parameters = dict(preset.parameters)
    # The round range may name a channel that the track does not have.
    if not {c.name for c in preset.channels} <= {c.name for c in channels}:
        parameters = {k: v for k, v in parameters.items() if not k.startswith("range_disc")}
    spec = replace(preset, rate=track.spec.rate, channels=channels, parameters=parameters)
    return replace(track, spec=spec)


def _preset(track: CommandTrack, library: Library, key: str = "") -> DeviceSpec | DermisError | None:
    key = key or track.spec.key
    if key not in {entry.key for entry in library.list("devices")}:
        return None
    try:
        return library.device(key)
    except DermisError as error:
        return error


def _stated(track: CommandTrack, kind: str, column: int) -> float | None:
    value: Any = track.spec.parameters.get(f"{kind}.{track.channels[column].name}")
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0:
        raise DermisError(f"the {kind} must be one number above zero", where=_place(track, column), value=value)
    return float(value)


def _accelerations(track: CommandTrack, column: int) -> Iterator[Finding]:
    limit = _stated(track, "acceleration", column)
    if limit is None or len(track.times) < 3:
        return
    speed = np.diff(track.values[:, column]) / np.diff(track.times)
    found = np.abs(np.diff(speed)) / (0.5 * (track.times[2:] - track.times[:-2]))
    bad = np.flatnonzero(found > limit * (1 + SLACK))
    if len(bad):
        first, unit = track.times[bad[0] + 1], track.channels[column].unit
        yield Finding(
            "error",
            "acceleration",
            "accelerates faster than the channel can",
            where=f"{_place(track, column)}, first at {first:.6g} s",
            value=float(found.max()),
            limit=f"{limit:g} {unit}/s^2",
            count=len(bad),
        )


def _spectrum(track: CommandTrack, column: int) -> Iterator[Finding]:
    limit = _stated(track, "bandwidth", column)
    values: Array = track.values[:, column]
    if limit is None or len(values) < 8 or np.ptp(values) == 0:
        return
    # The discrete Fourier transform sees a step from the last value to the first. The window suppresses it.
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values)))) ** 2
    step = track.duration / (len(values) - 1)
    share = float(power[np.fft.rfftfreq(len(values), step) > limit].sum() / power.sum()) if power.sum() else 0.0
    if share > ABOVE:
        yield Finding(
            "warning",
            "bandwidth",
            "part of the signal is faster than the channel can follow",
            where=_place(track, column),
            value=f"{100 * share:.3g} % of its power",
            limit=f"{limit:g} Hz",
        )


def _steps(track: CommandTrack, column: int, levels: int | None) -> Iterator[Finding]:
    channel = track.channels[column]
    if levels is None or not channel.actuator:
        return
    if channel.low is None or channel.high is None or not channel.high > channel.low:
        yield Finding(
            "error",
            "no-range",
            "a channel without a range cannot be written as counts",
            where=_place(track, column),
            remedy="Give it 'low' and 'high' in the device preset",
        )
        return
    step = (channel.high - channel.low) / (levels - 1)
    resolution = _stated(track, "resolution", column)
    if resolution is not None and step > resolution:
        yield Finding(
            "warning",
            "coarse",
            "the format's counts are coarser than the device",
            where=_place(track, column),
            value=f"{step:.3g} {channel.unit}",
            limit=f"{resolution:g} {channel.unit}",
        )
    moves = float(np.ptp(track.values[:, column]))
    if 0 < moves < 16 * step:
        yield Finding(
            "warning",
            "quantisation",
            "the track moves by less than sixteen counts",
            where=_place(track, column),
            value=f"{moves:.3g} {channel.unit}",
            limit=f">= {16 * step:.3g} {channel.unit}",
        )


def _place(track: CommandTrack, column: int) -> str:
    owner = f"finger '{track.meta['finger']}', " if "finger" in track.meta else ""
    return f"{owner}{track.spec.key}, {track.channels[column].name}"

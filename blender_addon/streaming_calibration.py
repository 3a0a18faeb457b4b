"""Calibration in Blender: zero, gain and limits of each actuator, tried out under way, saved apart or taken back.

A calibration belongs to one built device, and each finger wears its own: two of one preset have a calibration each.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from . import handlers, streaming, streaming_tracks
from .preferences import core_module, library

_FIELDS = ("name", "unit", "jog", "zero", "gain", "use_limits", "low", "high")

_Channels = list[dict[str, Any]]


@dataclass(frozen=True)
class _Before:
    """What a calibration in progress goes back to."""

    mode: str
    file: str
    of: str
    channels: _Channels
    shelf: list[tuple[str, str, _Channels]]


_restoring = False
_before: dict[int, _Before] = {}  # by session uid of the scene


def calibration_of(scene: bpy.types.Scene, key: str) -> Any:
    """Return the calibration that the settings hold.

    Raises:
        DermisError: a number that cannot be.
    """
    spec = library().device(key)
    made = core_module("calibration").Calibration.of(spec)
    for channel in scene.dermis_stream.channels:
        if channel.name not in {c.name for c in spec.channels}:
            continue
        limits = {"low": channel.low, "high": channel.high} if channel.use_limits else {}
        if channel.zero != 0.0 or channel.gain != 1.0 or limits:
            made = made.with_entry(channel.name, zero=channel.zero, gain=channel.gain, **limits)
    return made


def begin_calibration(scene: bpy.types.Scene) -> None:
    """Remember the calibration, so that cancelling brings it back, and turn to moving by hand."""
    settings = scene.dermis_stream
    with suppress(core_module("errors").DermisError):  # without a device there is nothing to list
        fill_channels(scene)
    shelf = [(e.name, e.file, [_plain(c) for c in e.channels]) for e in settings.shelf]
    before = _Before(settings.mode, settings.calibration_file, settings.channels_of, _listed(scene), shelf)
    _before.setdefault(scene.session_uid, before)
    settings.mode = "jog"


def calibrating(scene: bpy.types.Scene) -> bool:
    """Tell whether a calibration of this scene can be cancelled."""
    return scene.session_uid in _before


def restoring() -> bool:
    """Tell whether settings are being put back, so that half of them are not passed on."""
    return _restoring


def cancel_calibration(scene: bpy.types.Scene) -> None:
    """Bring back what was there when the scene's calibration began; a device under way blends back to it."""
    before = _before.pop(scene.session_uid, None)
    if before is None:
        return
    settings = scene.dermis_stream
    with _quietly(scene):
        settings.shelf.clear()
        for name, file, channels in before.shelf:
            _shelve(scene, name, file, channels)
        settings.channels_of, settings.calibration_file = before.of, before.file
        _fill(settings.channels, before.channels)
        settings.mode = before.mode
    streaming.changed()


def forget() -> None:
    """Forget calibrations that were begun: another file is opened."""
    _before.clear()


def save_calibration(scene: bpy.types.Scene, path: Path) -> None:
    """Write the calibration to a file of its own.

    Raises:
        DermisError: a number that cannot be, or the file cannot be written.
    """
    settings = scene.dermis_stream
    key = settings.channels_of.rpartition(": ")[2] or streaming_tracks.device_key(scene)
    calibration_of(scene, key).save(path)
    settings.calibration_file = str(path)
    _before.pop(scene.session_uid, None)


def load_calibration(scene: bpy.types.Scene, path: Path) -> tuple[Any, ...]:
    """Read a calibration into the settings; return findings.

    Raises:
        DermisError: the file cannot be read, or is for another device.
    """
    made = core_module("calibration").Calibration.load(path)
    key = streaming_tracks.device_key(scene)
    spec = library().device(key)
    made.for_spec(spec)  # refuses what does not fit
    fill_channels(scene)
    fresh = []
    for plain in _listed(scene):
        entry = made.entries.get(plain["name"])
        plain |= {"zero": 0.0, "gain": 1.0, "use_limits": False}
        if entry is not None:
            own = spec.channel(plain["name"])
            low, high = (next((v for v in pair if v is not None), 0.0)
                         for pair in ((entry.low, own.low), (entry.high, own.high)))  # fmt: skip
            limited = entry.low is not None or entry.high is not None
            plain |= {"zero": entry.zero, "gain": entry.gain, "use_limits": limited, "low": low, "high": high}
        fresh.append(plain)
    _restore(scene, fresh)
    scene.dermis_stream.calibration_file = str(path)
    return tuple(made.findings(spec))


def advice(scene: bpy.types.Scene) -> str:
    """Return what a person should know where the device that is listed has no calibration, but its like has one."""
    settings = scene.dermis_stream
    key = settings.channels_of.rpartition(": ")[2]
    like = [e.name for e in settings.shelf
            if e.name.rpartition(": ")[2] == key and any(_calibrated(_plain(c)) for c in e.channels)]  # fmt: skip
    if not like or any(map(_calibrated, _listed(scene))):
        return ""
    return f"{settings.channels_of} has no calibration; that of {like[0]} is kept for it alone"


def fill_channels(scene: bpy.types.Scene) -> None:
    """List the actuators of the finger's device that the settings speak of, with the calibration of that very device.

    What the list held for another finger's device is put by, and comes back with it. A list that belongs to nobody yet
    is taken over.

    Raises:
        DermisError: there is no device.
    """
    settings, name = scene.dermis_stream, streaming_tracks.device_name(scene)
    wanted = [c for c in library().device(streaming_tracks.device_key(scene)).channels if c.actuator]
    owner, listed, file = settings.channels_of, _listed(scene), settings.calibration_file
    if owner == name and [c["name"] for c in listed] == [c.name for c in wanted]:
        return
    known = listed
    with _quietly(scene):
        if owner not in ("", name):
            _shelve(scene, owner, file, listed)
            at = settings.shelf.find(name)
            known = [_plain(c) for c in settings.shelf[at].channels] if at >= 0 else []
            settings.calibration_file = settings.shelf[at].file if at >= 0 else ""
            if at >= 0:
                settings.shelf.remove(at)
        old = {c["name"]: c for c in known}
        fresh = []
        for channel in wanted:
            low, high = (0.0 if v is None else v for v in (channel.low, channel.high))
            new = {"name": channel.name, "unit": channel.unit, "jog": channel.rest, "zero": 0.0, "gain": 1.0,
                   "use_limits": False, "low": low, "high": high}  # fmt: skip
            fresh.append(old.get(channel.name, new))
        _fill(settings.channels, fresh)
        settings.channels_of = name


def centre(scene: bpy.types.Scene, preset: Any, key: str) -> None:
    """Put every actuator's position by hand to its rest."""
    spec = core_module("devices.spec").from_preset(key, preset)
    rest = {c.name: c.rest for c in spec.channels}
    _restore(scene, [{**c, "jog": rest.get(c["name"], 0.0)} for c in _listed(scene)])


def _plain(channel: Any) -> dict[str, Any]:
    return {name: getattr(channel, name) for name in _FIELDS}


def _listed(scene: bpy.types.Scene) -> _Channels:
    return [_plain(channel) for channel in scene.dermis_stream.channels]


def _calibrated(plain: dict[str, Any]) -> bool:
    return bool(plain["zero"] != 0.0 or plain["gain"] != 1.0 or plain["use_limits"])


def _restore(scene: bpy.types.Scene, plain: _Channels) -> None:
    with _quietly(scene):
        _fill(scene.dermis_stream.channels, plain)
    streaming.changed()


@contextmanager
def _quietly(scene: bpy.types.Scene) -> Iterator[None]:
    """Change settings that belong together without passing half of them on."""
    global _restoring
    handlers.expect(scene.name)
    before, _restoring = _restoring, True
    try:
        yield
    finally:
        _restoring = before


def _shelve(scene: bpy.types.Scene, name: str, file: str, plain: _Channels) -> None:
    entry = scene.dermis_stream.shelf.add()
    entry.name, entry.file = name, file
    _fill(entry.channels, plain)


def _fill(channels: Any, plain: _Channels) -> None:
    channels.clear()
    for fields in plain:
        channel = channels.add()
        for name, value in fields.items():
            setattr(channel, name, value)

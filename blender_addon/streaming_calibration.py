"""Calibration in Blender: zero, gain and limits of each actuator, tried out under way, saved apart or taken back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from . import handlers, streaming, streaming_tracks
from .preferences import core_module, library

_FIELDS = ("name", "unit", "jog", "zero", "gain", "use_limits", "low", "high")

_restoring = False
_saved: tuple[str, list[dict[str, Any]]] | None = None  # mode and channels as they were before


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
    global _saved
    settings = scene.dermis_stream
    _saved = settings.mode, [_plain(channel) for channel in settings.channels]
    settings.mode = "jog"


def calibrating() -> bool:
    """Tell whether a calibration can be cancelled."""
    return _saved is not None


def restoring() -> bool:
    """Tell whether settings are being put back, so that half of them are not passed on."""
    return _restoring


def cancel_calibration(scene: bpy.types.Scene) -> None:
    """Bring back what was there when the calibration began; a device under way blends back to it."""
    global _saved
    saved, _saved = _saved, None
    if saved is not None:
        _restore(scene, saved[1])
        scene.dermis_stream.mode = saved[0]


def forget() -> None:
    """Forget a calibration that was begun: another file is opened."""
    global _saved
    _saved = None


def save_calibration(scene: bpy.types.Scene, path: Path) -> None:
    """Write the calibration to a file of its own.

    Raises:
        DermisError: a number that cannot be, or the file cannot be written.
    """
    global _saved
    calibration_of(scene, streaming_tracks.device_key(scene)).save(path)
    scene.dermis_stream.calibration_file = str(path)
    _saved = None


def load_calibration(scene: bpy.types.Scene, path: Path) -> tuple[Any, ...]:
    """Read a calibration into the settings; return findings.

    Raises:
        DermisError: the file cannot be read, or is for another device.
    """
    made = core_module("calibration").Calibration.load(path)
    key = streaming_tracks.device_key(scene)
    spec = library().device(key)
    made.for_spec(spec)  # refuses what does not fit
    fill_channels(scene, library().load("devices", key), key)
    fresh = []
    for channel in scene.dermis_stream.channels:
        entry, plain = made.entries.get(channel.name), _plain(channel)
        plain |= {"zero": 0.0, "gain": 1.0, "use_limits": False}
        if entry is not None:
            own = spec.channel(channel.name)
            low, high = (next((v for v in pair if v is not None), 0.0)
                         for pair in ((entry.low, own.low), (entry.high, own.high)))  # fmt: skip
            limited = entry.low is not None or entry.high is not None
            plain |= {"zero": entry.zero, "gain": entry.gain, "use_limits": limited, "low": low, "high": high}
        fresh.append(plain)
    _restore(scene, fresh)
    scene.dermis_stream.calibration_file = str(path)
    return tuple(made.findings(spec))


def fill_channels(scene: bpy.types.Scene, preset: Any, key: str) -> None:
    """Make the list of actuators fit the device; what was set for channels of the same name stays."""
    spec = core_module("devices.spec").from_preset(key, preset)
    wanted = [c for c in spec.channels if c.actuator]
    channels = scene.dermis_stream.channels
    if [c.name for c in channels] == [c.name for c in wanted]:
        return
    old = {c.name: _plain(c) for c in channels}
    fresh = []
    for channel in wanted:
        low, high = (0.0 if v is None else v for v in (channel.low, channel.high))
        new = {"name": channel.name, "unit": channel.unit, "jog": channel.rest, "zero": 0.0, "gain": 1.0,
               "use_limits": False, "low": low, "high": high}  # fmt: skip
        fresh.append(old.get(channel.name, new))
    _restore(scene, fresh)


def centre(scene: bpy.types.Scene, preset: Any, key: str) -> None:
    """Put every actuator's position by hand to its rest."""
    spec = core_module("devices.spec").from_preset(key, preset)
    rest = {c.name: c.rest for c in spec.channels}
    _restore(scene, [{**_plain(c), "jog": rest.get(c.name, 0.0)} for c in scene.dermis_stream.channels])


def _plain(channel: Any) -> dict[str, Any]:
    return {name: getattr(channel, name) for name in _FIELDS}


def _restore(scene: bpy.types.Scene, plain: list[dict[str, Any]]) -> None:
    global _restoring
    handlers.expect(scene.name)
    channels = scene.dermis_stream.channels
    _restoring = True
    try:
        channels.clear()
        for fields in plain:
            channel = channels.add()
            for name, value in fields.items():
                setattr(channel, name, value)
    finally:
        _restoring = False
    streaming.changed()

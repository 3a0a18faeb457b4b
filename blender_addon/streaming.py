"""Blender's side of streaming: one sender process, a timer that gives it signs of life, and the status it reports.

Nothing here waits, nothing connects by itself, and everything ends with the file, the add-on and Blender.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import bpy
from bpy.app.handlers import persistent

from . import streaming_calibration, streaming_tracks
from .preferences import core_module, library

BEAT = 0.02  # between two signs of life [s]
REDRAW = 5  # beats between two redraws of the panel

_client: Any = None
_scene = 0  # session uid of the scene that streams
_status: dict[str, Any] = {}
_beats = 0
_ports: list[tuple[str, str]] = []


def connected() -> bool:
    """Tell whether there is a sender."""
    return _client is not None


def streams(scene: bpy.types.Scene) -> bool:
    """Tell whether there is a sender, and this is its scene."""
    return _client is not None and _scene == scene.session_uid


@cache
def caution(protocol: str) -> str:
    """Return what a person has to know of boards that speak a protocol, before a finger goes in; '' for nothing."""
    adapter = core_module("stream.adapter")
    module, name, _ = adapter.NAMES[protocol]
    return str(getattr(core_module(f"stream.{module}"), name).caution)


def status() -> dict[str, Any]:
    """Return how things stood at the last beat; never asks anybody."""
    return _status or {"state": "disconnected", "words": "", "armed": False}


def found_ports() -> list[tuple[str, str]]:
    """Return the ports of the last rescan."""
    return _ports


def rescan() -> int:
    """Look for serial ports; return how many there are. Takes up to seconds: for a button, never for drawing."""
    global _ports
    _ports = core_module("stream.serial_port").ports()
    return len(_ports)


def connect(scene: bpy.types.Scene) -> None:
    """Start a sender and let it connect. Nothing is armed by this.

    Raises:
        DermisError: no device, a setting that cannot be, or the process cannot be started.
    """
    global _client, _scene, _status
    close()
    settings = scene.dermis_stream
    key = streaming_tracks.device_key(scene)
    preset = library().load("devices", key)
    streaming_calibration.fill_channels(scene, preset, key)
    calibration = streaming_calibration.calibration_of(scene, key)
    _client = core_module("stream.client").SenderClient()
    _scene = scene.session_uid
    _status = {"state": "connecting", "words": "", "armed": False}
    _client.connect(settings.url, settings.protocol, key, preset, calibration=calibration.dumps(), **_wish(scene))
    beat()
    if not bpy.app.background and not bpy.app.timers.is_registered(_on_timer):
        bpy.app.timers.register(_on_timer, first_interval=BEAT, persistent=True)


def close() -> None:
    """Stop, disconnect and end the sender. Safe to call at any time."""
    global _client, _status
    if bpy.app.timers.is_registered(_on_timer):
        bpy.app.timers.unregister(_on_timer)
    client, _client = _client, None
    if client is not None:
        client.close()
    _status = {}
    streaming_tracks.forget()


def arm(scene: bpy.types.Scene) -> None:
    """Let the device move, because a person asked for it.

    Raises:
        DermisError: nothing is connected, or there is nothing to play.
    """
    if _client is None:
        raise core_module("errors").DermisError("not connected", remedy="Connect first")
    _client.set(**_wish(scene))
    beat()
    _client.arm()


def disarm() -> None:
    """Bring the device to its safe state."""
    if _client is not None:
        _client.disarm()


def stop() -> None:
    """Safe state, now."""
    if _client is not None:
        _client.stop()


def changed() -> None:
    """Pass changed settings on to a running sender; a sender that does not run takes them when it starts."""
    scene = _streaming_scene()
    if _client is None or scene is None or streaming_calibration.restoring():
        return
    try:
        made = streaming_calibration.calibration_of(scene, streaming_tracks.device_key(scene))
        _client.set(**_wish(scene), calibration=made.dumps())
    except core_module("errors").DermisError as error:
        _status["words"] = str(error)


def beat() -> None:
    """Give a sign of life with what Blender shows; read the status."""
    global _status
    scene = _streaming_scene()
    if _client is None or scene is None:
        return
    settings = scene.dermis_stream
    playing = any(screen.is_animation_playing for screen in bpy.data.screens)
    first, fps = streaming_tracks.origin(scene)
    moment = (float(scene.frame_current_final) - first) / fps
    values: tuple[float, ...] = ()
    if settings.mode == "follow":
        from . import streaming_twin

        values = streaming_twin.shown_values(scene)
    _client.beat(playing=playing, time=moment, values=values)
    _status = _client.status()


def _wish(scene: bpy.types.Scene) -> dict[str, Any]:
    """Return the fields of the sender's wish that the settings decide."""
    s = scene.dermis_stream
    jog = {c.name: c.jog for c in s.channels} if s.mode == "jog" else {}
    names = ("mode", "offset", "look_ahead", "ramp", "stall", "play_on", "reconnect")
    return {**{name: getattr(s, name) for name in names}, "jog": jog, "track": streaming_tracks.track_path(scene),
            "screen": bpy.path.abspath(s.screen_file) if s.screen_file else ""}  # fmt: skip


def _streaming_scene() -> bpy.types.Scene | None:
    return next((s for s in bpy.data.scenes if s.session_uid == _scene), None)


def _on_timer() -> float | None:
    global _beats
    if _client is None:
        return None
    before = _status.get("state")
    beat()
    _beats += 1
    if _beats % REDRAW == 0 or before != _status.get("state"):
        for window in bpy.context.window_manager.windows:
            for area in window.screen.areas:
                if area.type == "VIEW_3D":
                    area.tag_redraw()
    return BEAT


@persistent
def _on_load(*_: Any) -> None:
    close()
    streaming_tracks.forget(files=True)
    streaming_calibration.forget()


_keys: list[tuple[Any, Any]] = []


def register() -> None:
    """Watch for files being opened; put the stop on its key."""
    if _on_load not in bpy.app.handlers.load_pre:
        bpy.app.handlers.load_pre.append(_on_load)
    configuration = bpy.context.window_manager.keyconfigs.addon if bpy.context.window_manager else None
    if configuration is not None:
        keymap = configuration.keymaps.new(name="Window", space_type="EMPTY")
        _keys.append((keymap, keymap.keymap_items.new("dermis.stream_stop", "ESC", "PRESS", shift=True)))


def unregister() -> None:
    """End streaming with the add-on."""
    while _keys:
        keymap, item = _keys.pop()
        keymap.keymap_items.remove(item)
    _on_load()
    if _on_load in bpy.app.handlers.load_pre:
        bpy.app.handlers.load_pre.remove(_on_load)

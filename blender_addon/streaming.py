"""Blender's side of streaming: one sender process, a timer that gives it signs of life, and the status it reports.

Nothing here waits, nothing connects by itself, and everything ends with the file, the add-on and Blender.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import bpy
from bpy.app.handlers import persistent

from . import streaming_calibration, streaming_hold, streaming_tracks
from .preferences import core_module, library

BEAT = 0.02  # between two signs of life [s]
REDRAW = 5  # beats between two redraws of the panel

_client: Any = None
_scene = 0  # session uid of the scene that streams
_status: dict[str, Any] = {}
_note = ""  # what Blender's side has to say beside the sender
_published: tuple[float | None, tuple[float, ...]] = (None, ())  # time and values of the last beat
_beats = 0
_restored = False  # undo or redo has brought other settings, and the sender has not heard of them
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
    streaming_calibration.fill_channels(scene)
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
    global _client, _note, _published, _restored, _status
    if bpy.app.timers.is_registered(_on_timer):
        bpy.app.timers.unregister(_on_timer)
    client, _client = _client, None
    if client is not None:
        client.close()
    _status, _note, _published, _restored = {}, "", (None, ()), False
    streaming_tracks.forget()


def arm(scene: bpy.types.Scene) -> None:
    """Let the device move, because a person asked for it.

    Raises:
        DermisError: nothing is connected, or something steps through the frames.
    """
    if _client is None:
        raise core_module("errors").DermisError("not connected", remedy="Connect first")
    if streaming_hold.held():
        raise core_module("errors").DermisError("nothing is armed while something steps through the frames",
                                                remedy="Let the bake or the render end, or cancel it")  # fmt: skip
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
    global _note
    scene = _streaming_scene()
    if _client is None or scene is None or streaming_calibration.restoring():
        return
    try:
        streaming_calibration.fill_channels(scene)
        made = streaming_calibration.calibration_of(scene, streaming_tracks.device_key(scene))
        _client.set(**_wish(scene), calibration=made.dumps())
        _note = ""
    except core_module("errors").DermisError as error:
        _note = str(error)


def beat() -> None:
    """Give a sign of life with what Blender shows; read the status.

    While something steps through the frames, what was published last holds: nobody plays then, and nobody scrubs.
    """
    global _published, _restored, _status
    if _client is None:
        return
    scene = _streaming_scene()
    if scene is None:  # removed, or undone
        close()
        return
    if _restored:
        _restored = False
        changed()  # the device blends over to what the panel now says
    playing = False
    if not streaming_hold.held():
        if streaming_tracks.outdated(scene):
            changed()  # before the time is taken: it counts from the start of the track that the sender has
        playing = any(screen.is_animation_playing for screen in bpy.data.screens)
        _published = _shown(scene)
    moment, values = _published
    _client.beat(playing=playing, time=moment, values=values)
    _status = _client.status()
    if _note:
        _status["words"] = "; ".join(filter(None, (_note, _status.get("words"))))


def _shown(scene: bpy.types.Scene) -> tuple[float, tuple[float, ...]]:
    """Return the track's time of the frame that is shown, and in the mode 'follow' the values."""
    first, fps = streaming_tracks.origin(scene)
    moment = (float(scene.frame_current_final) - first) / fps
    if scene.dermis_stream.mode != "follow":
        return moment, ()
    from . import streaming_twin

    return moment, streaming_twin.shown_values(scene)


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
    if _client is None:
        return None
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


@persistent
def _on_history(*_: Any) -> None:
    # Settings came back without a word. The next beat passes them on: what is changed in here belongs to no step of
    # undo, and the scene that Blender restored is not evaluated yet.
    global _restored
    _restored = _client is not None


_keys: list[tuple[Any, Any]] = []


def register() -> None:
    """Watch for files being opened, undo and renders; put the stop on its key."""
    for found, function in _table():
        if function not in found:
            found.append(function)
    streaming_hold.register()
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
    streaming_hold.unregister()
    for found, function in _table():
        if function in found:
            found.remove(function)


def _table() -> tuple[tuple[list[Any], Any], ...]:
    on = bpy.app.handlers
    return (on.load_pre, _on_load), (on.undo_post, _on_history), (on.redo_post, _on_history)

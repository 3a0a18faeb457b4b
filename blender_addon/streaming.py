"""Blender's side of streaming: one sender process, a timer that gives it signs of life, and the status it reports.

Nothing here waits, nothing connects by itself, and everything ends with the file, the add-on and Blender.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
from bpy.app.handlers import persistent

from . import results
from .preferences import core_module, library

BEAT = 0.02  # between two signs of life [s]
REDRAW = 5  # beats between two redraws of the panel

_client: Any = None
_scene = 0  # session uid of the scene that streams
_status: dict[str, Any] = {}
_beats = 0
_ports: list[tuple[str, str]] = []
_track_files: list[Path] = []
_file_track: Any = None  # of `track_file`: (path, CommandTrack)
_written: tuple[Any, ...] = ()
_saved_channels: list[dict[str, Any]] | None = None


def connected() -> bool:
    """Tell whether there is a sender."""
    return _client is not None


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


def output_names() -> list[str]:
    """Return 'finger: device' of every output of the current bake."""
    result = results.current(bpy.context.scene)
    return [f"{o.finger}: {o.device}" for o in result.bake.outputs] if result is not None else []


def chosen_output(scene: bpy.types.Scene) -> Any:
    """Return the output that is to be played, or None."""
    result = results.current(scene)
    outputs = result.bake.outputs if result is not None else ()
    wanted = scene.dermis_stream.output
    return next((o for o in outputs if not wanted or f"{o.finger}: {o.device}" == wanted), None)


def device_key(scene: bpy.types.Scene) -> str:
    """Return the device preset that the settings speak of.

    Raises:
        DermisError: there is none.
    """
    if scene.dermis_stream.track_file:
        return str(load_file(scene).spec.key)
    output = chosen_output(scene)
    if output is not None:
        return str(output.device)
    for obj in scene.objects:
        if obj.dermis.role == "FINGER":
            for use in obj.dermis.finger.devices:
                if use.enabled and use.preset:
                    return str(use.preset)
    raise core_module("errors").DermisError("no device to stream to", where=scene.name,
                                            remedy="Give a finger a device, or choose a track file")  # fmt: skip


def load_file(scene: bpy.types.Scene) -> Any:
    """Return the command track of the settings' file.

    Raises:
        DermisError: it cannot be read.
    """
    global _file_track
    path = Path(bpy.path.abspath(scene.dermis_stream.track_file))
    key = (str(path), path.stat().st_mtime_ns if path.is_file() else 0)
    if _file_track is None or _file_track[0] != key:
        _file_track = (key, core_module("formats.export").read(path))
    return _file_track[1]


def connect(scene: bpy.types.Scene) -> None:
    """Start a sender and let it connect. Nothing is armed by this.

    Raises:
        DermisError: no device, a setting that cannot be, or the process cannot be started.
    """
    global _client, _scene, _status
    close()
    settings = scene.dermis_stream
    key = device_key(scene)
    preset = library().load("devices", key)
    _fill_channels(scene, preset, key)
    calibration = calibration_of(scene, key)
    _client = core_module("stream.client").SenderClient()
    _scene = scene.session_uid
    _status = {"state": "connecting", "words": "", "armed": False}
    _client.connect(settings.url, settings.protocol, key, preset, calibration=calibration.dumps(), **_wish(scene))
    beat()
    if not bpy.app.background and not bpy.app.timers.is_registered(_on_timer):
        bpy.app.timers.register(_on_timer, first_interval=BEAT, persistent=True)


def close() -> None:
    """Stop, disconnect and end the sender. Safe to call at any time."""
    global _client, _status, _written
    if bpy.app.timers.is_registered(_on_timer):
        bpy.app.timers.unregister(_on_timer)
    client, _client = _client, None
    if client is not None:
        client.close()
    _status, _written = {}, ()
    while _track_files:
        _track_files.pop().unlink(missing_ok=True)


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
    if _client is None or scene is None:
        return
    try:
        wish = _wish(scene)
        key = device_key(scene)
        wish["calibration"] = calibration_of(scene, key).dumps()
        if _client.status().get("armed"):
            wish.pop("calibration")  # it takes effect with the next connection; a device under way keeps its own
        _client.set(**wish)
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
    first, fps = _origin(scene)
    moment = (float(scene.frame_current_final) - first) / fps
    values: tuple[float, ...] = ()
    if settings.mode == "follow":
        values = _shown_values(scene)
    _client.beat(playing=playing, time=moment, values=values)
    _status = _client.status()


def preview(scene: bpy.types.Scene) -> Any:
    """Return what the twin shall show instead of bake and live preview, or None.

    What the device reports comes first; then a track that was loaded from a file.
    """
    settings = getattr(scene, "dermis_stream", None)
    if settings is None:
        return None
    reported = (_status.get("received") or {}).get("values")
    if reported is None and _status.get("pose"):
        reported = dict(zip(_status.get("names", ()), _status["pose"], strict=False))
    if _client is not None and settings.show_received and reported and _scene == scene.session_uid:
        return _preview_of(scene, reported, "device", "what the device reports")
    if settings.track_file and _file_track is not None:
        return _preview_of_file(scene, _file_track[1])
    return None


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
    """Remember the calibration, so that cancelling brings it back."""
    global _saved_channels
    _saved_channels = [_plain(channel) for channel in scene.dermis_stream.channels]


def calibrating() -> bool:
    """Tell whether a calibration can be cancelled."""
    return _saved_channels is not None


def cancel_calibration(scene: bpy.types.Scene) -> None:
    """Bring back what was there when the calibration began."""
    global _saved_channels
    if _saved_channels is not None:
        _restore(scene, _saved_channels)
    _saved_channels = None
    changed()


def save_calibration(scene: bpy.types.Scene, path: Path) -> None:
    """Write the calibration to a file of its own.

    Raises:
        DermisError: a number that cannot be, or the file cannot be written.
    """
    global _saved_channels
    calibration_of(scene, device_key(scene)).save(path)
    scene.dermis_stream.calibration_file = str(path)
    _saved_channels = None


def load_calibration(scene: bpy.types.Scene, path: Path) -> tuple[Any, ...]:
    """Read a calibration into the settings; return findings.

    Raises:
        DermisError: the file cannot be read, or is for another device.
    """
    made = core_module("calibration").Calibration.load(path)
    key = device_key(scene)
    spec = library().device(key)
    made.for_spec(spec)  # refuses what does not fit
    _fill_channels(scene, library().load("devices", key), key)
    for channel in scene.dermis_stream.channels:
        entry = made.entries.get(channel.name)
        channel.zero, channel.gain = (entry.zero, entry.gain) if entry else (0.0, 1.0)
        channel.use_limits = entry is not None and entry.low is not None and entry.high is not None
        if channel.use_limits:
            channel.low, channel.high = entry.low, entry.high
    scene.dermis_stream.calibration_file = str(path)
    return tuple(made.findings(spec))


def _wish(scene: bpy.types.Scene) -> dict[str, Any]:
    """Return the fields of the sender's wish that the settings decide."""
    s = scene.dermis_stream
    jog = {c.name: c.jog for c in s.channels} if s.mode == "jog" else {}
    names = ("mode", "offset", "look_ahead", "ramp", "stall", "play_on", "reconnect")
    return {**{name: getattr(s, name) for name in names}, "jog": jog, "track": _track_path(scene),
            "screen": bpy.path.abspath(s.screen_file) if s.screen_file else ""}  # fmt: skip


def _track_path(scene: bpy.types.Scene) -> str:
    """Return a file with the track to be played; the bake's is written anew when it has changed."""
    global _written
    if scene.dermis_stream.track_file:
        load_file(scene)
        return str(Path(bpy.path.abspath(scene.dermis_stream.track_file)))
    output = chosen_output(scene)
    if output is None:
        return ""
    key = (id(output), scene.session_uid)
    if not _written or _written[0] != key:
        handle, name = tempfile.mkstemp(prefix="dermis-stream-", suffix=".dtrack")
        with open(handle, "wb") as file:
            file.write(core_module("formats.binary").dumps(output.track))
        _track_files.append(Path(name))
        _written = (key, name, output)  # the output too, or its id could be another's tomorrow
    return str(_written[1])


def _origin(scene: bpy.types.Scene) -> tuple[float, float]:
    """Return the frame at which tracks start, and frames a second."""
    from .sampling import frame_range, frames_per_second

    result = results.current(scene)
    if result is not None and not scene.dermis_stream.track_file:
        return result.first, result.fps
    return float(frame_range(scene)[0]), float(frames_per_second(scene))


def _shown_values(scene: bpy.types.Scene) -> tuple[float, ...]:
    """Return what the preview shows for the channels on the wire, in their order."""
    from . import live

    names = _status.get("names") or ()
    shown = live.computed(scene)
    output = scene.dermis_stream.output
    for row in shown.rows if shown is not None else ():
        if (not output or output == f"{row.finger}: {row.device}") and all(n in row.values for n in names):
            return tuple(float(row.values[n]) for n in names)
    return ()


def _preview_of(scene: bpy.types.Scene, reported: dict[str, float], source: str, note: str) -> Any:
    """Return a preview with reported values in place of computed ones."""
    from . import live

    shown = live.computed(scene)
    if shown is None:
        return None
    wanted = scene.dermis_stream.output
    rows = []
    replaced = False
    for row in shown.rows:
        fits = set(reported) <= set(row.values) and (not wanted or wanted == f"{row.finger}: {row.device}")
        if replaced or not fits:
            rows.append(row)
            continue
        replaced = True
        values = {**row.values, **reported}
        if row.kind == "shear_tactor" and "pulley_1" in reported:
            spec = library().device(row.device)
            tactor = core_module("devices.shear_tactor").ShearTactor.from_spec(spec)
            place = tactor.forward([values["pulley_1"], values["pulley_2"]])
            values["tactor_x"], values["tactor_y"] = (float(v) for v in place)
        rows.append(replace(row, values=values))
    return live.Preview(shown.frame, source, note, tuple(rows)) if replaced else None


def _preview_of_file(scene: bpy.types.Scene, track: Any) -> Any:
    """Return the preview of a loaded track: on the finger that it names, or on the first one."""
    from . import live

    fingers = [o.name for o in scene.objects if o.dermis.role == "FINGER"]
    named = track.meta.get("finger", "")
    if not fingers:
        return None
    pipeline = core_module("pipeline")
    output = pipeline.Output(named if named in fingers else fingers[0], track.spec.key, track, {}, ())
    first, fps = _origin(scene)
    result = results.Result(pipeline.Bake((output,), (), {}, ""), fps, first, -1, ())
    frame = live.frame_of(scene)
    return live.Preview(frame, "file", "from a track file", (live.row_of(result, output, frame),))


def _fill_channels(scene: bpy.types.Scene, preset: Any, key: str) -> None:
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


def _plain(channel: Any) -> dict[str, Any]:
    return {n: getattr(channel, n) for n in ("name", "unit", "jog", "zero", "gain", "use_limits", "low", "high")}


def _restore(scene: bpy.types.Scene, plain: list[dict[str, Any]]) -> None:
    channels = scene.dermis_stream.channels
    channels.clear()
    for fields in plain:
        channel = channels.add()
        for name, value in fields.items():
            setattr(channel, name, value)


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
    global _file_track, _saved_channels
    close()
    _file_track = _saved_channels = None


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

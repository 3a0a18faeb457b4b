"""Blender's side of streaming: one sender process and its reported status.

A timer sends heartbeats to the sender. Nothing connects by itself. The stream ends when the file is closed, when the
add-on is disabled, and when Blender ends. Functions do not wait for the device, except `close`, which waits for a short
time.
"""

from __future__ import annotations

import os
import traceback
from typing import Any

import bpy

from .. import compat, loading, redraw
from .._core import DermisError, core
from ..preferences import library, user_folder
from . import (
    agreed_paths,
    board_identity,
    built_devices,
    calibration_rows,
    device_calibration,
    frame_hold,
    request_fields,
    streamed_track,
)

HEARTBEAT = 0.02  # [s] between two heartbeats
STILL = frozenset({"V", "Hz"})  # units of actuators that have no position
REDRAW = 5  # number of heartbeats between two redraws of the panel

_client: Any = None
_scene = 0  # session uid of the scene that streams
_preset = ""  # key of the device that is connected
_status: dict[str, Any] = {}
_note = ""  # the message of Blender's side; the sender has its own
_leaving = ""  # in words, the remaining work of closed senders, and why streams failed
_published: tuple[float | None, tuple[float, ...]] = (None, ())  # time and values of the last heartbeat
_mode = ""  # the scene's mode at the last heartbeat
_heartbeats = 0
_taken_up = False  # the sender has taken up the request to connect; before that, its state is 'disconnected'
_restored = False  # undo or redo has changed settings, and the sender does not have them yet
_ports: list[tuple[str, str]] = []
_boards: dict[str, str] = {}  # addresses of paired boards, by name
_cautions: dict[str, str] = {}  # warnings, by protocol


def connected() -> bool:
    """Return whether there is a sender."""
    return _client is not None


def streams(scene: bpy.types.Scene) -> bool:
    """Return whether there is a sender, and this is its scene."""
    return _client is not None and _scene == scene.session_uid


def elsewhere(scene: bpy.types.Scene) -> str:
    """Return a sentence if another scene than this one is connected, else ''."""
    other = _streaming_scene() if _client is not None and not streams(scene) else None
    if other is None:
        return ""
    return f"Scene '{other.name_full}' is connected: the device follows that scene, not this one."


def caution(scene: bpy.types.Scene) -> str:
    """Return the warning about the scene's board, '' for none.

    It is the connected board's own warning; before that is known, the warning of its protocol.
    """
    if streams(scene) and "caution" in _status:
        return str(_status["caution"])
    protocol = scene.dermis_stream.protocol
    if protocol not in _cautions:
        read = loading.value(("caution", protocol), lambda: _caution(protocol))
        if read is None:
            return ""  # a panel does not wait until the protocols are read
        _cautions[protocol] = read[0]
    return _cautions[protocol]


def _caution(protocol: str) -> str:
    adapters = core.stream.protocols.adapters
    return "" if protocol == adapters.OTHER else adapters.adapter_of(protocol).caution


def silence() -> str:
    """Return the connected board's declared behaviour in silence, '' if unknown."""
    text = str(_status.get("silence", {}).get("text", ""))
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def status() -> dict[str, Any]:
    """Return the status at the last heartbeat; send no query."""
    return _status or {"state": core.stream.state.State.DISCONNECTED, "message": "", "armed": False}


def found_ports() -> list[tuple[str, str]]:
    """Return the ports of the last rescan."""
    return _ports


def paired_boards() -> dict[str, str]:
    """Return the addresses of boards that were paired for Wi-Fi, by name.

    They are those of the last `read_pairs`.
    """
    return _boards


def read_pairs() -> None:
    """Read which boards are paired with this computer.

    Raises:
        DermisError: the file is not a file of keys.
    """
    global _boards
    _boards = core.stream.protocols.pairs.addresses()


def rescan() -> int:
    """Look for serial ports; return their number.

    This may take seconds, so a button may call it, but no drawing.
    """
    global _ports
    _ports = core.stream.links.serial_port.ports()
    return len(_ports)


def connect(scene: bpy.types.Scene) -> None:
    """Start a sender and let it connect; arm nothing.

    Raises:
        DermisError: a file that the .blend names was not confirmed; there is no device; a setting is not valid; or the
            process cannot be started.
    """
    global _client, _preset, _scene, _status, _taken_up
    settings = scene.dermis_stream
    agreed_paths.check(settings)
    close()
    built_devices.refresh()
    streamed_track.judge_anew()
    key = streamed_track.device_key(scene)
    preset = library().load("devices", key)
    device_calibration.fill_channels(scene)
    streamed_track.pin(scene)
    calibration = device_calibration.calibration_of(scene, key)
    request = request_fields.request_fields(scene)
    os.environ.setdefault(core.stream.protocols.adapters.FOLDERS, str(user_folder("adapters")))
    _client = core.stream.client.SenderClient()
    try:
        _client.connect(settings.url, settings.protocol, key, preset, calibration=calibration.dumps(), **request)
    except DermisError:
        close()
        raise
    _scene, _preset, _taken_up = scene.session_uid, key, False
    _status = {"state": core.stream.state.State.CONNECTING, "message": "", "armed": False}
    heartbeat()
    _start_timer()


def close() -> None:
    """Stop, disconnect and end the sender.

    The function waits for a short time. After that, the process may go on until the device has reached its safe state.
    The function may be called at any time.
    """
    global _client, _leaving, _note, _published, _restored, _status
    client, _client = _client, None
    if client is not None:
        client.close()
        _leaving = core.stream.client.leaving()
        _start_timer()
    _status, _note, _published, _restored = {}, "", (None, ()), False
    streamed_track.unpin()
    board_identity.forget()
    streamed_track.forget()


def leaving() -> str:
    """Return the work that closed senders have left, and why streams failed.
    '' if there is neither. The text is that of the last heartbeat; no query is sent.
    """
    return _leaving


def pose_unknown() -> bool:
    """Return whether arming may start with a jump.

    It may if an actuator has a position and the device's pose is not known.
    """
    now = status()
    return not now.get("pose_known") and any(unit not in STILL for unit in now.get("units", ()))


def plays_bake(scene: bpy.types.Scene) -> bool:
    """Return whether arming would play a track of the bake."""
    settings = scene.dermis_stream
    baked = settings.mode == "play" and not settings.track_file and streamed_track.chosen_output(scene) is not None
    return baked and streams(scene)


def arm(scene: bpy.types.Scene, *, fingers_out: bool = False) -> None:
    """Let the device move, at a person's request.

    Args:
        fingers_out: a person has confirmed that the fingers are out; needed if the device's pose is not known.

    Raises:
        DermisError: nothing is connected, or another scene is; a bake or a render steps through the frames; the device
            is not ready; the track or the calibration is of another device; or the first pulse may cause a jump and
            nobody has confirmed that the fingers are out.
    """
    if _client is None:
        raise DermisError("not connected", remedy="Connect first")
    if not streams(scene):
        raise DermisError("another scene is connected", where=scene.name, remedy="Arm it there, or connect this one")
    if frame_hold.held():
        raise DermisError(
            "arming is refused while a bake or a render steps through the frames",
            remedy="Let the bake or the render end, or cancel it",
        )
    if scene.dermis_stream.mode == "jog":
        device_calibration.retract(scene)
        changed()
    _check_preset(scene)
    _client.set(**request_fields.request_fields(scene))
    heartbeat()
    waiting = core.stream.state.WAITING
    if status()["state"] not in waiting:
        raise DermisError("the device is not ready to be armed", value=status()["state"], limit=" or ".join(waiting))
    board_identity.check(scene)
    if pose_unknown() and not fingers_out:
        raise DermisError(
            "the device does not know where its motors are", remedy="Take the finger out, and confirm it (fingers_out)"
        )
    _client.arm()


def disarm() -> None:
    """Bring the device to its safe state."""
    if _client is not None:
        _client.disarm()


def stop() -> None:
    """Bring the device to its safe state at once."""
    if _client is not None:
        _client.stop()


def changed() -> None:
    """Pass changed settings on to the running sender, if there is one.

    A sender that starts later takes them at its start.
    """
    global _note
    scene = _streaming_scene()
    if _client is None or scene is None or calibration_rows.restoring():
        return
    try:
        _check_preset(scene)
        device_calibration.fill_channels(scene)
        streamed_track.pin(scene)
        calibration = device_calibration.calibration_of(scene, _preset)
        _client.set(**request_fields.request_fields(scene), calibration=calibration.dumps())
        _note = ""
    except DermisError as error:
        _note = str(error)


def _check_preset(scene: bpy.types.Scene) -> None:
    """Refuse a choice of another device preset than the connected one.

    The connected device is then disarmed.
    """
    key = streamed_track.device_key(scene)
    if key != _preset:
        disarm()
        raise DermisError(
            "the chosen track is for a device other than the connected one",
            where=scene.dermis_stream.output or bpy.path.basename(scene.dermis_stream.track_file),
            value=key,
            limit=_preset,
            remedy="Choose one of this device, or disconnect and connect the other one",
        )


def heartbeat() -> None:
    """Send a heartbeat with the frame that Blender shows; read the status.

    While a bake or a render steps through the frames, the last published time and values are sent again: nobody plays
    or scrubs then.
    """
    global _leaving, _mode, _published, _restored, _status, _taken_up
    if _leaving:
        _leaving = core.stream.client.leaving()
    if _client is None:
        return
    scene = _streaming_scene()
    if scene is None:  # removed, or undone
        close()
        return
    if missing := streamed_track.gone(scene):
        close()
        why = f"{missing}, so its device was brought to its safe state and disconnected"
        _status = {"state": core.stream.state.State.DISCONNECTED, "message": why, "armed": False}
        return
    if _restored:
        _restored = False
        _take_back(scene)
    playing = False
    if not frame_hold.held():
        if streamed_track.outdated(scene):
            changed()  # first: the time below counts from the start of the track that the sender has
        windows = bpy.context.window_manager.windows
        playing = any(w.screen.is_animation_playing and compat.shows(w, scene) for w in windows)
        _published = request_fields.published(scene, _status.get("names", ()))
    _mode = scene.dermis_stream.mode
    moment, values = _published
    _client.heartbeat(playing=playing, time=moment, values=values)
    _status = _client.status()
    state = core.stream.state.State
    _taken_up = _taken_up or _status["state"] != state.DISCONNECTED or bool(_status.get("message"))
    if not _taken_up:
        _status["state"] = state.CONNECTING
    calibrated_as = scene.dermis_stream.channels_file
    met = board_identity.meet(scene, _status)
    if scene.dermis_stream.channels_file != calibrated_as:  # the list is now calibrated as the device that answered
        changed()
    if _status["armed"] and board_identity.is_another(scene):
        _client.disarm()
    caveat = request_fields.caveat(scene) if _status["armed"] else ""
    said = (_note, met, caveat, _status.get("message"), (_status.get("received") or {}).get("record"))
    _status["message"] = "; ".join(filter(None, said))


def _take_back(scene: bpy.types.Scene) -> None:
    """Pass on the settings that undo or redo restored.

    The device blends over to them. If they change the mode of an armed device to jog, it goes to its safe state
    instead, because the restored positions are old.
    """
    global _note
    turned = _status.get("armed") and scene.dermis_stream.mode == "jog" != _mode
    if turned:
        disarm()
    changed()
    if turned:
        said = "undo turned to Jog, so the device goes to its safe state: arm it again"
        _note = "; ".join(filter(None, (_note, said)))


def _streaming_scene() -> bpy.types.Scene | None:
    return next((s for s in bpy.data.scenes if s.session_uid == _scene), None)


def restored() -> None:
    """Note that undo or redo has restored settings.

    The next heartbeat passes them on, not this function: a change made in Blender's handler belongs to no step of undo,
    and the restored scene is not evaluated yet.
    """
    global _restored
    _restored = _client is not None


def end() -> None:
    """Close the sender and forget its state.

    Called when another file is opened and when the add-on is disabled.
    """
    close()
    streamed_track.forget(files=True)
    device_calibration.forget()


def end_timer() -> None:
    """Send no more heartbeats, and stop watching closed senders."""
    global _leaving
    _leaving = ""
    if bpy.app.timers.is_registered(_on_timer):
        bpy.app.timers.unregister(_on_timer)


def _start_timer() -> None:
    if not bpy.app.background and not bpy.app.timers.is_registered(_on_timer):
        bpy.app.timers.register(_on_timer, first_interval=HEARTBEAT, persistent=True)


def _on_timer() -> float | None:
    global _heartbeats
    before = _status.get("state"), _leaving
    try:
        heartbeat()
    except Exception as error:  # Blender ends a timer that raises, and the panel would be out of date
        core.stream.client.note_loss(f"streaming ended by an error: {type(error).__name__}: {error}")
        close()
        traceback.print_exc()
    _heartbeats += 1
    ended = _client is None and not _leaving
    if ended or _heartbeats % REDRAW == 0 or before != (_status.get("state"), _leaving):
        redraw.request()
    return None if ended else HEARTBEAT

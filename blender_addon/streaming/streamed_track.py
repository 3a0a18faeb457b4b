"""What is streamed: the device and the track that the settings speak of, from the bake or from a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import bpy

from .. import scene_time
from .._core import DermisError, core
from ..preferences import library
from ..results import store
from ..sampling.frames import frame_range
from . import agreed_paths, built_devices, finger_ids


class _Sent(NamedTuple):
    """The baked track that the sender has: it starts where its own bake did, whatever has been baked since."""

    output: Any  # kept, or its id could be another's tomorrow
    scene: int  # session uid
    name: str
    clock: scene_time.Clock


_files: list[Path] = []
_file_track: Any = None  # of `track_file`: (path, CommandTrack)
_sent: _Sent | None = None
_judged: tuple[Any, str] = (None, "")  # a track, and how it disagrees with its preset


def output_names() -> list[str]:
    """Return 'finger: device' of every output of the current bake."""
    result = store.current(bpy.context.scene)
    return [f"{o.finger}: {o.device}" for o in result.bake.outputs] if result is not None else []


def chosen_output(scene: bpy.types.Scene) -> Any:
    """Return the output that is to be played, or None."""
    result = store.current(scene)
    outputs = result.bake.outputs if result is not None else ()
    wanted = scene.dermis_stream.output
    return next((o for o in outputs if not wanted or f"{o.finger}: {o.device}" == wanted), None)


def device_of(scene: bpy.types.Scene) -> tuple[str, str]:
    """Return the finger and the device preset that the settings speak of; '' for a finger that no one has named.

    Raises:
        DermisError: there is no device.
    """
    if scene.dermis_stream.track_file:
        track = load_file(scene)
        return str(track.meta.get("finger", "")), str(track.spec.key)
    output = chosen_output(scene)
    if output is not None:
        return str(output.finger), str(output.device)
    wanted, refused = scene.dermis_stream.output, DermisError
    there = [
        (obj.name, str(use.preset))
        for obj in scene.objects
        if obj.dermis.role == "FINGER"
        for use in obj.dermis.finger.devices
        if use.enabled and use.preset
    ]
    if not there:
        raise refused(
            "no device to stream to", where=scene.name, remedy="Give a finger a device, or choose a track file"
        )
    if not wanted:
        return there[0]
    found = [pair for pair in there if ": ".join(pair) == wanted] or _renamed(scene, wanted, there)
    if not found:
        raise refused(
            "there is no such finger with this device",
            where="Track",
            value=wanted,
            limit=", ".join(map(": ".join, there)),
            remedy="Choose one of these, or bake",
        )
    return found[0]


def _renamed(scene: bpy.types.Scene, wanted: str, there: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """Return which of some pairs of finger and device was once called otherwise: the one to which a device was given.

    Raises:
        DermisError: the table of names cannot be read.
    """
    finger, _, key = wanted.rpartition(": ")
    obj = finger_ids.finger_with(built_devices.once_called(finger), scene)
    return [pair for pair in there if obj is not None and pair == (obj.name, key)]


def device_key(scene: bpy.types.Scene) -> str:
    """Return the device preset that the settings speak of.

    Raises:
        DermisError: there is none.
    """
    return device_of(scene)[1]


def load_file(scene: bpy.types.Scene) -> Any:
    """Return the command track of the settings' file.

    Raises:
        DermisError: nobody has confirmed it, or it cannot be read.
    """
    global _file_track
    agreed_paths.check(scene.dermis_stream, "track_file")
    path = Path(bpy.path.abspath(scene.dermis_stream.track_file))
    key = (str(path), path.stat().st_mtime_ns if path.is_file() else 0)
    if _file_track is None or _file_track[0] != key:
        _file_track = (key, core.track.export.read(path))
    return _file_track[1]


def track_path(scene: bpy.types.Scene) -> str:
    """Return a file with the track to be played; the bake's is written anew when it has changed."""
    global _sent
    if scene.dermis_stream.track_file:
        load_file(scene)
        return str(Path(bpy.path.abspath(scene.dermis_stream.track_file)))
    output = chosen_output(scene)
    result = store.current(scene)
    if output is None or result is None:
        _sent = None
        return ""
    if _sent is None or _sent.output is not output or _sent.scene != scene.session_uid:
        from tempfile import mkstemp

        handle, name = mkstemp(prefix="dermis-stream-", suffix=".dtrack")
        with open(handle, "wb") as file:
            file.write(core.track.binary.dumps(output.track))
        _files.append(Path(name))
        _sent = _Sent(output, scene.session_uid, name, result.clock)
    return _sent.name


def outdated(scene: bpy.types.Scene) -> bool:
    """Return whether the sender has another baked track than the one to be played: one was baked, or forgotten."""
    if scene.dermis_stream.track_file:
        return False
    mine = _sent is not None and _sent.scene == scene.session_uid
    return chosen_output(scene) is not (_sent.output if _sent is not None and mine else None)


def origin(scene: bpy.types.Scene) -> scene_time.Clock:
    """Return the clock of the track that is played."""
    if not scene.dermis_stream.track_file:
        started = _sent if _sent is not None and _sent.scene == scene.session_uid else store.current(scene)
        if started is not None:
            return started.clock
    return scene_time.clock(scene, frame_range(scene)[0])


def loaded() -> Any:
    """Return the track that was loaded from a file last, or None."""
    return _file_track[1] if _file_track is not None else None


def doubts(scene: bpy.types.Scene) -> str:
    """Return where the track to be played and its device's preset disagree, in words; '' for nowhere.

    A track is judged once, and again after `judge_anew`, because panels ask at every redraw.
    """
    global _judged
    if scene.dermis_stream.track_file:
        track = loaded()
    else:
        output = chosen_output(scene)
        track = output.track if output is not None else None
    if track is not _judged[0]:
        found = core.track.check.preset_findings(track, library()) if track is not None else ()
        serious = [finding for finding in found if finding.severity != "info"]
        said = [f"{f.what[0].upper()}{f.what[1:]}. {f.remedy}".rstrip(" .") + "." for f in serious[:1]]
        more = [f"{len(serious) - 1} limits or channels differ."] if serious[1:] else []
        _judged = track, " ".join(said + more)
    return _judged[1]


def judge_anew() -> None:
    """Forget how a track agrees with its preset: that may have been edited."""
    global _judged
    _judged = None, ""


def forget(*, files: bool = False) -> None:
    """Remove what was written for the sender; with `files`, what was loaded too."""
    global _file_track, _sent
    _sent = None
    while _files:
        _files.pop().unlink(missing_ok=True)
    if files:
        _file_track = None

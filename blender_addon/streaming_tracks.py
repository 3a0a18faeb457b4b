"""What is streamed: the device and the track that the settings speak of, from the bake or from a file."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import bpy

from . import results
from .preferences import core_module

_files: list[Path] = []
_file_track: Any = None  # of `track_file`: (path, CommandTrack)
_written: tuple[Any, ...] = ()


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


def track_path(scene: bpy.types.Scene) -> str:
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
        _files.append(Path(name))
        _written = (key, name, output)  # the output too, or its id could be another's tomorrow
    return str(_written[1])


def origin(scene: bpy.types.Scene) -> tuple[float, float]:
    """Return the frame at which tracks start, and frames a second."""
    from .sampling import frame_range, frames_per_second

    result = results.current(scene)
    if result is not None and not scene.dermis_stream.track_file:
        return result.first, result.fps
    return float(frame_range(scene)[0]), float(frames_per_second(scene))


def loaded() -> Any:
    """Return the track that was loaded from a file last, or None."""
    return _file_track[1] if _file_track is not None else None


def forget(*, files: bool = False) -> None:
    """Remove what was written for the sender; with `files`, what was loaded too."""
    global _file_track, _written
    _written = ()
    while _files:
        _files.pop().unlink(missing_ok=True)
    if files:
        _file_track = None

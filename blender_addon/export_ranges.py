"""Parts of a bake as files: the whole of it, the preview range, from marker to marker, or an action's frames."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from .preferences import core_module

SPANS = ("ALL", "PREVIEW", "MARKERS", "ACTION")


def write(
    scene: bpy.types.Scene, result: Any, folder: Path, form: str, span: str = "ALL", *,
    active: bpy.types.Object | None = None, finger: str | None = None, prefix: str = "", force: bool = False,
) -> tuple[list[Path], list[Any]]:  # fmt: skip
    """Write a file for each output and each range; return the files, and what their check found.

    Args:
        form: of `core.formats.export.FORMATS`. span: of `SPANS`. active: whose action 'ACTION' means.
        finger: this one only; None: all. prefix: of the names, such as the scene's.

    Raises:
        DermisError: no such range, a track with errors and no force, or a file that cannot be written.
    """
    formats, outputs = core_module("formats.export"), core_module("outputs")
    written: list[Path] = []
    found: list[Any] = []
    for stem, output in zip(outputs.file_names(result.bake), result.bake.outputs, strict=True):
        if finger is not None and output.finger != finger:
            continue
        for name, first, last in ranges(scene, result, span, active):
            track = output.track
            if name:
                start, stop = ((f - result.first) / result.fps for f in (first, last))
                track = formats.cut(track, start, stop, name=name)
            label = ".".join(p for p in (_safe(prefix), stem, _safe(name)) if p)
            path = folder / (label + formats.format_of(form).suffix)
            found += formats.write(track, path, form, force=force)
            written.append(path)
    return written, found


def ranges(
    scene: bpy.types.Scene, result: Any, span: str, active: bpy.types.Object | None
) -> list[tuple[str, float, float]]:
    """Return name, first and last frame of every range asked for; a name of '' is the whole bake.

    Raises:
        DermisError: the scene has no such range.
    """
    refuse = core_module("errors").DermisError
    if span == "ALL":
        return [("", 0.0, 0.0)]
    if span == "PREVIEW":
        if not scene.use_preview_range:
            raise refuse("the scene has no preview range", where=scene.name, remedy="Set one in the timeline")
        return [("preview", float(scene.frame_preview_start), float(scene.frame_preview_end))]
    if span == "ACTION":
        action = active.animation_data.action if active is not None and active.animation_data else None
        if action is None:
            raise refuse("the active object has no action", where=active.name if active else scene.name)
        first, last = action.frame_range
        return [(action.name, float(first), float(last))]
    outputs = result.bake.outputs
    end = result.first + max((o.track.duration for o in outputs), default=0.0) * result.fps
    markers = sorted((float(m.frame), m.name) for m in scene.timeline_markers if result.first <= m.frame < end)
    if not markers:
        raise refuse("no marker lies in the baked range", where=scene.name, remedy="Add markers with M")
    ends = [frame for frame, _ in markers[1:]] + [end]
    names: list[str] = []
    for _, name in markers:
        names.append(name if name not in names else f"{name}-{len(names)}")
    return [(name, first, last) for name, (first, _), last in zip(names, markers, ends, strict=True)]


def _safe(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in name)

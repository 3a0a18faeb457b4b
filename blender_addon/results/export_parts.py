"""Write parts of a bake to files.

A part is the whole bake, the preview range, the range from one marker to the next, or the frames of an action.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isclose
from pathlib import Path
from types import MappingProxyType
from typing import Any

import bpy

from .. import scene_time
from .._core import DermisError, Finding, core
from ..properties import fields

NO_SETTINGS: Mapping[str, Any] = MappingProxyType({})


@dataclass(frozen=True)
class Part:
    """A track, whole or cut, and the file that it will be written to."""

    path: Path
    track: Any


def write(
    scene: bpy.types.Scene,
    result: Any,
    folder: Path,
    form: str,
    span: str = "ALL",
    *,
    active: bpy.types.Object | None = None,
    finger: str | None = None,
    force: bool = False,
) -> tuple[list[Path], list[Any]]:
    """Write a file for each output and range; return files and findings.

    Args:
        form: key of the format in `core.track.formats.FORMATS`.
        active: the object whose action is the range 'ACTION'.
        span: 'ALL', 'PREVIEW', 'MARKERS' or 'ACTION'.
        finger: name of the only finger to write; None for all.

    Raises:
        DermisError: see `plan` and `write_parts`.
    """
    parts, found = plan(scene, result, folder, form, span, active=active, finger=finger)
    written, more = write_parts(parts, form, force=force, settings=settings_of(scene, form))
    return written, found + more


def plan(
    scene: bpy.types.Scene,
    result: Any,
    folder: Path,
    form: str,
    span: str = "ALL",
    *,
    active: bpy.types.Object | None = None,
    finger: str | None = None,
    prefix: str = "",
    names: Any = None,
) -> tuple[list[Part], list[Any]]:
    """Cut the ranges out of the tracks and name their files.

    Nothing is written. Findings report the parts that are left out.

    Args:
        prefix: first part of the file names, such as the scene's name; it must be safe in a file name.
        names: the `FileNames` that several scenes of one export share; None for an own one.

    Raises:
        DermisError: there is no such range, it reaches beyond the bake, or no sample lies in any range.
    """
    names = names or core.track.file_names.FileNames()
    suffix = core.track.export.format_of(form).suffix
    spans, taken = ranges(scene, result, span, active), core.track.file_names.FileNames()
    labels = [taken.take(core.track.file_names.safe(name)) if name else "" for name, _, _ in spans]
    parts: list[Part] = []
    found: list[Any] = _markers_outside(scene, result) if span == "MARKERS" else []
    empty: list[Any] = []
    for stem, output in zip(core.pipeline.outputs.file_names(result.bake), result.bake.outputs, strict=True):
        if finger is not None and output.finger != finger:
            continue
        for label, (name, first, last) in zip(labels, spans, strict=True):
            track = output.track
            if track.meta.get("finger", output.finger) != output.finger:  # it was renamed since
                track = replace(track, meta={**track.meta, "finger": output.finger})
            if name:
                try:
                    start, stop = (result.clock.seconds(f) for f in (first, last))
                    track = core.track.export.cut(track, start, stop, name=name)
                except core.track.export.EmptyRange as error:
                    empty.append(error)
                    found.append(
                        Finding(
                            "warning",
                            "range-empty",
                            f"not written: {error.what}",
                            f"{stem}, {error.where}",
                            error.value,
                            remedy="Move the marker, or make the range longer",
                            frame=first,
                        )
                    )
                    continue
            whole = ".".join(p for p in (prefix, stem, label) if p)
            parts.append(Part(folder / names.take(whole, suffix), track))
    if empty and not parts:
        raise empty[0]
    return parts, found + [*core.pipeline.outputs.name_findings(result.bake)]


def settings_of(scene: bpy.types.Scene, form: str) -> dict[str, Any]:
    """Return a scene's settings of a format, in SI.

    They are kept in the property group that has the name of the format.
    """
    table = core.track.export.format_of(form).settings
    return fields.values(getattr(scene.dermis, form), table) if table else {}


def write_parts(
    parts: Sequence[Part], form: str, *, force: bool = False, settings: Mapping[str, Any] = NO_SETTINGS
) -> tuple[list[Path], list[Any]]:
    """Write parts, each to its own file; return the files and findings.

    A part that is refused gives a finding, and the others are still written.

    Args:
        settings: settings of the format, see `settings_of`.

    Raises:
        DermisError: every part is refused; the error is that of the first.
    """
    written: list[Path] = []
    found: list[Any] = []
    refused: list[Any] = []
    for part in parts:
        try:
            found += core.track.export.write(part.track, part.path, form, force=force, settings=settings)
        except DermisError as error:
            refused.append(error)
            what = error.what if error.code == "track-refused" else f"not written: {error.what}"
            found.append(error.as_finding(code="refused", what=what, where=f"{part.path.name}: {error.where}"))
        else:
            written.append(part.path)
    if refused and not written:
        raise refused[0]
    return written, found


def ranges(
    scene: bpy.types.Scene, result: Any, span: str, active: bpy.types.Object | None
) -> list[tuple[str, float, float]]:
    """Return name, first and last frame of every range.

    The name '' stands for the whole bake. A marker without a name is named by its frame, as in Blender. Repeated marker
    names are numbered, so that every range of markers has its own name.

    Raises:
        DermisError: the scene has no such range.
    """
    if span == "ALL":
        return [("", 0.0, 0.0)]
    if span == "PREVIEW":
        if not scene.use_preview_range:
            raise DermisError("the scene has no preview range", where=scene.name, remedy="Set one in the timeline")
        return [("preview", float(scene.frame_preview_start), float(scene.frame_preview_end))]
    if span == "ACTION":
        action = active.animation_data.action if active is not None and active.animation_data else None
        if action is None:
            raise DermisError("the active object has no action", where=active.name if active else scene.name)
        first, last = (scene_time.shown_at(scene, float(frame)) for frame in action.frame_range)
        return [(action.name, first, last)]
    end = last_frame(result)
    markers = sorted(
        (float(m.frame), m.name or f"F_{m.frame}")
        for m in scene.timeline_markers
        if result.clock.first <= m.frame < end
    )
    if not markers:
        raise DermisError("no marker lies in the baked range", where=scene.name, remedy="Add markers with M")
    ends = [frame for frame, _ in markers[1:]] + [end]
    names = core.track.file_names.numbered([name for _, name in markers])
    return [(name, first, last) for name, (first, _), last in zip(names, markers, ends, strict=True)]


def last_frame(result: Any) -> float:
    """Return the frame at which a bake ends.

    Its tracks end at their last whole sample, at this frame or just before it.
    """
    reached = [result.clock.frames(o.track.duration) for o in result.bake.outputs]
    for output in result.bake.outputs:
        words = output.track.meta.get("frame_range", "").split()
        if len(words) == 2 and isclose(float(words[0]), result.clock.first):
            return float(words[1])
    return max(reached, default=result.clock.first)


def _markers_outside(scene: bpy.types.Scene, result: Any) -> list[Any]:
    end = last_frame(result)
    out = sorted(m.frame for m in scene.timeline_markers if not result.clock.first <= m.frame <= end)
    if not out:
        return []
    what = "markers lie outside the baked range, so no range begins there"
    return [
        Finding(
            "info",
            "marker-outside",
            what,
            scene.name,
            f"{len(out)} of them",
            f"frames {result.clock.first:g} to {end:g}",
            frame=float(out[0]),
            count=len(out),
        )
    ]

"""Find the frames of a scene that are sampled, and their times."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np

from .. import changes, scene_time
from .._core import Array, Finding, core
from . import touched_frames

Span = tuple[int, int]

_touched: core.recent.Recent[tuple[int, int, int], touched_frames.Touched] = core.recent.Recent(4)


def frame_range(scene: bpy.types.Scene) -> Span:
    """Return the first and last frame to bake, by the setting *Range*."""
    return _range(scene, touched_frames.of)


def frame_range_now(scene: bpy.types.Scene) -> Span:
    """Return the range as `frame_range` does, cached until the next change.

    It is for callers that need the range at every frame.
    """

    def kept(_scene: bpy.types.Scene) -> touched_frames.Touched:
        key = (scene.session_uid, changes.edits(), len(bpy.data.objects))
        return _touched.make(key, lambda: touched_frames.of(scene))

    return _range(scene, kept)


def range_finding(scene: bpy.types.Scene) -> Finding | None:
    """Return the finding on the range that is baked; None if there is none."""
    how, where, whole = scene.dermis.bake_range, f"scene '{scene.name_full}'", _scene_range(scene)
    if how == "PREVIEW" and scene.use_preview_range:
        span = f"{scene.frame_preview_start} to {scene.frame_preview_end}"
        return Finding("info", "preview-range", "the preview range is on, so only that is baked", where, value=span)
    if how != "TOUCHED":
        return None
    touched = touched_frames.of(scene)
    if not touched.why and _within(touched, whole) is not None:
        return None
    if touched.why:
        what = f"keys alone do not give the touched frames: {touched.why}; so the scene's whole range is baked"
    else:
        span = f"frames {touched.first} to {touched.last}"
        what = f"the keys, {span}, share less than two frames with the scene's range, so the whole range is baked"
    return Finding("info", "whole-range", what, where, value=f"{whole[0]} to {whole[1]}")


def _range(scene: bpy.types.Scene, touched_of: Callable[[bpy.types.Scene], touched_frames.Touched]) -> Span:
    settings, whole = scene.dermis, _scene_range(scene)
    match settings.bake_range:
        case "OWN":
            return settings.frame_start, settings.frame_end
        case "PREVIEW" if scene.use_preview_range:
            return scene.frame_preview_start, scene.frame_preview_end
        case "TOUCHED":
            touched = touched_of(scene)
            return (None if touched.why else _within(touched, whole)) or whole
    return whole


def _within(touched: touched_frames.Touched, whole: Span) -> Span | None:
    """Return the touched frames in the scene's range; None if they are fewer than two."""
    first, last = max(touched.first, whole[0]), min(touched.last, whole[1])
    return (first, last) if first < last else None


def _scene_range(scene: bpy.types.Scene) -> Span:
    return scene.frame_start, scene.frame_end


def sweep_frames(scene: bpy.types.Scene, span: tuple[int, int], rate: float) -> tuple[Array, Array]:
    """Return the frames of samples at a rate [Hz], and their times [s].

    The frames are rounded to single precision, because Blender evaluates frames in single precision. The times are
    those of the rounded frames, and count from the first frame of the span.
    """
    clock = scene_time.clock(scene, span[0])
    frames, _ = core.scene.tactile_scene.sample_frames(clock.rate, span, rate)
    frames = frames.astype(np.float32).astype(np.float64)
    return frames, clock.seconds(frames)

"""A scene's request to the sender, and the frame that Blender shows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy

from .. import scene_time
from .._core import core
from ..preview import device_preview
from ..properties.fields import values
from ..results import store
from . import agreed_paths, stream_log, streamed_track


def published(scene: bpy.types.Scene, names: Sequence[str]) -> tuple[float, tuple[float, ...]]:
    """Return the track's time of the shown frame [s], and values to follow.

    There are values only in the mode 'follow'.
    """
    moment = streamed_track.origin(scene).seconds(scene_time.shown(scene))
    if scene.dermis_stream.mode != "follow":
        return moment, ()
    preview = device_preview.computed(scene)
    row = streamed_track.row_of(streamed_track.chosen(scene), preview.rows if preview is not None else ())
    if row is None or not all(n in row.values for n in names):
        return moment, ()
    return moment, tuple(float(row.values[n]) for n in names)


def caveat(scene: bpy.types.Scene) -> str:
    """Return in words that the sent bake may not fit the scene; '' if it does."""
    settings = scene.dermis_stream
    if settings.mode == "play":
        baked = not settings.track_file and streamed_track.chosen_output(scene) is not None
        state, verb, other = store.state(scene) if baked else "", "plays", "stop it"
    elif settings.mode == "follow":
        preview = device_preview.computed(scene)
        state, verb, other = preview.source if preview is not None else "", "follows", "turn on Live Preview"
    else:
        return ""
    if state == "stale":
        return f"the device {verb} the bake of before your edit: bake again, or {other}"
    if state == "earlier":
        return f"the device {verb} an earlier session's bake, which was not compared with the scene: {other}, or bake"
    return ""


def request_fields(scene: bpy.types.Scene) -> dict[str, Any]:
    """Return the fields of the sender's request that follow from the settings.

    The protocol is left out, because only connecting changes it.

    Raises:
        DermisError: a file was not confirmed, or a track cannot be read.
    """
    agreed_paths.check(scene.dermis_stream, "track_file", "screen_file", "log_folder", "tee")
    s = scene.dermis_stream
    jog = {c.name: c.jog for c in s.channels} if s.mode == "jog" else {}
    return {
        **{name: value for name, value in values(s, core.parameters.stream.STREAM).items() if name != "protocol"},
        **stream_log.fields(s),
        "jog": jog,
        "track": streamed_track.track_path(scene),
        "screen": bpy.path.abspath(s.screen_file) if s.screen_file else "",
    }

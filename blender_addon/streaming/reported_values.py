"""What the twin shows while something streams: what the device reports, or a track from a file."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy
import numpy as np

from .._core import core
from ..preferences import library
from ..preview import device_preview
from ..preview.rows import Preview, Row
from ..results import store
from . import session, streamed_track


def preview(scene: bpy.types.Scene) -> Preview | None:
    """Return what the twin shall show instead of bake and live preview, or None.

    What the device reports comes first; then a track that was loaded from a file.
    """
    settings = getattr(scene, "dermis_stream", None)
    if settings is None:
        return None
    status = session.status()
    reported = (status.get("received") or {}).get("values")
    if reported is None and status.get("pose"):
        reported = dict(zip(status.get("names", ()), status["pose"], strict=False))
    track = streamed_track.loaded()
    loaded = _preview_of_file(scene, track) if settings.track_file and track is not None else None
    if session.streams(scene) and settings.show_received and reported:
        found = _reported_in(loaded, reported, "")  # the file's one row is its own, whichever output is chosen
        if found is None:
            found = _reported_in(device_preview.computed(scene), reported, settings.output)
        if found is not None:
            return found
    return loaded


def _reported_in(shown: Preview | None, reported: dict[str, float], wanted: str) -> Preview | None:
    """Return a preview with reported values in place of its own; None where they fit no row of it."""
    if shown is None:
        return None
    rows: list[Row] = []
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
            tactor = core.devices.shear_tactor.ShearTactor.from_spec(spec)
            place = tactor.forward(np.array([values["pulley_1"], values["pulley_2"]]))
            values["tactor_x"], values["tactor_y"] = (float(v) for v in place)
        rows.append(replace(row, values=values))
    return Preview(shown.frame, "device", "what the device reports", tuple(rows)) if replaced else None


def _preview_of_file(scene: bpy.types.Scene, track: Any) -> Preview | None:
    """Return the preview of a loaded track: on the finger that it names, or on the first one."""
    fingers = [o.name for o in scene.objects if o.dermis.role == "FINGER"]
    named = track.meta.get("finger", "")
    if not fingers:
        return None
    pipeline = core.pipeline.render
    output = pipeline.Output(named if named in fingers else fingers[0], track.spec.key, track, {}, ())
    first, fps = streamed_track.origin(scene)
    result = store.Result(pipeline.Bake((output,), (), {}, ""), fps, first, -1, ())
    frame = device_preview.frame_of(scene)
    return Preview(frame, "file", "from a track file", (device_preview.baked_row(result, output, frame),))

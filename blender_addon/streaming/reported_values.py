"""Values for the twin in place of bake and live preview.

They are those that a connected device reports, or those of a track from a file.
"""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np

from .. import identity
from .._core import core
from ..preferences import library
from ..preview import device_preview, moment
from ..preview.rows import Preview, Row
from ..results import store
from . import session, streamed_track


def preview(scene: bpy.types.Scene) -> Preview | None:
    """Return the values for the twin instead of bake and live preview, or None.

    The values that the device reports come first; then a track that was loaded from a file.
    """
    loaded, values = of_file(scene), reported(scene)
    if values:
        found = with_reported(loaded, values, loaded.rows[0] if loaded is not None else None)
        if found is None:
            shown = device_preview.computed(scene)
            rows = shown.rows if shown is not None else ()
            found = with_reported(shown, values, streamed_track.row_of(streamed_track.chosen(scene), rows))
        if found is not None:
            return found
    return loaded


def reported(scene: bpy.types.Scene) -> dict[str, float]:
    """Return the pose that the scene's device reports, by channel [SI].

    The values are in the same terms as commands. There are none if nothing shall be shown.
    """
    settings = getattr(scene, "dermis_stream", None)
    if settings is None or not (session.streams(scene) and settings.show_received):
        return {}
    values: dict[str, float] = session.status().get("reported") or {}
    return values


def with_reported(shown: Preview | None, reported: dict[str, float], own: Row | None) -> Preview | None:
    """Return a preview with reported values in place of its own.

    None if the preview has no row of the device, or if this row lacks a reported channel.
    """
    if shown is None or own is None or not set(reported) <= set(own.values):
        return None
    rows: list[Row] = []
    for row in shown.rows:
        if row is not own:
            rows.append(row)
            continue
        values = {**row.values, **reported}
        if row.kind == "shear_tactor" and "pulley_1" in reported:
            spec = library().device(row.device)
            tactor = core.devices.shear_tactor.ShearTactor.from_spec(spec)
            place = tactor.forward(np.array([values["pulley_1"], values["pulley_2"]]))
            values["tactor_x"], values["tactor_y"] = (float(v) for v in place)
        rows.append(replace(row, values=values, signals={}))  # signals rate computed values, not reported ones
    return Preview(shown.frame, "device", "reported by the device", tuple(rows))


def of_file(scene: bpy.types.Scene) -> Preview | None:
    """Return the preview of the track that was loaded from a file, or None.

    The track is shown on the finger that it names, or else on the first one.
    """
    settings, track = getattr(scene, "dermis_stream", None), streamed_track.loaded()
    if settings is None or not settings.track_file or track is None:
        return None
    fingers = [obj.name_full for obj in identity.fingers(scene)]
    named = track.meta.get("finger", "")
    if not fingers:
        return None
    output = core.pipeline.bake.Output(named if named in fingers else fingers[0], track.spec.key, track, {}, ())
    bake = core.pipeline.bake.Bake((output,), (), {}, "")
    result = store.Result(bake, streamed_track.origin(scene), None, ())
    frame = moment.frame_of(scene)
    return Preview(frame, "file", "from a track file", (device_preview.baked_row(result, output, frame),))

"""Bake: sample the animation, render every device, keep the tracks."""

from typing import Any

import bpy

from .. import baking, choices, jobs, reporting
from ..polls import needs
from ..preferences import library
from ..preview import device_preview
from ..results import store
from .work import counted


@needs(lambda context: context.mode in ("OBJECT", "POSE"), "Leave edit mode first")
class DERMIS_OT_bake(jobs.Job, bpy.types.Operator):
    """Compute the commands of every device on every finger over the frame range; Esc cancels"""

    bl_idname = "dermis.bake"
    bl_label = "Bake"
    bl_options = {"REGISTER"}
    job_title = "Bake"

    def steps(self, context: bpy.types.Context) -> Any:
        """Return sampling and rendering as one generator."""
        choices.refresh()  # the list of devices then shows the presets that this bake reads
        return _noting(context.scene)

    def finished(self, context: bpy.types.Context, result: Any) -> set[str]:
        """Keep the result in memory and outside the .blend; report its quality."""
        scene = context.scene
        device_preview.reset()
        result, taken = result
        found = baking.keep(scene, result, taken)
        tracks, skins = len(result.outputs), len(result.skins)
        parts = [counted(number, what) for number, what in ((tracks, "track"), (skins, "skin")) if number]
        done = f"Baked {' and '.join(parts) or 'nothing'}."
        reporting.report_findings(self, found, f"Bake of {scene.name}", done)
        return {"FINISHED"}


def _noting(scene: bpy.types.Scene) -> jobs.Steps:
    """Bake a scene; return the bake, and the state of the scene at sampling."""
    taken: list[store.Taken] = []
    made = yield from baking.bake(scene, library(), noted=taken.append)
    return made, taken[0]


CLASSES: tuple[type, ...] = (DERMIS_OT_bake,)

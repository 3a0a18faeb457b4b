"""Discriminability of a finger's touches, real and as devices render them.

An ideal observer compares them in pairs.
"""

from typing import Any

import bpy

from .. import baking, jobs, redraw
from ..comparison import told
from ..devices import active_presets
from ..polls import active_finger, needs
from ..preferences import library
from .work import Folder, counted


@needs(active_finger, "Select a finger")
class DERMIS_OT_tell_apart(jobs.Job, bpy.types.Operator):
    """Compute how often an ideal observer would tell two touches of this finger apart, for the real touches and for \
each device. Esc cancels"""

    bl_idname = "dermis.tell_apart"
    bl_label = "Compute Discriminability"
    bl_options = {"REGISTER"}
    job_title = "Discriminability"

    def steps(self, context: bpy.types.Context) -> Any:
        """Return the work."""
        return _found(context.scene, context.object.name_full)

    def finished(self, context: bpy.types.Context, result: Any) -> set[str]:
        """Keep it."""
        told.keep(context.scene, result)
        touches, devices = len(result.table["touches"]), len(result.table["rows"]) - 1
        self.report({"INFO"}, f"{touches} touches, {counted(devices, 'way')} to render them")
        redraw.request()
        return {"FINISHED"}


def _found(scene: bpy.types.Scene, finger: str) -> jobs.Steps:
    """Check the number of touches in a fresh bake, then compare them in pairs.

    If no bake solves the finger's skin, `told.find` checks the number itself.
    """
    own = scene.objects[finger].dermis.finger
    if own.skin.shown or any(device.enabled and active_presets.follows_skin(device.preset) for device in own.devices):
        yield from baking.prepared(scene, library())
        told.check_touches(scene, finger)
    return (yield from told.find(scene, finger))


@needs(lambda context: told.current(context.scene) is not None, "Compute the discriminability first")
class DERMIS_OT_save_told(Folder, bpy.types.Operator):
    """Write the table of discriminability into a folder, as CSV"""

    bl_idname = "dermis.save_told"
    bl_label = "Save Table"

    def work(self, context: bpy.types.Context) -> str | None:
        """Write the file."""
        made: Any = told.current(context.scene)
        return f"Wrote {told.save(made, self.folder())}"


CLASSES: tuple[type, ...] = (DERMIS_OT_tell_apart, DERMIS_OT_save_told)

# mypy: disable-error-code="valid-type"
"""Thimbles: adapt to this finger, draw the stimulus plot."""

from typing import Any

import bpy
from bpy.props import StringProperty

from .. import changes, jobs
from ..devices import thimble_adaptation, thimble_devices
from ..polls import needs
from ..results import thimble_plot
from .work import File, active_device


@needs(lambda context: active_device(context, "thimble"), "Select a finger with a thimble")
class DERMIS_OT_adapt_thimble(jobs.Job, bpy.types.Operator):
    """Learn what this finger's thimble does to its skin, for the methods Network and Polynomial; Esc cancels"""

    bl_idname = "dermis.adapt_thimble"
    bl_label = "Adapt to This Finger"
    bl_options = {"REGISTER"}
    job_title = "Adapt"

    def steps(self, context: bpy.types.Context) -> Any:
        """Return the work of a child process."""
        return thimble_adaptation.adapt(context.object)

    def finished(self, context: bpy.types.Context, result: Any) -> set[str]:
        """Say how good it is."""
        thimble_devices.forget()
        changes.mark_dirty(context.object.name)
        ridge, network = result["errors"].tolist()
        self.report(
            {"INFO"},
            f"Adapted on {int(result['samples'])} samples: test error of the network "
            f"{100 * network:.1f} %, of the polynomial {100 * ridge:.1f} %",
        )
        return {"FINISHED"}


@needs(lambda context: active_device(context, "thimble"), "Select a finger with a thimble")
class DERMIS_OT_plot_thimble(File, bpy.types.Operator):
    """Draw what this finger felt in the last bake in three components, beside all that the thimble can do"""

    bl_idname = "dermis.plot_thimble"
    bl_label = "Stimulus Plot"
    bl_options = {"REGISTER"}
    suffix = ".png"

    filepath: StringProperty(name="File", description="Picture to write, .png or .svg", subtype="FILE_PATH")
    filter_glob: StringProperty(default="*.png;*.svg", options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Propose a name, and ask for the file."""
        self.filepath = f"{bpy.path.clean_name(context.object.name)}.stimuli.png"
        return super().invoke(context, event)

    def work(self, context: bpy.types.Context) -> str | None:
        """Draw and write it."""
        return f"Wrote {thimble_plot.write(context.scene, context.object, self.path())}"


CLASSES: tuple[type, ...] = (DERMIS_OT_adapt_thimble, DERMIS_OT_plot_thimble)

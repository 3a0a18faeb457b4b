# mypy: disable-error-code="valid-type"
"""Thimbles: adapt to this finger, draw the stimulus plot."""

from typing import Any

import bpy
from bpy.props import StringProperty

from .. import changes, jobs, redraw
from ..devices import active_presets, thimble_adaptation, thimble_devices
from ..polls import active_finger, needs
from ..results import floors, plots, store
from .work import File, active_device, listed


def _searched(context: bpy.types.Context) -> Any | None:
    """Return the settings of the active finger's device whose pose is searched.

    It is a thimble or a platform on six legs; None without one.
    """
    finger = active_finger(context)
    return active_presets.searched_of(finger) if finger is not None else None


@needs(_searched, "Select a finger with a thimble, or with six legs matched by stress")
class DERMIS_OT_adapt_thimble(jobs.Job, bpy.types.Operator):
    """Learn the effect of this device on this finger's skin, for the methods Network and Polynomial. It takes about \
two minutes, and about four times as long for neo-Hookean tissue. Esc cancels"""

    bl_idname = "dermis.adapt_thimble"
    bl_label = "Adapt to This Finger"
    bl_options = {"REGISTER"}
    job_title = "Adapt"

    def steps(self, context: bpy.types.Context) -> Any:
        """Return the work of a child process."""
        return thimble_adaptation.adapt(context.object)

    def finished(self, context: bpy.types.Context, result: Any) -> set[str]:
        """Report the test errors."""
        thimble_devices.forget()
        changes.mark_beyond(context.object)
        ridge, network = result["errors"].tolist()
        self.report(
            {"INFO"},
            f"Adapted on {int(result['samples'])} samples: test error of the network "
            f"{100 * network:.1f} %, of the polynomial {100 * ridge:.1f} %",
        )
        return {"FINISHED"}


@needs(lambda context: active_device(context, "thimble"), "Select a finger with a thimble")
class DERMIS_OT_plot_thimble(File, bpy.types.Operator):
    """Draw this finger's touch in the last bake in three components, beside the range of the thimble"""

    bl_idname = "dermis.plot_thimble"
    bl_label = "Stimulus Plot"
    bl_options = {"REGISTER"}
    suffix = ".png"

    filepath: StringProperty(name="File", description="Picture to write, .png or .svg", subtype="FILE_PATH")
    filter_glob: listed("*.png;*.svg")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Propose a name, and ask for the file."""
        self.filepath = f"{bpy.path.clean_name(context.object.name)}.stimuli.png"
        return super().invoke(context, event)

    def work(self, context: bpy.types.Context) -> str | None:
        """Draw and write it."""
        return f"Wrote {plots.write_stimuli(context.scene, context.object, self.path())}"


@needs(lambda context: _searched(context) and store.current(context.scene) is not None, "Bake a finger with a thimble")
class DERMIS_OT_find_floor(jobs.Job, bpy.types.Operator):
    """Search all poses of this device for the smallest error of the baked touch, and the error with additional axes \
along the pad. Takes about a minute, and minutes for a long touch. Esc cancels"""

    bl_idname = "dermis.find_floor"
    bl_label = "Best Achievable Match"
    bl_options = {"REGISTER"}
    job_title = "Best pose"

    def steps(self, context: bpy.types.Context) -> Any:
        """Return the work."""
        return floors.find(context.scene, context.object)

    def finished(self, _context: bpy.types.Context, result: Any) -> set[str]:
        """Report the errors and the findings."""
        self.report({"INFO"}, ". ".join(result.words()))
        for finding in result.findings("device"):
            self.report({"WARNING"} if finding.severity == "warning" else {"INFO"}, str(finding))
        redraw.request()
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (DERMIS_OT_adapt_thimble, DERMIS_OT_find_floor, DERMIS_OT_plot_thimble)

# mypy: disable-error-code="valid-type"
"""Thimbles: adapt to this finger, draw the stimulus plot, the example scenes."""

from pathlib import Path
from typing import Any

import bpy
from bpy.props import EnumProperty, StringProperty

from .. import changes, choices, jobs, reporting
from ..demos import demo_skin, demo_thimble
from ..devices import thimble_adaptation, thimble_devices
from ..polls import needs
from ..results import thimble_plot
from .add import open_scene


def _worn(context: bpy.types.Context) -> Any:
    obj = context.object
    return thimble_devices.device_of(obj) if obj is not None and obj.dermis.role == "FINGER" else None


@needs(lambda context: _worn(context) is not None, "Select a finger with a thimble")
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


@needs(lambda context: _worn(context) is not None, "Select a finger with a thimble")
class DERMIS_OT_plot_thimble(bpy.types.Operator):
    """Draw what this finger felt in the last bake in three components, beside all that the thimble can do"""

    bl_idname = "dermis.plot_thimble"
    bl_label = "Stimulus Plot"
    bl_options = {"REGISTER"}

    filepath: StringProperty(name="File", description="Picture to write, .png or .svg", subtype="FILE_PATH")
    filter_glob: StringProperty(default="*.png;*.svg", options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the file."""
        self.filepath = f"{bpy.path.clean_name(context.object.name)}.stimuli.png"
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Draw and write it."""
        path = Path(bpy.path.abspath(self.filepath))
        try:
            thimble_plot.write(context.scene, context.object, path if path.suffix else path.with_suffix(".png"))
        except ValueError as error:  # the engine's refusals among them
            return reporting.report_error(self, error, self.bl_label)
        self.report({"INFO"}, f"Wrote {path}")
        return {"FINISHED"}


class DERMIS_OT_demo_thimble_scene(bpy.types.Operator):
    """Open one of the paper's touches in a scene of its own"""

    bl_idname = "dermis.demo_thimble_scene"
    bl_label = "Demo Thimble Scene"
    bl_options = {"REGISTER", "UNDO"}

    touch: EnumProperty(name="Touch", items=tuple((k, s.title, s.text) for k, s in demo_thimble.SCENES.items()))

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: Any) -> str:
        """Return what this touch is."""
        return demo_thimble.SCENES[properties.touch].text

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Build it and look at it."""
        choices.refresh()
        scene = demo_thimble.build(self.touch)
        return open_scene(
            self,
            scene,
            demo_skin.look,
            "Play the animation: twin, target and rendered skin. Bake keeps the servo angles",
        )


CLASSES: tuple[type, ...] = (DERMIS_OT_adapt_thimble, DERMIS_OT_plot_thimble, DERMIS_OT_demo_thimble_scene)

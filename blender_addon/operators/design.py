# mypy: disable-error-code="valid-type"
"""Platforms' tables, and 'How many motors?': touches, answer, picture, preset."""

from typing import Any

import bpy
from bpy.props import EnumProperty

from .. import baking, changes, jobs, reporting
from .._core import DermisError
from ..design import design_results
from ..devices import platform_devices
from ..panels import summary
from ..polls import needs
from ..preferences import library
from ..preview import device_preview, platform_preview
from ..results import store
from .work import File, Folder, Work, active_device, counted, listed, show_image


@needs(
    lambda context: active_device(context, "platform"), "Select a finger with a cable platform or a six-leg platform"
)
class DERMIS_OT_make_table(jobs.Job, bpy.types.Operator):
    """Sweep this finger's platform in simulation, so that touches can be looked up while you scrub; Esc cancels, and
    what was swept is kept"""

    bl_idname = "dermis.make_table"
    bl_label = "Make Table"
    bl_options = {"REGISTER"}
    job_title = "Table"

    def steps(self, context: bpy.types.Context) -> Any:
        """Return the sweep."""
        return platform_devices.make(context.object, active_device(context, "platform"))

    def finished(self, context: bpy.types.Context, result: Any) -> set[str]:
        """Report the size of the table."""
        changes.mark_beyond(context.object)
        platform_preview.reset()
        device_preview.reset()
        asked = result.meta.get("asked", len(result.commands))
        self.report({"INFO"}, f"Swept {asked:,} configurations; {len(result.commands) - 1:,} of them touch")
        return {"FINISHED"}


class DERMIS_OT_add_design_touch(File, bpy.types.Operator):
    """Add a touch that the motors have to render: this scene or a recording"""

    bl_idname = "dermis.add_design_touch"
    bl_label = "Add Touch"
    bl_options = {"REGISTER", "UNDO"}

    kind: EnumProperty(
        name="Kind",
        description="Source of the touch",
        items=(
            ("SCENE", "This Scene", "The bake of this scene"),
            ("BAKED", "All Baked Scenes", "Every baked scene of this file"),
            ("FILE", "Recording", "A CSV of a 20-channel sensor"),
        ),
    )
    filter_glob: listed("*.csv")

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: Any) -> str:
        """Return the tooltip of the button's own kind."""
        return {
            "SCENE": "Add the touch of this scene's bake",
            "BAKED": "Add the touches of every baked scene of this file",
            "FILE": "Add a touch from a CSV that a tactile sensor recorded",
        }[properties.kind]

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the file of a recording."""
        return super().invoke(context, event) if self.kind == "FILE" else self.execute(context)

    def work(self, context: bpy.types.Context) -> str | None:
        """Add it."""
        settings = context.scene.dermis_design
        if self.kind == "FILE":
            settings.touches.add().filepath = self.filepath
        else:
            wanted = [context.scene] if self.kind == "SCENE" else [s for s in bpy.data.scenes if store.current(s)]
            known = {t.scene for t in settings.touches}
            for scene in wanted:
                if scene not in known:
                    settings.touches.add().scene = scene
        settings.active_touch = max(len(settings.touches) - 1, 0)
        return None


@needs(lambda context: context.scene.dermis_design.touches)
class DERMIS_OT_remove_design_touch(bpy.types.Operator):
    """Remove the selected touch from the list"""

    bl_idname = "dermis.remove_design_touch"
    bl_label = "Remove Touch"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Remove it."""
        settings = context.scene.dermis_design
        settings.touches.remove(min(settings.active_touch, len(settings.touches) - 1))
        settings.active_touch = max(0, min(settings.active_touch, len(settings.touches) - 1))
        return {"FINISHED"}


@needs(
    lambda context: context.scene.dermis_design.touches or summary.of(context.scene).fingers,
    "Add a finger to this scene, or a recording to the list",
)
class DERMIS_OT_design(jobs.Job, bpy.types.Operator):
    """Find the fewest motors, and their coupling, with which the device renders the touches: this scene's where none \
are listed. Scenes without a fresh bake are baked first; Esc cancels"""

    bl_idname = "dermis.design"
    bl_label = "How Many Motors?"
    bl_options = {"REGISTER"}
    job_title = "How many motors"
    after_cancel = "bakes that were done are kept; nothing else was changed"

    def steps(self, context: bpy.types.Context) -> Any:
        """Return the work."""
        return _designed(context.scene)

    def finished(self, context: bpy.types.Context, result: Any) -> set[str]:
        """Write the new preset, draw the picture, and report the number of motors."""
        scene = context.scene
        if not scene.dermis_design.touches:
            scene.dermis_design.touches.add().scene = scene
        motors, n = result.motors(scene.dermis_design.rule), len(result.spec.channels)
        wanted = motors is not None or scene.dermis_design.motors > 0
        key = design_results.make_preset(scene, result) if wanted else ""
        design_results.keep(scene, result, key)
        said = f"All {n} motors leave too much to give a number" if motors is None else f"{motors} of {n} motors"
        done = f"{said}. New device preset: {key}" if key else said
        findings = (*result.findings, *(design_results.preset_findings(key) if key else ()))
        reporting.report_findings(self, findings, self.bl_label, done)
        show_image(context, bpy.data.images[design_results.IMAGE])
        return {"FINISHED"}


def _designed(scene: bpy.types.Scene) -> jobs.Steps:
    """Bake the listed scenes without a fresh bake, then find the fewest motors.

    If no scene is listed, this scene is.
    """
    design_results.checked_spec(scene)  # refuses a device before the long work, not after it
    for touched, _ in design_results.asked(scene):
        if touched is not None:
            yield from baking.prepared(touched, library())
    return (yield from design_results.find(scene))


@needs(lambda context: design_results.current(context.scene) is not None)
class DERMIS_OT_design_preset(Work, bpy.types.Operator):
    """Write the device preset again, for another rule or number of motors"""

    bl_idname = "dermis.design_preset"
    bl_label = "Write Preset"
    bl_options = {"REGISTER"}

    def work(self, context: bpy.types.Context) -> str | None:
        """Write it."""
        answer: Any = design_results.current(context.scene)
        key = design_results.make_preset(context.scene, answer.design)
        design_results.keep(context.scene, answer.design, key)
        findings = design_results.preset_findings(key)
        reporting.report_findings(self, findings, self.bl_label, f"New device preset: {key}")
        return None


@needs(lambda _context: design_results.IMAGE in bpy.data.images)
class DERMIS_OT_show_design(bpy.types.Operator):
    """Show the error against the number of motors in an Image Editor, or in a new window if none is open"""

    bl_idname = "dermis.show_design"
    bl_label = "Show Picture"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Find or open an Image editor."""
        image = bpy.data.images[design_results.IMAGE]
        if show_image(context, image) is None:
            self.report({"INFO"}, f"No window: the picture is {bpy.path.abspath(image.filepath)}")
        return {"FINISHED"}


@needs(lambda context: design_results.current(context.scene) is not None)
class DERMIS_OT_open_design(Work, bpy.types.Operator):
    """Open the picture's file, outside Blender"""

    bl_idname = "dermis.open_design"
    bl_label = "Open File"

    def work(self, context: bpy.types.Context) -> str | None:
        """Open it, if it is still there."""
        answer: Any = design_results.current(context.scene)
        if not answer.picture.is_file():
            raise DermisError(
                "the picture is no longer there", where=str(answer.picture), remedy="Press How Many Motors? again"
            )
        bpy.ops.wm.path_open(filepath=str(answer.picture))
        return None


@needs(lambda context: design_results.current(context.scene) is not None)
class DERMIS_OT_save_design(Folder, bpy.types.Operator):
    """Write the report as text, JSON and PNG, and the preset, into a folder"""

    bl_idname = "dermis.save_design"
    bl_label = "Save Report"

    def work(self, context: bpy.types.Context) -> str | None:
        """Write the files."""
        return f"Wrote {counted(len(design_results.save(context.scene, self.folder())))} to {self.directory}"


CLASSES: tuple[type, ...] = (
    DERMIS_OT_make_table,
    DERMIS_OT_add_design_touch,
    DERMIS_OT_remove_design_touch,
    DERMIS_OT_design,
    DERMIS_OT_design_preset,
    DERMIS_OT_show_design,
    DERMIS_OT_open_design,
    DERMIS_OT_save_design,
)

# mypy: disable-error-code="valid-type"
"""Export of tracks, sampled scenes and screen maps; loading of stored bakes."""

from pathlib import Path
from typing import Any, cast

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from .. import reporting
from .._core import DermisError, core
from ..polls import needs
from ..preferences import library
from ..properties import scene_properties
from ..results import export_parts, exported, store, stored_skins
from ..sampling import scene_sweep
from .checked import Checked
from .work import File, Folder, counted, listed

TOLD = ("refused", "name-shortened", "clipped", "open-loop", "constant-voltage")  # the bake has reported other findings


@needs(lambda context: store.current(context.scene) is not None, "Bake first")
class DERMIS_OT_export_tracks(Checked, Folder, bpy.types.Operator):
    """Write a track for each finger and device of the last bake, and a file of forces for each skin. A changed scene
    must be baked again"""

    bl_idname = "dermis.export_tracks"
    bl_label = "Export Tracks"
    bl_options = {"REGISTER"}
    subject = job_title = "Export"

    directory: StringProperty(
        name="Folder", description="Folder for the files. If empty, the scene's output folder", subtype="DIR_PATH"
    )
    form: EnumProperty(name="Format", description="Format of the files", items=scene_properties.FORMATS, default="csv")
    plots: BoolProperty(name="With Plots", description="Write a PNG plot beside each track", default=False)
    ask: BoolProperty(name="Ask", description="Ask for the folder", default=False, options={"HIDDEN", "SKIP_SAVE"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Write to the output folder, or ask for a folder.

        The person is asked on request, and if the output folder is relative and the file was never saved.
        """
        settings = context.scene.dermis
        self.form, self.plots = settings.export_format, settings.plots
        self.directory = ""
        unsaved = settings.output_dir.startswith("//") and not bpy.data.filepath
        if self.ask and not unsaved:
            self.directory = bpy.path.abspath(settings.output_dir)
        self._asked = True
        return Folder.invoke(self, context, event) if unsaved or self.ask else self.execute(context)

    def work(self, context: bpy.types.Context) -> str | None:
        """Write the files."""
        scene = context.scene
        folder = Path(bpy.path.abspath(self.directory or scene.dermis.output_dir))
        result = cast(store.Result, store.current(scene))
        if not folder.is_absolute():
            raise DermisError(
                "the path is relative to a file that was never saved",
                where="output folder",
                value=str(folder),
                remedy="Save the file, or choose another folder",
            )
        refused: list[Any] = []
        written: list[Path] = []
        if result.bake.outputs:
            # a CSV is written even with errors, which its header lists; other formats go to devices, and are refused
            written, found = export_parts.write(scene, result, folder, self.form, force=self.form == "csv")
            refused = [finding for finding in found if finding.code in TOLD]
            written += core.pipeline.outputs.write_plots(result.bake, folder) if self.plots else ()
        written += stored_skins.export(result.bake, folder)
        if not written:
            raise DermisError(
                "neither tracks nor skins to export",
                where=str(folder),
                remedy="Give a finger a device, or show its skin, and bake again",
            )
        exported.note(scene, folder, tuple(written))
        text = f"Wrote {counted(len(written))} to {folder}"
        if refused:
            reporting.report_findings(self, refused, f"Export of {scene.name}", f"{text}.")
            return None
        if store.state(scene) != "stale":
            return text
        self.report(
            {"WARNING"},
            f"{text}: frames {result.clock.first:g} to {result.last}, as baked; the range has changed since",
        )
        return None


@needs(lambda context: exported.last(context.scene) is not None, "Export first")
class DERMIS_OT_open_export(bpy.types.Operator):
    """Open the folder of the last export"""

    bl_idname = "dermis.open_export"
    bl_label = "Open Folder"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Open it."""
        last = cast(exported.Exported, exported.last(context.scene))
        if not last.folder.is_dir():
            self.report({"WARNING"}, f"{last.folder} is no longer there")
            return {"CANCELLED"}
        return set(bpy.ops.wm.path_open(filepath=str(last.folder)))


class DERMIS_OT_export_scene(File, bpy.types.Operator):
    """Sample the animation and save it. 'python -m core render' renders the file on a machine without Blender"""

    bl_idname = "dermis.export_scene"
    bl_label = "Save Sampled Scene"
    bl_options = {"REGISTER"}
    suffix = ".npz"

    filter_glob: listed("*.npz")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Propose a name, and ask for the file."""
        self.filepath = f"{bpy.path.clean_name(context.scene.name)}.npz"
        return super().invoke(context, event)

    def work(self, context: bpy.types.Context) -> str | None:
        """Sample and write."""
        path = self.path()
        tactile = scene_sweep.sample(context.scene)
        try:
            core.scene.scene_file.save(tactile, path)
        finally:
            tactile.chunks.close()
        found = (*tactile.findings, *tactile.chunks.findings)
        reporting.report_findings(self, found, self.bl_label, f"Wrote {path}.")
        return None


@needs(lambda context: any(o.dermis.role == "SCREEN" for o in context.scene.objects), "Add a touch screen first")
class DERMIS_OT_export_screen_maps(Folder, bpy.types.Operator):
    """Write the relief and the friction law of each touch screen, for a real screen that tracks a person's finger"""

    bl_idname = "dermis.export_screen_maps"
    bl_label = "Export Screen Maps"
    bl_options = {"REGISTER"}

    directory: StringProperty(
        name="Folder", description="Folder for the files. If empty, the scene's output folder", subtype="DIR_PATH"
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Propose the scene's output folder, and ask."""
        self.directory = bpy.path.abspath(context.scene.dermis.output_dir) if bpy.data.filepath else ""
        return super().invoke(context, event)

    def work(self, context: bpy.types.Context) -> str | None:
        """Write the files."""
        folder = Path(bpy.path.abspath(self.directory or context.scene.dermis.output_dir))
        scene = scene_sweep.sample_now(context.scene, context.evaluated_depsgraph_get())
        written = core.pipeline.outputs.export_screen_maps(scene, library(), folder)
        return f"Wrote {counted(len(written))} to {folder}"


class DERMIS_OT_load_result(bpy.types.Operator):
    """Read the stored result of this scene's last bake"""

    bl_idname = "dermis.load_result"
    bl_label = "Show Stored Bake"
    bl_options = {"REGISTER"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Read it."""
        scene: Any = context.scene
        try:
            result = store.load(scene)
        except DermisError as error:
            return reporting.report_error(self, error, "Stored bake")
        if result is None:
            scene.dermis.bake_key = scene.dermis.bake_owners = ""
            self.report({"WARNING"}, "The stored bake is gone; bake again")
            return {"CANCELLED"}
        now = cast(store.Result, store.current(scene))  # with the current names of fingers
        reporting.show(now.bake.all_findings, f"Stored bake of {scene.name}")
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (
    DERMIS_OT_export_tracks,
    DERMIS_OT_open_export,
    DERMIS_OT_export_scene,
    DERMIS_OT_export_screen_maps,
    DERMIS_OT_load_result,
)

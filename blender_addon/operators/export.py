# mypy: disable-error-code="valid-type"
"""Files: tracks as CSV, the sampled scene, the stored result of an earlier session."""

from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, StringProperty

from .. import reporting
from .._core import DermisError, core
from ..polls import needs
from ..preferences import library
from ..properties import scene_properties
from ..results import store, stored_skins
from ..sampling import scene_sweep


@needs(lambda context: store.current(context.scene) is not None, "Bake first")
class DERMIS_OT_export_tracks(bpy.types.Operator):
    """Write one CSV file for each finger and device of the last bake, and one for the forces on each skin"""

    bl_idname = "dermis.export_tracks"
    bl_label = "Export Tracks"
    bl_options = {"REGISTER"}

    directory: StringProperty(
        name="Folder", description="Where the files go; empty: the scene's output folder", subtype="DIR_PATH"
    )
    plots: BoolProperty(name="With Plots", description="Write a PNG plot beside each track", default=False)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Write to the scene's output folder; ask where that is relative to a file that was never saved."""
        settings = context.scene.dermis
        self.plots = settings.plots
        self.directory = ""
        if settings.output_dir.startswith("//") and not bpy.data.filepath:
            context.window_manager.fileselect_add(self)
            return {"RUNNING_MODAL"}
        return self.execute(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write the files."""
        outputs = core.pipeline.outputs
        scene = context.scene
        folder = Path(bpy.path.abspath(self.directory or scene.dermis.output_dir))
        result = store.current(scene)
        if result is None:
            self.report({"ERROR"}, "Bake first")
            return {"CANCELLED"}
        try:
            if not folder.is_absolute():
                raise DermisError(
                    "relative to a file that was never saved",
                    where="output folder",
                    value=str(folder),
                    remedy="Save the file, or choose another folder",
                )
            written = list(outputs.export(result.bake, folder, plots=self.plots)) if result.bake.outputs else []
            written += stored_skins.export(result.bake, folder)
            if not written:
                raise DermisError(
                    "neither tracks nor skins to export",
                    where=str(folder),
                    remedy="Give a finger a device, or show its skin, and bake again",
                )
        except DermisError as error:
            return reporting.report_error(self, error, "Export")
        text = f"Wrote {len(written)} file{'' if len(written) == 1 else 's'} to {folder}"
        if store.state(scene) == "stale":
            self.report({"WARNING"}, f"{text}. The scene has changed since the bake")
        else:
            self.report({"INFO"}, text)
        return {"FINISHED"}


class DERMIS_OT_export_scene(bpy.types.Operator):
    """Sample the animation and save it for 'python -m core render', for a machine without Blender"""

    bl_idname = "dermis.export_scene"
    bl_label = "Save Sampled Scene"
    bl_options = {"REGISTER"}

    filepath: StringProperty(name="File", subtype="FILE_PATH")
    filter_glob: StringProperty(default="*.npz", options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the file."""
        self.filepath = f"{bpy.path.clean_name(context.scene.name)}.npz"
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Sample and write."""
        path = Path(bpy.path.abspath(self.filepath))
        if not path.suffix:
            path = path.with_suffix(".npz")
        try:
            tactile = scene_sweep.sample(context.scene)
            try:
                core.scene.scene_file.save(tactile, path)
            finally:
                tactile.chunks.close()
        except DermisError as error:
            return reporting.report_error(self, error, "Save Sampled Scene")
        found = (*tactile.findings, *tactile.chunks.findings)
        reporting.report_findings(self, found, "Save Sampled Scene", f"Wrote {path}.")
        return {"FINISHED"}


@needs(lambda context: any(o.dermis.role == "SCREEN" for o in context.scene.objects), "Add a touch screen first")
class DERMIS_OT_export_screen_maps(bpy.types.Operator):
    """Write each touch screen's relief and law of friction, for a screen that answers to a real finger"""

    bl_idname = "dermis.export_screen_maps"
    bl_label = "Export Screen Maps"
    bl_options = {"REGISTER"}

    directory: StringProperty(
        name="Folder", description="Where the files go; empty: the scene's output folder", subtype="DIR_PATH"
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the folder."""
        self.directory = bpy.path.abspath(context.scene.dermis.output_dir) if bpy.data.filepath else ""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write the files."""
        outputs = core.pipeline.outputs
        folder = Path(bpy.path.abspath(self.directory or context.scene.dermis.output_dir))
        try:
            scene = scene_sweep.sample_now(context.scene, context.evaluated_depsgraph_get())
            written = outputs.export_screen_maps(scene, library(), folder)
        except DermisError as error:
            return reporting.report_error(self, error, "Export Screen Maps")
        self.report({"INFO"}, f"Wrote {len(written)} file{'' if len(written) == 1 else 's'} to {folder}")
        return {"FINISHED"}


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
            scene.dermis.bake_key = scene_properties.DermisScene.bl_rna.properties["bake_key"].default
            self.report({"WARNING"}, "The stored bake is gone; bake again")
            return {"CANCELLED"}
        reporting.show(result.bake.all_findings, f"Stored bake of {scene.name}")
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (
    DERMIS_OT_export_tracks,
    DERMIS_OT_export_scene,
    DERMIS_OT_export_screen_maps,
    DERMIS_OT_load_result,
)

# mypy: disable-error-code="valid-type"
"""Go to the object of a finding; open and clear the extension's folders."""

import bpy
from bpy.props import IntProperty

from .. import reporting, scene_time
from ..preferences import presets_folder
from ..results import store
from .work import select_only


class DERMIS_OT_go_to_finding(bpy.types.Operator):
    """Go to the frame of this finding and select its object"""

    bl_idname = "dermis.go_to_finding"
    bl_label = "Show"
    bl_options = {"REGISTER", "UNDO"}

    index: IntProperty(name="Finding", description="Place in the list of findings", default=0, min=0)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set frame and selection."""
        findings = reporting.findings()
        if self.index >= len(findings):
            self.report({"WARNING"}, "That finding is no longer in the list")
            return {"CANCELLED"}
        finding = findings[self.index]
        if finding.frame is not None:
            scene_time.go_to(context.scene, finding.frame)
        obj = reporting.about(finding, context.scene)
        if obj is not None and obj.visible_get():
            select_only(context, obj)
        return {"FINISHED"}


class DERMIS_OT_open_presets(bpy.types.Operator):
    """Open the folder of your own presets. Put devices/NAME.json or materials/NAME.json there"""

    bl_idname = "dermis.open_presets"
    bl_label = "Open Presets Folder"

    def execute(self, _context: bpy.types.Context) -> set[str]:
        """Make the folders if needed and open them."""
        folder = presets_folder()
        for group in ("devices", "materials"):
            (folder / group).mkdir(parents=True, exist_ok=True)
        bpy.ops.wm.path_open(filepath=str(folder))
        return {"FINISHED"}


class DERMIS_OT_clear_results(bpy.types.Operator):
    """Delete the stored bakes of every file. Exported tracks stay"""

    bl_idname = "dermis.clear_results"
    bl_label = "Delete Stored Bakes"

    def execute(self, _context: bpy.types.Context) -> set[str]:
        """Empty the folder."""
        store.cache().clear()
        self.report({"INFO"}, "Deleted the stored bakes")
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (DERMIS_OT_go_to_finding, DERMIS_OT_open_presets, DERMIS_OT_clear_results)

# mypy: disable-error-code="valid-type"
"""Compare Devices: one finger's touch as every device renders it.

The result is a table, a CSV and a page.
"""

from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty

from .. import jobs, redraw
from ..comparison import compared
from ..polls import active_finger, needs
from .work import Folder, Work, counted


@needs(active_finger, "Select a finger")
class DERMIS_OT_compare_devices(jobs.Job, bpy.types.Operator):
    """Compute the error of every suitable device for this finger's touch. Esc cancels"""

    bl_idname = "dermis.compare_devices"
    bl_label = "Compare Devices"
    bl_options = {"REGISTER"}
    job_title = "Compare devices"

    floors: BoolProperty(
        name="Floors",
        description="Also compute the smallest error of any pose, for thimbles and six-leg platforms. Takes about a "
        "minute, and minutes for a long touch",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: Any) -> str:
        """Return the tooltip: that of *With Floors* also says what it adds."""
        if not properties.floors:
            return ""
        return (
            "Compute the error of every suitable device, and the smallest error of any pose of thimbles and six-leg "
            "platforms. Takes about a minute, and minutes for a long touch. Esc cancels"
        )

    def steps(self, context: bpy.types.Context) -> Any:
        """Return the work."""
        return compared.find(context.scene, context.object.name_full, floors=self.floors)

    def finished(self, context: bpy.types.Context, result: Any) -> set[str]:
        """Keep the comparison, and name the best device."""
        compared.keep(context.scene, result)
        rows = result.table["rows"]
        best, skipped = rows[0], len(result.table["skipped"])
        measure = best["measures"][0]
        said = f"{counted(len(rows), 'device')}, {skipped} skipped. {best['title']}: {measure['name']} "
        self.report({"INFO"}, f"{said}{100 * measure['off']:.0f} % off")
        redraw.request()
        return {"FINISHED"}


@needs(lambda context: compared.current(context.scene) is not None, "Compare devices first")
class DERMIS_OT_save_comparison(Folder, bpy.types.Operator):
    """Write the comparison into a folder: a table as CSV and a page of HTML that contains its pictures"""

    bl_idname = "dermis.save_comparison"
    bl_label = "Save Comparison"

    def work(self, context: bpy.types.Context) -> str | None:
        """Write the files."""
        made: Any = compared.current(context.scene)
        return f"Wrote {counted(len(compared.save(made, self.folder())))} to {self.directory}"


@needs(lambda context: compared.current(context.scene) is not None, "Compare devices first")
class DERMIS_OT_open_comparison(Work, bpy.types.Operator):
    """Open the comparison in the browser, with pictures of the target and the rendered touch for each device"""

    bl_idname = "dermis.open_comparison"
    bl_label = "Open Page"

    def work(self, context: bpy.types.Context) -> str | None:
        """Write it among Blender's temporary files, and open it."""
        made: Any = compared.current(context.scene)
        page = compared.save(made, Path(bpy.app.tempdir))[1]
        if not bpy.app.background:
            bpy.ops.wm.path_open(filepath=str(page))
        return f"Wrote {page}"


CLASSES: tuple[type, ...] = (DERMIS_OT_compare_devices, DERMIS_OT_save_comparison, DERMIS_OT_open_comparison)

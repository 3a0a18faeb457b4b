"""A finger's pin array: the press test, and the errors of the methods."""

import bpy

from ..layouts import paragraph
from ..polls import needs
from ..results import pin_reports
from ..viewport import shown
from .main import DermisPanel


@needs(lambda context: shown.active_device(context.scene, context.object, "pins") is not None)
class DERMIS_PT_pins(DermisPanel, bpy.types.Panel):
    """Calibration and comparison."""

    bl_idname = "DERMIS_PT_pins"
    bl_label = "Pin Array"
    bl_parent_id = "DERMIS_PT_devices"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the personal factor and the table."""
        layout, obj = self.layout, context.object
        row = layout.row(align=True)
        row.operator("dermis.press_test", icon="FORCE_FORCE")
        row.prop(obj.dermis.finger.skin, "alpha", text="")
        fit = pin_reports.calibrated.get(obj.session_uid)
        if fit is not None and abs(fit.alpha - obj.dermis.finger.skin.alpha) < 1e-6:
            known = f" ± {fit.standard_error:.3f}" if fit.standard_error == fit.standard_error else ""
            layout.label(text=f"Measured: {fit.alpha:.3f}{known}, readings within {1e3 * fit.residual:.0f} mN")
        layout.operator("dermis.compare_pins", icon="SPREADSHEET")
        reports = pin_reports.shown(context.scene, obj)
        if not reports:
            text = "After a bake: how far the skin would be from the target under each method."
            paragraph(layout, context, text, "INFO")
            return
        grid = layout.grid_flow(row_major=True, columns=4, even_columns=False, align=True)
        for text in ("", "mm off", "of target", "shear / N"):
            grid.label(text=text)
        for report in reports:
            grid.label(text=report.method)
            grid.label(text=f"{1e3 * report.displacement_error:.2f}")
            grid.label(text=f"{100 * report.displacement_share:.0f} %")
            grid.label(text=f"{report.shear_ratio:.2f}")
        first = reports[0]
        layout.label(text=f"Wanted: {first.target_normal:.2f} N, shear / N {first.target_ratio:.2f}")
        for finding in pin_reports.doubts(context.scene, obj):
            paragraph(layout, context, f"{finding.what}. {finding.remedy}.", "ERROR")


CLASSES: tuple[type, ...] = (DERMIS_PT_pins,)

"""A finger's pin array: the press test, and the errors of the methods."""

import bpy

from ..layouts import paragraph
from ..polls import needs
from ..results import pin_reports
from ..viewport import shown
from .main import DermisPanel, chosen


@needs(
    lambda context: chosen(context, "pins") and shown.active_device(context.scene, context.object, "pins") is not None
)
class DERMIS_PT_pins(DermisPanel, bpy.types.Panel):
    """Calibration and comparison."""

    bl_idname = "DERMIS_PT_pins"
    bl_label = "Pin Array"
    bl_parent_id = "DERMIS_PT_devices"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the personal factor and the table."""
        layout, obj = self.layout, context.object
        column = layout.column(align=True)
        column.operator("dermis.press_test", icon="FORCE_FORCE")
        column.prop(obj.dermis.finger.skin, "alpha")
        fit = pin_reports.calibrated.get(obj.session_uid)
        if fit is not None and abs(fit.alpha - obj.dermis.finger.skin.alpha) < 1e-6:
            known = f" ± {fit.standard_error:.3f}" if fit.standard_error == fit.standard_error else ""
            layout.label(text=f"Measured: {fit.alpha:.3f}{known}, readings within {1e3 * fit.residual:.0f} mN")
        layout.operator("dermis.compare_pins", icon="SPREADSHEET")
        reports = pin_reports.shown(context.scene, obj)
        if not reports:
            text = "After a bake, this button computes the error of each method."
            paragraph(layout, context, text, "INFO")
            return
        grid = layout.grid_flow(row_major=True, columns=4, even_columns=False, align=True)
        for text in ("", "error mm", "error %", "shear/N"):
            grid.label(text=text)
        for report in reports:
            grid.label(text=report.method)
            grid.label(text=f"{1e3 * report.displacement_error:.2f}")
            grid.label(text=f"{100 * report.displacement_share:.0f}")
            grid.label(text=f"{report.shear_ratio:.2f}")
        first = reports[0]
        layout.label(text=f"Target: {first.target_normal:.2f} N, shear/N {first.target_ratio:.2f}")
        paragraph(
            layout,
            context,
            "Shear/N: shear force divided by normal force. DM matches the deformation, FM the forces. With 0, pins may "
            "also pull, which they cannot.",
        )
        for finding in pin_reports.doubts(context.scene, obj):
            paragraph(layout, context, f"{finding.what}. {finding.remedy}.", "ERROR")


CLASSES: tuple[type, ...] = (DERMIS_PT_pins,)

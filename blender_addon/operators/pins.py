# mypy: disable-error-code="valid-type"
"""Pin arrays: press test of a person's stiffness, errors of the methods."""

from typing import Any

import bpy
from bpy.props import FloatProperty

from .. import changes, jobs
from .._core import core
from ..devices import skin_models
from ..polls import active_finger, needs
from ..properties import skin_properties
from ..results import pin_reports
from .work import Work, active_device

DEPTHS_MM = (0.5, 1.0, 1.5, 2.0)  # Source: [S1] section IV.D


def _load(depth: float) -> Any:
    return FloatProperty(
        name=f"Load at {depth:g} mm [N]",
        default=0.0,
        description="Reading of the scale with the finger pressed to this depth. 0 if not read",
        min=-1e3,
        max=1e3,
        soft_min=0.0,
        soft_max=20.0,
        precision=3,
    )


@needs(active_finger, "Select a finger")
class DERMIS_OT_press_test(Work, bpy.types.Operator):
    """Enter the loads of a press test. They give the finger's personal factor, that is, this person's stiffness"""

    bl_idname = "dermis.press_test"
    bl_label = "Press Test"
    bl_options = {"REGISTER", "UNDO"}

    load_1: _load(DEPTHS_MM[0])
    load_2: _load(DEPTHS_MM[1])
    load_3: _load(DEPTHS_MM[2])
    load_4: _load(DEPTHS_MM[3])

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the loads."""
        return context.window_manager.invoke_props_dialog(self, width=320)

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw the fields."""
        column = self.layout.column()
        column.label(text="Press the finger flat and read the scale:")
        column.use_property_split = True
        for k in range(len(DEPTHS_MM)):
            column.prop(self, f"load_{k + 1}")

    def work(self, context: bpy.types.Context) -> str | None:
        """Fit the factor and give it to the finger."""
        loads = [getattr(self, f"load_{k + 1}") for k in range(len(DEPTHS_MM))]
        read = [(1e-3 * d, f) for d, f in zip(DEPTHS_MM, loads, strict=True) if f != 0.0]
        skin = context.object.dermis.finger.skin
        values = skin_properties.parameters(skin)
        with skin_models.one_thread():
            model: Any = skin_models.of({**values, "skin": {**values["skin"], "alpha": 1.0}}, wait=True)
            depths = [d for d, _ in read]
            modelled: Any = (
                core.matching.press_test.press_loads(model, depths, contact=values["contact"]) if depths else []
            )
        fit = core.matching.press_test.stiffness_factor(depths, [f for _, f in read], modelled)
        skin.alpha = fit.alpha
        changes.mark_dirty(context.object.name)
        pin_reports.calibrated[context.object.session_uid] = fit
        low, high = core.matching.press_test.PAPER_RANGE
        spread = f" ± {fit.standard_error:.3f}" if fit.standard_error == fit.standard_error else ""
        return f"Personal factor {fit.alpha:.3f}{spread} (the paper reports {low} to {high})"


@needs(lambda context: active_device(context, "pins"), "Select a finger with a pin array")
class DERMIS_OT_compare_pins(jobs.Job, bpy.types.Operator):
    """Compute the error of each matching method for this finger's touch in the last bake. Esc cancels"""

    bl_idname = "dermis.compare_pins"
    bl_label = "Compare Methods"
    bl_options = {"REGISTER"}
    job_title = "Compare methods"

    def steps(self, context: bpy.types.Context) -> Any:
        """Return the work."""
        return pin_reports.find(context.scene, context.object)

    def finished(self, context: bpy.types.Context, reports: Any) -> set[str]:
        """Name the best of the methods that keep the limits of the pins."""
        print(core.matching.pin_report.table(reports))
        for finding in pin_reports.doubts(context.scene, context.object):
            self.report({"WARNING"}, str(finding).removeprefix("warning: "))
        best = min((r for r in reports if not r.method.endswith("0")), key=lambda r: r.displacement_error)
        said = f"{best.method} has the smallest error, {1e3 * best.displacement_error:.2f} mm"
        self.report({"INFO"}, f"Of the methods that keep the limits of the pins, {said}")
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (DERMIS_OT_press_test, DERMIS_OT_compare_pins)

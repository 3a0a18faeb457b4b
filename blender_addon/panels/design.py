"""Platforms on a finger, and 'How many motors?': touches, answer, couplings."""

from typing import Any

import bpy
import numpy as np

from .. import choices
from .._core import core
from ..demos import touches
from ..design import design_results
from ..devices import readiness
from ..layouts import paragraph, properties
from ..polls import needs
from ..results import store
from ..viewport import shown
from . import searched
from .main import DermisPanel, chosen

UNREADY = {"none": "Not baked", "stale": "Bake out of date", "earlier": "Baked in an earlier session"}


def settings(layout: Any, context: bpy.types.Context, device: Any) -> None:
    """Draw the settings of a platform, for the panel of device settings."""
    six = choices.kind_of(device.preset) == "hexapod"
    column = properties(layout, device, "platform_method") if six else properties(layout, device)
    if six and device.platform_method != core.matching.thimble_use.LOOKUP:
        if device.platform_method in core.matching.thimble_use.LEARNED:
            column.prop(device, "thimble_surrogate")
        column.prop(device, "thimble_hover_mm")
        return
    column.prop(device, "table")
    if not device.table:
        column.prop(device, "table_rows")


@needs(
    lambda context: (
        chosen(context, "platform") and shown.active_device(context.scene, context.object, "platform") is not None
    )
)
class DERMIS_PT_platform(DermisPanel, bpy.types.Panel):
    """A finger's platform: the state of its table, or of the search.

    For six legs whose pose is searched for, it tells how far the rendered skin is off the target.
    """

    bl_idname = "DERMIS_PT_platform"
    bl_label = "Platform"
    bl_parent_id = "DERMIS_PT_devices"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the state of the table and, without one, the button that makes it.

        For a pose that is searched for, draw its adaptation and its errors instead.
        """
        layout, obj = self.layout, context.object
        device = shown.active_device(context.scene, obj, "platform")
        if device is not None and choices.kind_of(device.preset) == "hexapod":
            column = layout.column()
            column.use_property_split = True
            column.prop(device, "platform_method")
        if device is not None and shown.active_device(context.scene, obj, readiness.SEARCHED) == device:
            searched.adaptation(layout, context, obj, "platform", device.platform_method)
            layout.prop(context.scene.dermis.thimble_view, "split", toggle=True, icon="MOD_MIRROR")
            searched.skin_and_mismatch(layout, context, obj, device)
            searched.floor(layout, context, obj, device)
            return
        ready = shown.ready(context.scene, obj, "platform")
        if ready is not None and ready.trouble:
            paragraph(layout, context, ready.trouble, "ERROR")
            return
        table = ready.figures if ready is not None else None
        if table is not None:
            touching = len(table.commands) - 1
            layout.label(text=f"Table: {touching:,} configurations that touch", icon="CHECKMARK")
        else:
            rows = device.table_rows if device is not None else 0
            text = f"Scrubbing needs a table of what this platform does to this finger's skin: {rows:,} configurations"
            paragraph(layout, context, f"{text}, swept in simulation. A bake makes it by itself.", "INFO")
            layout.operator("dermis.make_table", icon="FILE_CACHE")


class DERMIS_UL_design_touches(bpy.types.UIList):
    """Touches that the motors shall render."""

    bl_idname = "DERMIS_UL_design_touches"

    def draw_item(
        self, _context: Any, layout: Any, _data: Any, item: Any, _icon: int, _active: Any, _property: str, _index: int
    ) -> None:
        """Draw one touch; mark a scene without a fresh bake."""
        if item.scene is None:
            layout.prop(item, "filepath", text="", emboss=False, icon="FILE")
            return
        row = layout.row()
        row.label(text=item.scene.name, icon="SCENE_DATA")
        if store.state(item.scene) != "fresh":  # words beside it would cut off the scene's name
            row.label(text="", icon="ERROR")


@needs(lambda _context: True)
class DERMIS_PT_design(DermisPanel, bpy.types.Panel):
    """How few motors render these touches."""

    bl_idname = "DERMIS_PT_design"
    bl_label = "How Many Motors?"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the touches, the settings and the answer."""
        layout, scene = self.layout, context.scene
        own = scene.dermis_design
        if not own.touches:
            paragraph(layout, context, "Choose touches that a device has to render with as few motors as possible.")
        else:
            row = layout.row()
            row.template_list(
                "DERMIS_UL_design_touches",
                "",
                own,
                "touches",
                own,
                "active_touch",
                rows=max(2, min(len(own.touches), 6)),
            )
            row.operator("dermis.remove_design_touch", text="", icon="REMOVE")
            _unready(layout, context, own.touches)
        row = layout.row(align=True)
        for kind, text in (("SCENE", "This Scene"), ("BAKED", "All Baked"), ("FILE", "Recording")):
            row.operator("dermis.add_design_touch", text=text).kind = kind
        layout.prop(own, "device_name", text="", icon="CON_KINEMATIC")  # over the whole width: names are long
        column = properties(layout, own, "table", keys=False)
        if not own.table:
            column.prop(own, "table_rows")
        column.prop(own, "noise")
        column = layout.column()
        column.scale_y = 1.35
        column.operator("dermis.design", icon="CON_KINEMATIC")
        answer = design_results.current(scene)
        if answer is not None:
            self._answer(context, answer)

    def _answer(self, context: bpy.types.Context, answer: "design_results.Answer") -> None:
        layout, own, design = self.layout, context.scene.dermis_design, answer.design
        reduction, n = design.joint, len(design.spec.channels)
        motors = design.motors(own.rule)
        box = layout.box()
        if motors is None:
            poor = ", ".join(design.poor)
            paragraph(
                box, context, f"No recommendation: even all {n} motors render {poor} with too large an error", "ERROR"
            )
        else:
            box.label(text=f"{motors} of {n} motors" if motors < n else f"All {n} motors", icon="CHECKMARK")
        grid = box.grid_flow(row_major=True, columns=n + 1, even_columns=False, align=True)
        for text in ("motors", *map(str, range(1, n + 1))):
            grid.label(text=text)
        for text in ("error %", *(f"{p:.1f}" for p in reduction.mean_percent(own.rule))):
            grid.label(text=text)
        for text in ("part %", *(f"{100 * p:.1f}" for p in reduction.components.explained)):
            grid.label(text=text)
        above, below = (100.0 * limit for limit in reduction.limits(own.rule))
        share = "percent of the touch's size" if own.rule == "touch" else "percent of the error with all motors"
        upto = f"from {above:.1f} to {below:.0f} %" if below < float("inf") else f"from {above:.1f} % up"
        paragraph(
            box, context, f"Error: excess over the error with all motors, in {share}, as a mean over the touches."
        )
        paragraph(box, context, "Part: share of the movement that the motor of this column alone explains.")
        if motors is not None:
            paragraph(box, context, f"The number of motors would be the same for any limit of this error {upto}.")
        for name, (count, apart), touch in zip(design.names, design.repetitions, reduction.touch.tolist(), strict=True):
            if count > 1:
                again = f"its {count} repetitions differ by {100.0 * apart / touch:.0f} % of its size"
                paragraph(box, context, f"{name}: {again}")
        if not design.low_rank(own.rule):
            paragraph(
                box,
                context,
                "Not of low rank: with fewer motors, the error exceeds the limit, or the movement is not explained.",
                "INFO",
            )
        count = min(own.motors or motors or n, n)
        self._couplings(context, box, design, reduction, count)
        row = layout.row(align=True)
        row.operator("dermis.show_design", icon="IMAGE_DATA")
        row.operator("dermis.open_design", text="", icon="FILE_IMAGE")
        paragraph(layout, context, f"Picture: {answer.picture}", "BLANK1")
        properties(layout, own, "rule", "motors", keys=False)
        row = layout.row(align=True)
        row.operator("dermis.design_preset", icon="PRESET_NEW")
        row.operator("dermis.save_design", icon="EXPORT")
        if answer.preset:
            paragraph(layout, context, f"Preset: {answer.preset}, in Add Device", "CHECKMARK")

    def _couplings(self, context: bpy.types.Context, box: Any, design: Any, reduction: Any, count: int) -> None:
        directions = reduction.components.directions[:, :count]
        radius = design.spec.parameters.get("pulley_radius")
        pulleys = isinstance(radius, float)
        box.label(text="Pulley radii [mm], per cable" if pulleys else "Coupling, per leg")
        for j in range(count):
            column = directions[:, j]
            shown = 1e3 * radius * column / np.abs(column).max() if pulleys else column
            words = "  ".join(f"{v:+.2f}" for v in shown.tolist())
            box.label(text=f"motor {j + 1}:  {words}", icon="BLANK1")
        if count == reduction.motors():
            for words in design.shared.words():
                what = f"Cables {words} may share a pulley" if pulleys else f"Legs {words} may share a lever"
                box.label(text=what, icon="LINKED")
            if design.shared.groups:
                parts, percent = "pulleys" if pulleys else "levers", design.shared.percent
                more = f"the error exceeds that with all motors by {percent:.1f} % of the touch's size"
                paragraph(box, context, f"With shared {parts}, {more}.")


def _unready(layout: Any, context: bpy.types.Context, touches_of: Any) -> None:
    """Draw the names of the listed scenes that have no up-to-date bake."""
    scenes: dict[str, list[str]] = {}
    for item in touches_of:
        if item.scene is not None:
            scenes.setdefault(store.state(item.scene), []).append(item.scene.name)
    for state, words in UNREADY.items():
        if state in scenes:
            paragraph(layout, context, f"{words}: {', '.join(scenes[state])}.", "ERROR")


class DERMIS_MT_motors_demos(bpy.types.Menu):
    """The six interactions."""

    bl_idname = "DERMIS_MT_motors_demos"
    bl_label = "Six Interactions"

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw an entry for each interaction."""
        for key, (title, _) in touches.MOTORS.items():
            self.layout.operator("dermis.demo_motors_scene", text=title, icon="SCENE_DATA").touch = key


OBJECT: tuple[type, ...] = (DERMIS_PT_platform,)
SCENE: tuple[type, ...] = (DERMIS_UL_design_touches, DERMIS_PT_design, DERMIS_MT_motors_demos)

"""A finger's thimble: its settings, whether it is adapted, how far it is off now."""

from typing import Any

import bpy

from .._core import core
from ..demos import demo_thimble
from ..layouts import paragraph, properties
from ..polls import needs
from ..preview import thimble_preview
from ..viewport import shown
from .main import DermisPanel


def settings(layout: Any, context: bpy.types.Context, device: Any) -> None:
    """Draw what a thimble can be told, for the panel of device settings."""
    column = properties(layout, device, "thimble_method")
    if device.thimble_method in core.matching.thimble_use.LEARNED:
        column.prop(device, "thimble_surrogate")
    column.prop(device, "thimble_hover_mm")
    column.prop(device, "thimble_calibrated")
    if device.thimble_calibrated:
        felt = column.column(align=True)
        for i in (1, 2, 3):
            felt.prop(device, f"thimble_felt_{i}")
        paragraph(layout, context, "Turn the servos, in the Stream panel, until the disc is first felt.", "INFO")


@needs(lambda context: shown.active_device(context.scene, context.object, "thimble") is not None)
class DERMIS_PT_thimble(DermisPanel, bpy.types.Panel):
    """Method, adaptation, mismatch and what the view shows."""

    bl_idname = "DERMIS_PT_thimble"
    bl_label = "Thimble"
    bl_parent_id = "DERMIS_PT_devices"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the adaptation's state, the mismatch of this frame and the view's switches."""
        layout, obj = self.layout, context.object
        device, view = shown.active_device(context.scene, obj, "thimble"), context.scene.dermis.thimble_view
        column = layout.column()
        column.use_property_split = True
        column.prop(device, "thimble_method")
        self._adaptation(context, obj, device)
        row = layout.row(align=True)
        row.prop(view, "split", toggle=True, icon="MOD_MIRROR")
        row.prop(view, "workspace", toggle=True, icon="MESH_UVSPHERE")
        if not obj.dermis.finger.skin.shown:
            column = layout.column(align=True)
            paragraph(column, context, "Show the finger's skin to see target and rendered skin side by side.", "INFO")
            column.prop(obj.dermis.finger.skin, "shown", text="Show Skin", toggle=True)
        now = shown.now(context.scene)
        rows = now.devices.rows if now is not None and now.devices is not None else ()
        mine = next((r for r in rows if r.finger == obj.name and r.kind == "thimble"), None)
        trouble = thimble_preview.failure(obj.name)
        if trouble:
            paragraph(layout, context, trouble, "ERROR")
        elif mine is not None and "mismatch" in mine.signals:
            touching = mine.contact is None or mine.contact > 0.5
            text = f"Mismatch now: {100 * mine.signals['mismatch']:.0f} % of the target" if touching else "In the air"
            layout.label(text=text, icon="ARROW_LEFTRIGHT")
        layout.operator("dermis.plot_thimble", icon="GRAPH")

    def _adaptation(self, context: bpy.types.Context, obj: bpy.types.Object, device: Any) -> None:
        layout = self.layout
        ready = shown.ready(context.scene, obj, "thimble")
        if ready is not None and ready.trouble:
            paragraph(layout, context, ready.trouble, "ERROR")
            return
        found = ready.figures if ready is not None else None
        if found is not None:
            words = "Adapted to this finger"
            if "network_error" in found:
                network, ridge = 100 * found["network_error"], 100 * found["ridge_error"]
                words += f": network {network:.0f} %, polynomial {ridge:.0f} % off"
            paragraph(layout, context, words, "CHECKMARK")
        elif device.thimble_method in core.matching.thimble_use.LEARNED:
            paragraph(
                layout,
                context,
                "Not adapted to this finger, so the direct method takes its place. Adapt it, "
                "which takes some two minutes, or choose the direct method.",
                "ERROR",
            )
        layout.operator("dermis.adapt_thimble", icon="FILE_REFRESH" if found is not None else "MOD_LATTICE")


class DERMIS_MT_thimble_demos(bpy.types.Menu):
    """The paper's touches."""

    bl_idname = "DERMIS_MT_thimble_demos"
    bl_label = "Demo Thimble Scenes"

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw one entry a scene."""
        for key, scene in demo_thimble.SCENES.items():
            self.layout.operator("dermis.demo_thimble_scene", text=scene.title, icon="SCENE_DATA").touch = key


CLASSES: tuple[type, ...] = (DERMIS_PT_thimble, DERMIS_MT_thimble_demos)

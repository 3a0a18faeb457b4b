"""A finger's thimble: its settings, its adaptation, its error at this frame."""

from typing import Any

import bpy

from .._core import core
from ..demos import touches
from ..layouts import paragraph, properties
from ..polls import needs
from ..viewport import shown
from . import searched
from .main import DermisPanel, chosen


def settings(layout: Any, context: bpy.types.Context, device: Any) -> None:
    """Draw the settings of a thimble, for the panel of device settings."""
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


@needs(
    lambda context: (
        chosen(context, "thimble") and shown.active_device(context.scene, context.object, "thimble") is not None
    )
)
class DERMIS_PT_thimble(DermisPanel, bpy.types.Panel):
    """Method, adaptation, mismatch and display."""

    bl_idname = "DERMIS_PT_thimble"
    bl_label = "Thimble"
    bl_parent_id = "DERMIS_PT_devices"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the adaptation's state, the mismatch of this frame and the view's switches."""
        layout, obj = self.layout, context.object
        device, view = shown.active_device(context.scene, obj, "thimble"), context.scene.dermis.thimble_view
        if device is None:  # it may be gone since `poll`
            return
        column = layout.column()
        column.use_property_split = True
        column.prop(device, "thimble_method")
        searched.adaptation(layout, context, obj, "thimble", device.thimble_method)
        row = layout.row(align=True)
        row.prop(view, "split", toggle=True, icon="MOD_MIRROR")
        row.prop(view, "workspace", toggle=True, icon="MESH_UVSPHERE")
        searched.skin_and_mismatch(layout, context, obj, device)
        searched.floor(layout, context, obj, device)
        layout.operator("dermis.plot_thimble", icon="GRAPH")


class DERMIS_MT_thimble_demos(bpy.types.Menu):
    """The paper's touches."""

    bl_idname = "DERMIS_MT_thimble_demos"
    bl_label = "Demo Thimble Scenes"

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw one entry a scene."""
        for key, (title, _) in touches.THIMBLE.items():
            self.layout.operator("dermis.demo_thimble_scene", text=title, icon="SCENE_DATA").touch = key


CLASSES: tuple[type, ...] = (DERMIS_PT_thimble, DERMIS_MT_thimble_demos)

"""Values of the devices at the current frame, and settings of their display."""

import bpy

from ..layouts import Pairs, paragraph
from ..polls import needs
from ..preview import rows
from ..quantities import quantity
from ..viewport import shown
from . import summary
from .main import DermisPanel, style_of


def _rows(context: bpy.types.Context) -> "tuple[rows.Row, ...]":
    now = shown.now(context.scene)
    return now.devices.rows if now is not None and now.devices is not None else ()


def _tactor(scene: bpy.types.Scene) -> bool:
    """Return whether a finger wears a shear tactor."""
    fingers = (scene.objects.get(name) for name in summary.of(scene).fingers)
    worn = (device for obj in fingers if obj is not None for device in obj.dermis.finger.devices)
    return any(device.enabled and style_of(device.preset) == "tactor" for device in worn)


@needs(lambda context: summary.of(context.scene).fingers)
class DERMIS_PT_preview(DermisPanel, bpy.types.Panel):
    """States of the devices at the current frame."""

    bl_idname = "DERMIS_PT_preview"
    bl_label = "Preview"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the view's settings, and the source of its contents."""
        layout, settings = self.layout, context.scene.dermis
        row = layout.row(align=True)
        row.prop(settings, "live_preview", toggle=True, icon="PLAY", text="Live")
        row.prop(settings, "show_twin", toggle=True, icon="MOD_WARP", text="Twin")
        row.prop(settings, "show_readout", toggle=True, icon="INFO", text="Readout")
        fold = row.row(align=True)
        fold.active = settings.show_readout or settings.skin_view.show
        fold.prop(
            settings, "fold_cards", toggle=True, text="", icon="TRIA_RIGHT" if settings.fold_cards else "TRIA_DOWN"
        )
        if settings.show_twin and _tactor(context.scene):  # it enlarges nothing else
            layout.prop(settings, "twin_exaggeration", slider=True)
        there = summary.of(context.scene)
        if not there.touchables and not there.screens:
            return  # the head of the tab names the next step
        now = shown.now(context.scene)
        preview = now.devices if now is not None else None
        if preview is None:
            paragraph(layout, context, "Move along the timeline to see the devices at work.", least=2)
            return
        icon = {"bake": "CHECKMARK", "live": "PLAY", "device": "LINKED", "file": "FILE"}.get(preview.source, "ERROR")
        paragraph(layout, context, preview.note[:1].upper() + preview.note[1:], icon, least=2)


@needs(lambda context: bool(_rows(context)))
class DERMIS_PT_preview_values(DermisPanel, bpy.types.Panel):
    """Each device's values, channel by channel."""

    bl_idname = "DERMIS_PT_preview_values"
    bl_parent_id = "DERMIS_PT_preview"
    bl_label = "Device Values"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw a box a device."""
        for row_of in _rows(context):
            box = self.layout.box().column(align=True)
            box.scale_y = 0.85
            box.label(text=f"{row_of.finger}: {row_of.title}")
            pairs = Pairs(box, 0.5)
            for name, value in row_of.values.items():
                pairs.add(name.replace("_", " "), quantity(value, row_of.units[name]))


CLASSES: tuple[type, ...] = (DERMIS_PT_preview, DERMIS_PT_preview_values)

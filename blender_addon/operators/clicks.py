"""Clicks in the views: on a mark of the strip, and on a device's card."""

import bpy

from .. import scene_time
from ..polls import needs
from ..timeline import strip
from ..viewport import cards


class DERMIS_OT_strip_jump(bpy.types.Operator):
    """Go to the frame of the finding whose mark was clicked in the strip; other clicks are passed on"""

    bl_idname = "dermis.strip_jump"
    bl_label = "Go to Finding in Strip"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether the strip is visible."""
        return strip.visible(context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Go to the frame of the mark that was hit."""
        mark = strip.mark_at(context, event.mouse_region_x, event.mouse_region_y)
        if mark is None:
            return {"PASS_THROUGH"}
        scene_time.go_to(context.scene, mark.frame)
        self.report({"INFO"}, mark.text)
        return {"FINISHED"}


@needs(lambda context: cards.shown_in(context))
class DERMIS_OT_fold_card(bpy.types.Operator):
    """Fold the clicked card of a device to one line, or unfold it; other clicks are passed on"""

    bl_idname = "dermis.fold_card"
    bl_label = "Fold Card"
    bl_options = {"INTERNAL"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Fold or unfold the card under the pointer."""
        return {"FINISHED" if cards.fold_at(context, event.mouse_region_x, event.mouse_region_y) else "PASS_THROUGH"}


CLASSES: tuple[type, ...] = (DERMIS_OT_fold_card, DERMIS_OT_strip_jump)

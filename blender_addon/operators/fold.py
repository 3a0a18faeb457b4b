"""A click on a device's card in the 3D view folds it to a line, and unfolds it."""

import bpy

from ..polls import needs
from ..viewport import cards


@needs(lambda context: cards.shown_in(context))
class DERMIS_OT_fold_card(bpy.types.Operator):
    """Fold the device's card that was clicked to a line, or unfold it; other clicks are passed on"""

    bl_idname = "dermis.fold_card"
    bl_label = "Fold Card"
    bl_options = {"INTERNAL"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Fold or unfold the card under the pointer."""
        return {"FINISHED" if cards.fold_at(context, event.mouse_region_x, event.mouse_region_y) else "PASS_THROUGH"}


CLASSES: tuple[type, ...] = (DERMIS_OT_fold_card,)

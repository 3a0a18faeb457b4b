"""A click on a mark of the strip goes to its frame."""

import bpy

from .. import scene_time
from ..timeline import strip


class DERMIS_OT_strip_jump(bpy.types.Operator):
    """Go to the frame of the finding whose mark was clicked in the strip; other clicks are passed on"""

    bl_idname = "dermis.strip_jump"
    bl_label = "Go to Finding in Strip"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Be there where the strip is."""
        return strip.visible(context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Set the frame where a mark was hit."""
        mark = strip.mark_at(context, event.mouse_region_x, event.mouse_region_y)
        if mark is None:
            return {"PASS_THROUGH"}
        scene_time.go_to(context.scene, mark.frame)
        self.report({"INFO"}, mark.text)
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (DERMIS_OT_strip_jump,)

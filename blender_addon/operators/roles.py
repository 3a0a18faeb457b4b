# mypy: disable-error-code="valid-type"
"""Roles of objects: touchable, a finger, a screen, or none."""

from typing import Any

import bpy
from bpy.props import EnumProperty

from .. import changes
from ..polls import needs
from ..properties import scene_properties


@needs(lambda context: context.object is not None and context.object.is_editable, "Select an object of this file")
class DERMIS_OT_set_role(bpy.types.Operator):
    """Change the role of the active object; its settings are kept"""

    bl_idname = "dermis.set_role"
    bl_label = "Set Role"
    bl_options = {"REGISTER", "UNDO"}

    role: EnumProperty(
        name="Role",
        description="Role of the object",
        items=(
            ("NONE", "Nothing", "Dermis ignores it"),
            ("FINGER", "Finger", "It feels"),
            ("TOUCHABLE", "Touchable", "It can be felt"),
            ("SCREEN", "Touch Screen", "It renders friction"),
        ),
    )

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: Any) -> str:
        """Return the description of the button."""
        return {
            "NONE": "Dermis shall ignore this object; its settings are kept",
            "FINGER": "This object feels: its origin is the pad's centre, +Y points to the tip, +Z to the nail",
            "SCREEN": "This object is a touch screen: a rectangle in its own XY plane, looking along +Z",
        }.get(properties.role, "Fingers can feel this object")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set it."""
        context.object.dermis.role = self.role
        scene_properties.begin(context.scene)
        changes.mark_dirty(context.object.name)
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (DERMIS_OT_set_role,)

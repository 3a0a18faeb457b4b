# mypy: disable-error-code="valid-type"
"""What an object is to Dermis: touchable with a material, a finger, a screen, or nothing."""

from typing import Any

import bpy
from bpy.props import EnumProperty, StringProperty

from .. import changes, choices, reporting
from .._core import DermisError
from ..polls import needs
from ..preferences import library
from ..properties import scene_properties


def _meshes(context: bpy.types.Context) -> list[bpy.types.Object]:
    chosen = list(context.selected_objects)
    if context.object is not None and context.object not in chosen:
        chosen.append(context.object)
    return [o for o in chosen if o.type == "MESH"]


class Chooser:
    """Opens a menu of presets, which draws what was read just before."""

    menu = ""

    def execute(self, _context: bpy.types.Context) -> set[str]:
        """Read the presets, then open the menu."""
        choices.refresh()
        bpy.ops.wm.call_menu(name=self.menu)
        return {"FINISHED"}


@needs(_meshes, "Select a mesh object")
class DERMIS_OT_make_touchable(bpy.types.Operator):
    """Let fingers feel the selected mesh objects, with a haptic material from a preset or by hand"""

    bl_idname = "dermis.make_touchable"
    bl_label = "Make Touchable"
    bl_options = {"REGISTER", "UNDO"}

    preset: StringProperty(name="Material", description="Preset to take the values from; empty keeps the values")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set role and material of every selected mesh."""
        values: dict[str, Any] = {}
        if self.preset:
            try:
                values = library().material(self.preset)
            except DermisError as error:
                return reporting.report_error(self, error, self.bl_label)
        fingers = 0
        for obj in _meshes(context):
            if obj.dermis.role in ("FINGER", "SCREEN") and obj is not context.object:
                fingers += 1  # a finger that is merely also selected stays one
                continue
            obj.dermis.role = "TOUCHABLE"
            scene_properties.apply_parameters(obj.dermis.material, values)
            if self.preset:
                obj.dermis.material.preset = self.preset
        scene_properties.stamp(context.scene)
        if fingers:
            self.report({"INFO"}, f"Left {fingers} selected finger(s) or screen(s) as they are")
        return {"FINISHED"}


@needs(
    lambda context: (
        context.object is not None
        and context.object.type == "MESH"
        and context.mode == "OBJECT"
        and (context.object.dermis.role in ("NONE", "TOUCHABLE"))
    ),
    "Select the mesh object that fingers shall feel",
)
class DERMIS_OT_choose_material(Chooser, bpy.types.Operator):
    """Choose a haptic material for the selected mesh objects"""

    bl_idname = "dermis.choose_material"
    bl_label = "Choose Haptic Material"
    menu = "DERMIS_MT_materials"


@needs(lambda context: context.object is not None, "Select an object")
class DERMIS_OT_set_role(bpy.types.Operator):
    """Change what the active object is to Dermis; its settings are kept"""

    bl_idname = "dermis.set_role"
    bl_label = "Set Role"
    bl_options = {"REGISTER", "UNDO"}

    role: EnumProperty(
        name="Role",
        items=(
            ("NONE", "Nothing", "Dermis ignores it"),
            ("FINGER", "Finger", "It feels"),
            ("TOUCHABLE", "Touchable", "It can be felt"),
            ("SCREEN", "Touch Screen", "It renders friction"),
        ),
    )

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: Any) -> str:
        """Say what the button does."""
        return {
            "NONE": "Dermis shall ignore this object; its settings are kept",
            "FINGER": "This object feels: its origin is the pad's centre, +Y points to the tip, +Z to the nail",
            "SCREEN": "This object is a touch screen: a rectangle in its own XY plane, looking along +Z",
        }.get(properties.role, "Fingers can feel this object")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set it."""
        context.object.dermis.role = self.role
        scene_properties.stamp(context.scene)
        changes.mark_dirty(context.object.name)
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (DERMIS_OT_make_touchable, DERMIS_OT_choose_material, DERMIS_OT_set_role)

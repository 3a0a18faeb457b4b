# mypy: disable-error-code="valid-type"
"""Haptic materials: make objects touchable, with the values of a preset."""

import bpy
from bpy.props import StringProperty

from ..polls import needs
from ..preferences import library
from ..properties import object_properties, scene_properties
from .work import Chooser, Work, chosen


def _meshes(context: bpy.types.Context) -> list[bpy.types.Object]:
    return [o for o in chosen(context) if o.type == "MESH"]


@needs(_meshes, "Select a mesh object")
class DERMIS_OT_make_touchable(Work, bpy.types.Operator):
    """Make the selected mesh objects touchable, with a haptic material from a preset or your own values"""

    bl_idname = "dermis.make_touchable"
    bl_label = "Make Touchable"
    bl_options = {"REGISTER", "UNDO"}

    preset: StringProperty(name="Material", description="Preset of the values. If empty, the values stay")

    def work(self, context: bpy.types.Context) -> str | None:
        """Set role and material of every selected mesh."""
        values = library().material(self.preset) if self.preset else {}
        fingers = 0
        for obj in _meshes(context):
            if obj.dermis.role in ("FINGER", "SCREEN") and obj is not context.object:
                fingers += 1  # a finger that is merely also selected stays one
                continue
            obj.dermis.role = "TOUCHABLE"
            object_properties.apply_parameters(obj.dermis.material, values)
            if self.preset:
                obj.dermis.material.preset = self.preset
        scene_properties.begin(context.scene)
        return f"Left {fingers} selected finger(s) or screen(s) as they are" if fingers else None


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


CLASSES: tuple[type, ...] = (DERMIS_OT_make_touchable, DERMIS_OT_choose_material)

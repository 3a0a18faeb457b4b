# mypy: disable-error-code="valid-type"
"""Add > Dermis: a finger, a touch screen."""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty
from mathutils import Euler, Matrix

from .. import fingertip_mesh
from ..demos import demo_scene
from ..placing import surfaces
from ..polls import needs
from ..properties import scene_properties
from ..quantities import metres_per_unit
from .work import select_only, zoom


def _place(context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Link an object at the cursor and make it the only selected one."""
    context.collection.objects.link(obj)
    obj.matrix_world = Matrix.LocRotScale(context.scene.cursor.location, Euler((0.0, 0.0, 0.0)), None)
    select_only(context, obj)
    scene_properties.begin(context.scene)


@needs(lambda context: context.mode == "OBJECT", "Leave edit mode first")
class DERMIS_OT_add_finger(bpy.types.Operator):
    """Add a fingertip at the 3D cursor. If the cursor is inside a solid, the finger is put on its nearest surface. The
    origin is at the pad, +Y points to the tip, +Z to the nail"""

    bl_idname = "dermis.add_finger"
    bl_label = "Add Finger"
    bl_options = {"REGISTER", "UNDO"}

    device: StringProperty(name="Device", description="Preset of a device for the new finger", default="")
    frame_view: BoolProperty(name="Zoom In", description="Bring the finger into view", default=True)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add it."""
        solids = [o for o in context.visible_objects if o.type == "MESH" and o.dermis.role != "FINGER"]
        at = context.scene.cursor.location
        spot = surfaces.way_out(solids, at, context.evaluated_depsgraph_get())
        obj = bpy.data.objects.new("Finger", fingertip_mesh.mesh(metres_per_unit(context.scene)))
        _place(context, obj)
        if spot is not None:
            surfaces.lie(obj, spot, 0.0)
        obj.dermis.role = "FINGER"
        if self.device:
            obj.dermis.finger.devices.add().preset = self.device
        if self.frame_view:
            zoom(context)
        return {"FINISHED"}


@needs(lambda context: context.mode == "OBJECT", "Leave edit mode first")
class DERMIS_OT_add_screen(bpy.types.Operator):
    """Add a touch screen with a relief at the 3D cursor. It is a rectangle that faces up"""

    bl_idname = "dermis.add_screen"
    bl_label = "Add Touch Screen"
    bl_options = {"REGISTER", "UNDO"}

    width: FloatProperty(
        name="Width", description="Size along X", default=120.0, min=1.0, soft_max=600.0, unit="CAMERA"
    )
    depth: FloatProperty(
        name="Height", description="Size along Y", default=75.0, min=1.0, soft_max=600.0, unit="CAMERA"
    )
    relief: EnumProperty(
        name="Relief",
        description="Content of the new screen",
        items=(("BUMPS", "Bumps", "An image of round bumps"), ("NONE", "None", "No relief yet; choose an image later")),
    )
    frame_view: BoolProperty(name="Zoom In", description="Bring the screen into view", default=True)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add it."""
        size = (self.width * 1e-3, self.depth * 1e-3)
        image = demo_scene.bumps_image(size) if self.relief == "BUMPS" else None
        obj = demo_scene.screen_object(size, image, metres_per_unit(context.scene))
        _place(context, obj)
        if self.frame_view:
            zoom(context)
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (DERMIS_OT_add_finger, DERMIS_OT_add_screen)

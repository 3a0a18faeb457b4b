# mypy: disable-error-code="valid-type"
"""Mend what is doubtful before a bake, and put fingers on surfaces."""

import bpy
from bpy.props import FloatProperty, StringProperty

from .. import changes
from .._core import DermisError
from ..polls import active_finger, needs
from ..quantities import metres_per_unit
from ..sanity import doubts, surfaces
from .work import Work


class DERMIS_OT_mend(Work, bpy.types.Operator):
    """Mend this"""

    bl_idname = "dermis.mend"
    bl_label = "Mend"
    bl_options = {"REGISTER", "UNDO", "INTERNAL"}

    code: StringProperty(name="Code", description="What is doubtful", options={"SKIP_SAVE"})
    name: StringProperty(name="Object", description="Whose", options={"SKIP_SAVE"})

    def work(self, context: bpy.types.Context) -> str | None:
        """Mend it."""
        doubts.mend(context, self.code, self.name)
        return None


@needs(active_finger, "Select a finger last, and before it the object that it shall lie on")
class DERMIS_OT_place_on_surface(Work, bpy.types.Operator):
    """Put the active finger's pad where the other selected object is nearest, else the nearest touchable one"""

    bl_idname = "dermis.place_on_surface"
    bl_label = "Place on Surface"
    bl_options = {"REGISTER", "UNDO"}

    gap: FloatProperty(
        name="Gap",
        description="Between pad and surface; below zero it presses",
        default=0.0,
        soft_min=-3.0,
        soft_max=20.0,
        unit="CAMERA",
    )

    def work(self, context: bpy.types.Context) -> str | None:
        """Place it."""
        finger = context.object
        assert finger is not None
        if finger.parent_type == "BONE" and finger.parent is not None:
            raise DermisError(
                "it hangs on a bone",
                where=f"finger '{finger.name}'",
                value=finger.parent_bone,
                remedy="Pose its hand, or clear its parent",
            )
        depsgraph = context.evaluated_depsgraph_get()
        place = finger.matrix_world.translation
        meshes = [o for o in context.selected_objects if o.type == "MESH" and o.dermis.role != "FINGER"]
        meshes = meshes or doubts.bodies(context.scene, context.view_layer)
        spots = [spot for spot in (surfaces.nearest(o, place, depsgraph) for o in meshes) if spot is not None]
        if not spots:
            raise DermisError("there is no surface to lie on", remedy="Select a mesh object, then the finger")
        spot = min(spots, key=lambda s: (s.point - place).length)
        surfaces.lie(finger, spot, 1e-3 * self.gap / metres_per_unit(context.scene))
        changes.mark_dirty(finger.name)
        return None


CLASSES: tuple[type, ...] = (DERMIS_OT_mend, DERMIS_OT_place_on_surface)

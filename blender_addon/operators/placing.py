# mypy: disable-error-code="valid-type"
"""Correct probable mistakes before a bake, and put fingers on surfaces."""

from collections.abc import Callable
from math import ceil, floor, radians

import bpy
from bpy.props import EnumProperty, FloatProperty, StringProperty
from mathutils import Vector

from .. import changes, doubts, scene_time
from .._core import DermisError
from ..layouts import properties
from ..placing import gesture, keyed_poses, surfaces
from ..polls import finger_at_hand, needs, own_finger
from ..quantities import metres_per_unit
from .work import Work, follow

# [m] Keyed depth of a press by force. The compliant bone stays behind its keys where the force would exceed the limit.
FORCE_DEPTH = 3e-3


class DERMIS_OT_mend(Work, bpy.types.Operator):
    """Change the setting that the finding names"""

    bl_idname = "dermis.mend"
    bl_label = "Mend"
    bl_options = {"REGISTER", "UNDO", "INTERNAL"}

    code: StringProperty(name="Code", description="Code of the finding to correct", options={"HIDDEN", "SKIP_SAVE"})
    name: StringProperty(name="Object", description="Object that the finding concerns", options={"HIDDEN", "SKIP_SAVE"})

    def work(self, context: bpy.types.Context) -> str | None:
        """Mend it."""
        doubts.mend(context, self.code, self.name)
        if self.name:
            follow(context, context.scene.objects[self.name])
        return None


@needs(own_finger, "Select the object that the finger shall lie on, then a finger of this file")
class DERMIS_OT_place_on_surface(Work, bpy.types.Operator):
    """Move the active finger's pad to the nearest point of the other selected object. Without one, the nearest
    touchable object is used"""

    bl_idname = "dermis.place_on_surface"
    bl_label = "Place on Surface"
    bl_options = {"REGISTER", "UNDO"}

    gap: FloatProperty(
        name="Gap",
        description="Distance between pad and surface. A negative value presses the pad into the surface",
        default=0.0,
        soft_min=-3.0,
        soft_max=20.0,
        unit="CAMERA",
    )

    def work(self, context: bpy.types.Context) -> str | None:
        """Place it."""
        finger = _free(own_finger(context))
        spot, _ = _touched(context, finger.matrix_world.translation)
        surfaces.lie(finger, spot, 1e-3 * self.gap / metres_per_unit(context.scene))
        changes.mark_dirty(finger.name)
        follow(context, finger)
        return None


@needs(lambda context: "EDIT" not in context.mode and finger_at_hand(context), "Add a finger first; leave edit mode")
class DERMIS_OT_add_gesture(Work, bpy.types.Operator):
    """Key a touch from this frame on: the active finger, else the nearest, comes down on the surface, presses, holds,
    slides and lifts"""

    bl_idname = "dermis.add_gesture"
    bl_label = "Key a Touch"
    bl_options = {"REGISTER", "UNDO"}

    until: EnumProperty(
        name="Press",
        description="Control of the press",
        items=(
            ("DEPTH", "By Depth", "The bone moves to this depth below first contact"),
            ("FORCE", "By Force", "The bone becomes compliant, and yields where the force would be larger than this"),
        ),
    )
    depth: FloatProperty(
        name="Depth",
        description="Depth of the bone below first contact",
        default=1.0,
        min=0.0,
        soft_max=3.0,
        unit="CAMERA",
    )
    force: FloatProperty(name="Force [N]", description="Force of the press", default=1.0, min=0.01, soft_max=10.0)
    hold: FloatProperty(
        name="Hold",
        description="Time for which the finger presses without moving, before the slide",
        default=2.0,
        min=0.0,
        soft_max=10.0,
        unit="TIME_ABSOLUTE",
    )
    slide: FloatProperty(name="Slide", description="Length of the slide", default=20.0, min=0.0, unit="CAMERA")
    speed: FloatProperty(name="Speed [mm/s]", description="Speed of the slide", default=10.0, min=0.1, soft_max=200.0)
    direction: FloatProperty(
        name="Direction",
        description="Direction of the slide, as an angle in the surface. 0 is towards the fingertip",
        default=radians(90.0),
        unit="ROTATION",
    )
    height: FloatProperty(
        name="Height", description="Height at which the touch begins and ends", default=5.0, min=0.1, unit="CAMERA"
    )
    approach: FloatProperty(
        name="Approach [mm/s]", description="Speed of the approach and of the lift", default=20.0, min=0.1
    )

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw depth or force, whichever sets the press, and the other settings."""
        pressed = "depth" if self.until == "DEPTH" else "force"
        rest = ("hold", "slide", "speed", "direction", "height", "approach")
        properties(self.layout, self, "until", pressed, *rest, keys=False)

    def work(self, context: bpy.types.Context) -> str | None:
        """Key it."""
        finger, scene = _free(finger_at_hand(context)), context.scene
        if finger.parent is not None or finger.rotation_mode == "AXIS_ANGLE":
            raise DermisError(
                "only a finger without a parent, turned by Euler angles or a quaternion, can be keyed",
                where=f"finger '{finger.name}'",
                remedy="Clear its parent, keeping the transformation",
            )
        spot, nearest = _touched(context, finger.matrix_world.translation)
        deep = FORCE_DEPTH if self.until == "FORCE" else 1e-3 * self.depth
        asked = gesture.Gesture(
            1e-3 * self.height,
            1e-3 * self.approach,
            deep,
            self.hold,
            1e-3 * self.slide,
            1e-3 * self.speed,
            self.direction,
        )
        if self.until == "FORCE":
            skin = finger.dermis.finger.skin
            skin.shown, skin.depth_mode, skin.force_limit = True, "compliant", self.force
        times, frames = gesture.poses(asked, finger.matrix_world, spot, nearest, metres_per_unit(scene))
        clock = scene_time.clock(scene, scene_time.shown(scene))
        shown = [clock.frames(float(t)) for t in times]
        keyed_poses.key(finger, [scene_time.evaluated(scene, frame) for frame in shown], frames)
        last = ceil(shown[-1])
        scene.frame_start = min(scene.frame_start, max(floor(shown[0]), 0))  # Blender has no start frame below 0
        scene.frame_end = max(scene.frame_end, last)
        changes.mark_dirty(finger.name)
        return f"Keyed frames {clock.first:g} to {last} of {finger.name}"


def _free(finger: bpy.types.Object | None) -> bpy.types.Object:
    """Return a finger, if it hangs on no bone.

    Raises:
        DermisError: it hangs on a bone.
    """
    assert finger is not None
    if finger.parent_type == "BONE" and finger.parent is not None:
        raise DermisError(
            "it hangs on a bone",
            where=f"finger '{finger.name}'",
            value=finger.parent_bone,
            remedy="Pose its hand, move the object instead, or clear its parent",
        )
    return finger


def _touched(
    context: bpy.types.Context, place: Vector
) -> "tuple[surfaces.Spot, Callable[[Vector], surfaces.Spot | None]]":
    """Return the spot that is nearest to a place, and a search on its object.

    The other selected meshes are candidates; if there are none, all touchable objects and screens are. The search takes
    a point, and returns the nearest spot on the object.

    Raises:
        DermisError: there is no such surface.
    """
    depsgraph = context.evaluated_depsgraph_get()
    meshes = [o for o in context.selected_objects if o.type == "MESH" and o.dermis.role != "FINGER"]
    spots = [
        (spot, body)
        for body in meshes or doubts.bodies(context.scene, context.view_layer, screens=True)
        if (spot := surfaces.nearest(body, place, depsgraph)) is not None
    ]
    if not spots:
        raise DermisError("there is no surface to touch", remedy="Select a mesh object, then the finger")
    spot, body = min(spots, key=lambda found: (found[0].point - place).length)
    return spot, lambda point: surfaces.nearest(body, point, depsgraph)


CLASSES: tuple[type, ...] = (DERMIS_OT_mend, DERMIS_OT_place_on_surface, DERMIS_OT_add_gesture)

"""The example for pins: the experiment of [S1], a plane pressed into the pad and drawn along, keyed as an animation."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Vector

from .. import compat, fingertip_mesh
from .._core import core
from ..properties import scene_properties, skin_properties
from ..quantities import metres_per_unit
from . import demo_skin

NAME = "Dermis Pin Array Demo"
DEVICE = "pin_array_128"
SIZE = (0.09, 0.09, 0.004)  # of the plane [m]: its stroke is 20 mm to any side


def build(depth: float = 2e-3, friction: float = 0.6, direction: float = 0.0) -> bpy.types.Scene:
    """Return a new scene.

    Args:
        depth: how deep the plane is pressed [m]. friction: its coefficient. direction: of the movement [rad].
    """
    sliding = core.scene.sliding
    fps = int(sliding.FPS)
    scene = bpy.data.scenes.new(NAME)
    scene.render.fps, scene.render.fps_base = fps, 1.0
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 1.0
    scene.unit_settings.length_unit = "MILLIMETERS"
    scene.render.engine = "BLENDER_WORKBENCH"
    last = 1 + round((sliding.SETTLE + sliding.SLIDE) * fps)
    scene.frame_start, scene.frame_end = 1, last
    finger = bpy.data.objects.new("Index", fingertip_mesh.mesh(1.0))
    scene.collection.objects.link(finger)
    finger.dermis.role = "FINGER"
    finger.dermis.finger.devices.add().preset = DEVICE
    finger.dermis.finger.skin.shown = True
    fingertip_mesh.fit(finger, skin_properties.lengths(finger.dermis.finger.skin), metres_per_unit(scene))
    plane = bpy.data.objects.new("Plane", demo_skin.block(*SIZE))
    scene.collection.objects.link(plane)
    plane.dermis.role = "TOUCHABLE"
    plane.dermis.material.friction = friction
    frames = np.arange(1, last + 1)
    places = sliding.plane_offset((frames - 1) / fps, depth, direction)
    for axis in range(3):
        compat.set_keys(plane, "location", axis, frames.tolist(), places[:, axis].tolist(), interpolation="LINEAR")
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.clip_start, camera.data.lens, camera.data.display_size = 0.005, 60.0, 0.02
    camera.location = (-0.05, 0.09, 0.05)
    camera.rotation_euler = (Vector((0.0, 0.0, 0.004)) - camera.location).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene_properties.stamp(scene)
    scene.frame_set(1)
    return scene

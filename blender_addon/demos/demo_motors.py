"""The examples for platforms: the six interactions of [S2] as keyed animations, wobble and repetitions included."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector

from .. import compat, fingertip_mesh
from .._core import core
from ..devices import skin_models
from ..properties import scene_properties, skin_properties
from ..quantities import metres_per_unit

NAME = "Dermis Motors"
DEVICE = "cable_platform"
TITLES = {
    "flat": "Flat",
    "back": "Back, Flat, Back",
    "tip": "Tip, Flat, Tip",
    "left": "Left, Flat, Left",
    "right": "Right, Flat, Right",
    "complex": "Complex",
}


def build(which: str, device: str = DEVICE, seed: int = 0) -> bpy.types.Scene:
    """Return a new scene with one of the six interactions.

    Args:
        which: 'flat', 'back', 'tip', 'left', 'right' or 'complex'. seed: of the hand's wobble.

    Raises:
        DermisError: there is no such interaction.
    """
    interactions = core.design.interactions
    finger_mesh = fingertip_mesh.mesh(1.0)
    scene = bpy.data.scenes.new(f"{NAME}: {TITLES.get(which, which)}")
    scene.render.fps, scene.render.fps_base = int(interactions.FPS), 1.0
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 1.0
    scene.unit_settings.length_unit = "MILLIMETERS"
    scene.render.engine = "BLENDER_WORKBENCH"
    finger = bpy.data.objects.new("Index", finger_mesh)
    scene.collection.objects.link(finger)
    finger.dermis.role = "FINGER"
    finger.dermis.finger.devices.add().preset = device
    finger.dermis.finger.skin.shown, finger.dermis.finger.skin.level = True, "draft"
    fingertip_mesh.fit(finger, skin_properties.lengths(finger.dermis.finger.skin), metres_per_unit(scene))
    model: Any = skin_models.get({}, "draft", wait=True)
    touch = interactions.interaction(which, model.positions, seed=seed)
    scene.frame_start, scene.frame_end = touch.frame_range
    scene.dermis.sample_rate = interactions.RATE
    scene.dermis_design.device = device
    mesh = interactions.slab()
    shape = bpy.data.meshes.new("Surface")
    shape.from_pydata(mesh.vertices.tolist(), [], mesh.triangles.tolist())
    surface = bpy.data.objects.new("Surface", shape)
    scene.collection.objects.link(surface)
    surface.dermis.role = "TOUCHABLE"
    surface.dermis.material.friction = interactions.FRICTION
    surface.display_type = "BOUNDS"  # the finger is seen through it
    (chunk,) = touch.chunks
    _key(surface, chunk.frames, chunk.bodies[0])
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.clip_start, camera.data.lens, camera.data.display_size = 0.005, 60.0, 0.02
    camera.location = (-0.09, 0.17, 0.05)
    camera.rotation_euler = (Vector((0.0, 0.0, 0.002)) - camera.location).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene_properties.stamp(scene)
    scene.frame_set(1)
    return scene


def _key(obj: bpy.types.Object, frames: np.ndarray, poses: np.ndarray) -> None:
    """Key location and rotation at every sample, between whole frames too: the wobble is part of the touch."""
    obj.rotation_mode = "QUATERNION"
    turns = [Matrix(pose[:3, :3].tolist()).to_quaternion() for pose in poses]
    for axis in range(3):
        compat.set_keys(obj, "location", axis, frames.tolist(), poses[:, axis, 3].tolist(), interpolation="LINEAR")
    for part in range(4):
        values = [turn[part] for turn in turns]
        compat.set_keys(obj, "rotation_quaternion", part, frames.tolist(), values, interpolation="LINEAR")

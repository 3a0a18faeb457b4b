"""Build the common parts of the example scenes.

They are a scene in millimetres, its camera, fingers, things to touch, and their keys.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from math import radians
from typing import Any

import bpy
import numpy as np
from mathutils import Euler, Vector

from .. import compat, fingertip_mesh
from .._core import DermisError
from ..preferences import library
from ..properties import scene_properties, skin_properties
from ..quantities import metres_per_unit

GREEN, BLUE = (0.30, 0.46, 0.36, 1.0), (0.22, 0.36, 0.52, 1.0)
STEEL, ROSE = (0.45, 0.48, 0.52, 1.0), (0.56, 0.34, 0.36, 1.0)


def begin(name: str, fps: int, last: int) -> bpy.types.Scene:
    """Return a new scene of frames 1 to `last`.

    Its unit is the metre, shown in millimetres.
    """
    scene = bpy.data.scenes.new(name)
    scene.render.fps, scene.render.fps_base = fps, 1.0
    scene.frame_start, scene.frame_end = 1, last
    units = scene.unit_settings
    if units.system != "METRIC":  # setting the system would reset the units of the window's scene
        units.system = "METRIC"
    units.scale_length, units.length_unit = 1.0, "MILLIMETERS"
    scene.render.engine = "BLENDER_WORKBENCH"
    return scene


def finish(scene: bpy.types.Scene, at: Sequence[float], target: Sequence[float], lens: float = 60.0) -> bpy.types.Scene:
    """Add a camera that looks at a target [m], and go to the first frame.

    Returns the scene.
    """
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.clip_start, camera.data.lens, camera.data.display_size = 0.005, lens, 0.02
    camera.location = at
    camera.rotation_euler = (Vector(target) - camera.location).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene_properties.begin(scene)
    scene.frame_set(scene.frame_start)
    return scene


def add(
    scene: bpy.types.Scene,
    name: str,
    data: bpy.types.Mesh,
    at: Sequence[float] = (0.0, 0.0, 0.0),
    colour: Sequence[float] = (),
) -> bpy.types.Object:
    """Add a mesh at a place [m], with a material if a colour is given."""
    obj = bpy.data.objects.new(name, data)
    obj.location = at
    if colour:
        data.materials.append(fingertip_mesh.coloured(name, colour))
    scene.collection.objects.link(obj)
    return obj


def touchable(obj: bpy.types.Object, friction: float, soft: float = 0.0) -> bpy.types.Object:
    """Make an object touchable, and return it.

    `soft` is the stiffness of its surface [MPa/m]; 0 is rigid.
    """
    obj.dermis.role = "TOUCHABLE"
    obj.dermis.material.friction = friction
    obj.dermis.material.surface_stiffness_mpa_m = soft
    return obj


def finger(scene: bpy.types.Scene, name: str, device: str = "") -> bpy.types.Object:
    """Add a finger, with a device if one is given."""
    obj = add(scene, name, fingertip_mesh.mesh(1.0))
    obj.dermis.role = "FINGER"
    if device:
        obj.dermis.finger.devices.add().preset = device
    return obj


def finger_with_skin(
    scene: bpy.types.Scene, name: str, device: str = "", *, preset: str = "", level: str = ""
) -> bpy.types.Object:
    """Add a finger that shows its skin.

    Size and stiffness are those of `preset`, and the accuracy is `level`, if they are given.
    """
    obj = finger(scene, name, device)
    skin = obj.dermis.finger.skin
    if preset:
        with suppress(DermisError):  # if the user has removed the preset, the defaults are used
            skin_properties.apply_preset(skin, library().skin(preset))
            skin.preset = preset
    # The unit of the window's scene may differ from that of this scene.
    fingertip_mesh.fit(obj, skin_properties.lengths(skin), metres_per_unit(scene))
    skin.level, skin.shown = level or skin.level, True
    if skin.level == "draft":
        skin.contact = "nodes"  # drafts are for playback; contact on nodes takes a tenth of the time
    return obj


def key(obj: bpy.types.Object, path: str, rows: Iterable[Sequence[float]], interpolation: str = "BEZIER") -> None:
    """Key a property of several components, by rows of (frame, value, ...)."""
    frames, *parts = np.array(list(rows), np.float64).T.tolist()
    for index, values in enumerate(parts):
        compat.set_keys(obj, path, index, frames, values, interpolation=interpolation)


def look(
    context: bpy.types.Context,
    target: Sequence[float],
    turn: Sequence[float],
    distance: float,
    *,
    lens: float = 60.0,
    colours: str = "MATERIAL",
) -> list[Any]:
    """Make the first finger active, and turn the window's 3D views.

    The views are turned to a target [m], and returned.

    Args:
        turn: Euler angles of the view [deg]. colours: colour type of the views.
    """
    # The first finger by its name becomes active, for example Index before Thumb.
    fingers = (o for o in context.scene.objects if o.dermis.role == "FINGER")
    context.view_layer.objects.active = min(fingers, key=lambda o: o.name)
    if bpy.app.background or context.window is None:
        return []
    _frame_timelines(context)
    spaces = [area.spaces.active for area in context.window.screen.areas if area.type == "VIEW_3D"]
    for space in spaces:
        space.clip_start, space.lens = 0.002, lens
        space.shading.color_type = colours
        space.overlay.show_relationship_lines = False
        space.show_region_ui = True
        view = space.region_3d
        view.view_perspective = "PERSP"
        view.view_location, view.view_distance = target, distance
        view.view_rotation = Euler([radians(angle) for angle in turn]).to_quaternion()
    return spaces


def _frame_timelines(context: bpy.types.Context) -> None:
    """Let the window's timelines show exactly the scene's range."""
    for area in context.window.screen.areas:
        if area.ui_type == "TIMELINE":
            region = next(r for r in area.regions if r.type == "WINDOW")
            with context.temp_override(area=area, region=region):
                bpy.ops.action.view_all()


def look_at_skins(context: bpy.types.Context) -> None:
    """Look from in front of the tips, to see nail, pad and touched object."""
    wide = sum(o.dermis.role == "FINGER" for o in context.scene.objects) > 1
    look(context, (-0.020, 0.0, 0.002 if wide else 0.004), (66.0, 0.0, 160.0), 0.175 if wide else 0.145)

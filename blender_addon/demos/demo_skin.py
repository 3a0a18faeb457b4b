"""The example for skin: a fingertip presses a sphere, an edge and a ribbed plate and slides over them.

With five fingers each has a thing of its own, and all touch at once. Everything has its real size.
"""

from __future__ import annotations

import math
from typing import Any

import bpy
import numpy as np
from mathutils import Euler, Vector

from .. import compat
from .._core import DermisError
from ..fingertip_mesh import fit
from ..fingertip_mesh import mesh as fingertip_mesh
from ..preferences import library
from ..properties import scene_properties, skin_properties
from ..quantities import metres_per_unit
from .demo_scene import ribbed_plate

FPS = 24
NAME = "Dermis Skin Demo"
DESK = 0.0  # height of the table's top [m]
SPHERE_RADIUS, RIDGE_ANGLE = 6e-3, math.radians(100.0)
HEIGHT = 12e-3  # of what is touched above the table [m]
DEPTH = 1.1e-3  # of the presses [m]
SLIDE = 4e-3
SKINS = ("thumb_medium", "index_medium", "index_large", "index_medium", "little_medium")
HAND = ("Thumb", "Index", "Middle", "Ring", "Little")


def build(fingers: int) -> bpy.types.Scene:
    """Return a new scene with one finger that touches three things in turn, or five that touch five at once."""
    scene = bpy.data.scenes.new(NAME)
    scene.render.fps, scene.render.fps_base = FPS, 1.0
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 1.0
    scene.unit_settings.length_unit = "MILLIMETERS"
    scene.render.engine = "BLENDER_WORKBENCH"
    if fingers == 1:
        _one(scene)
    else:
        _five(scene)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.clip_start, camera.data.lens, camera.data.display_size = 0.005, 60.0, 0.02
    camera.location = (-0.05, 0.15, 0.08)
    camera.rotation_euler = (Vector((0.0, 0.0, 0.008)) - camera.location).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene_properties.stamp(scene)
    scene.frame_set(scene.frame_start)
    return scene


def look(context: bpy.types.Context) -> None:
    """Make the first finger active and turn the window's 3D views to it."""
    fingers = [o for o in context.scene.objects if o.dermis.role == "FINGER"]
    context.view_layer.objects.active = min(fingers, key=lambda o: o.name)
    if bpy.app.background or context.window is None:
        return
    wide = len(fingers) > 1
    for area in context.window.screen.areas:
        if area.type != "VIEW_3D":
            continue
        space = area.spaces.active
        space.clip_start, space.lens = 0.002, 60.0
        space.shading.color_type = "MATERIAL"
        space.overlay.show_relationship_lines = False
        space.show_region_ui = True
        view = space.region_3d
        view.view_perspective = "PERSP"
        # From in front of the tips: nail, pad and what is touched are all in view.
        view.view_location = Vector((-0.020, 0.0, 0.002) if wide else (-0.020, 0.0, 0.004))
        view.view_rotation = Euler((math.radians(66.0), 0.0, math.radians(160.0))).to_quaternion()
        view.view_distance = 0.175 if wide else 0.145


def sphere(radius: float, segments: int = 64) -> bpy.types.Mesh:
    """Return a closed sphere around its centre [m]."""
    import bmesh

    data = bpy.data.meshes.new("Sphere")
    ball = bmesh.new()
    bmesh.ops.create_uvsphere(ball, u_segments=segments, v_segments=segments // 2, radius=radius)
    for face in ball.faces:
        face.smooth = True
    ball.to_mesh(data)
    ball.free()
    return data


def ridge(length: float, height: float, angle: float, radius: float = 0.4e-3) -> bpy.types.Mesh:
    """Return a closed bar along X whose upper edge has an angle and is rounded; the edge lies at z = 0 [m]."""
    half = 0.5 * (math.pi - angle)  # of the slopes against the horizontal
    turn = np.linspace(-half, half, 13)
    tip = np.stack([radius * np.sin(turn), radius * (np.cos(turn) - 1.0)], axis=1)
    down = height + tip[0, 1]
    reach = down / math.tan(half)
    profile = np.vstack([[tip[0, 0] - reach, -height], tip, [tip[-1, 0] + reach, -height]])
    n = len(profile)
    ends = [np.column_stack([np.full(n, x), profile[:, 0], profile[:, 1]]) for x in (-0.5 * length, 0.5 * length)]
    faces: list[tuple[int, ...]] = [(i, i + n, (i + 1) % n + n, (i + 1) % n) for i in range(n)]
    faces += [tuple(range(n)), tuple(range(2 * n - 1, n - 1, -1))]
    data = bpy.data.meshes.new("Edge")
    data.from_pydata(np.vstack(ends).tolist(), [], faces)
    data.update()
    return data


def block(x: float, y: float, z: float) -> bpy.types.Mesh:
    """Return a block whose top's middle is the origin [m]."""
    a, b = 0.5 * x, 0.5 * y
    corners = [(i, j, k) for k in (-z, 0.0) for j in (-b, b) for i in (-a, a)]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    data = bpy.data.meshes.new("Block")
    data.from_pydata(corners, [], faces)
    data.update()
    return data


def _one(scene: bpy.types.Scene) -> None:
    scene.frame_start, scene.frame_end = 1, 145
    _desk(scene, 0.13)
    spots = (0.034, 0.0, -0.034)  # from left to right as the view sees them
    _touchable(_link(scene, "Sphere", sphere(SPHERE_RADIUS), (spots[0], 0.0, HEIGHT - SPHERE_RADIUS), GREEN), 0.5)
    _touchable(_link(scene, "Edge", ridge(0.026, HEIGHT, RIDGE_ANGLE), (spots[1], 0.0, HEIGHT), BLUE), 0.5)
    _touchable(_link(scene, "Plate", ribbed_plate(0.026, 0.026, HEIGHT), (spots[2], 0.0, HEIGHT), STEEL), 0.6)
    finger = _finger(scene, "Index", "index_medium", "standard")
    rows: list[tuple[float, float, float, float]] = []
    for i, x in enumerate(spots):
        f, deep = 1 + 48 * i, HEIGHT - DEPTH
        slide = SLIDE if i < 2 else 1.5 * SLIDE
        rows += [
            (f, x - 0.5 * slide, 0.0, HEIGHT + 8e-3),
            (f + 10, x - 0.5 * slide, 0.0, deep),
            (f + 16, x - 0.5 * slide, 0.0, deep),
            (f + 32, x + 0.5 * slide, 0.0, deep),
            (f + 37, x + 0.5 * slide, 0.0, deep),
            (f + 46, x + 0.5 * slide, 0.0, HEIGHT + 8e-3),
        ]
    rows.append((145, spots[2], 0.0, HEIGHT + 8e-3))
    _path(finger, rows)


def _five(scene: bpy.types.Scene) -> None:
    scene.frame_start, scene.frame_end = 1, 73
    _desk(scene, 0.17)
    things = ("Sphere", "Edge", "Plate", "Cube", "Pad")
    for i, (name, thing) in enumerate(zip(HAND, things, strict=True)):
        x, y = 0.027 * (i - 2), (-0.012, 0.004, 0.008, 0.003, -0.006)[i]
        if thing == "Sphere":
            obj = _link(scene, thing, sphere(SPHERE_RADIUS), (x, y, HEIGHT - SPHERE_RADIUS), GREEN)
        elif thing == "Edge":
            obj = _link(scene, thing, ridge(0.020, HEIGHT, RIDGE_ANGLE), (x, y, HEIGHT), BLUE)
        elif thing == "Plate":
            obj = _link(scene, thing, ribbed_plate(0.020, 0.026, HEIGHT), (x, y, HEIGHT), STEEL)
        elif thing == "Cube":
            obj = _link(scene, thing, block(0.009, 0.024, HEIGHT), (x + 4.5e-3, y, HEIGHT), STEEL)
        else:
            obj = _link(scene, thing, block(0.020, 0.026, HEIGHT), (x, y, HEIGHT), ROSE)
        _touchable(obj, 0.6, soft=20.0 if thing == "Pad" else 0.0)
        finger = _finger(scene, name, SKINS[i], "draft")
        deep, late = HEIGHT - DEPTH, 2 * i
        _path(
            finger,
            [
                (1, x, y - 2e-3, HEIGHT + 8e-3),
                (11 + late, x, y - 2e-3, deep),
                (26, x, y - 2e-3, deep),
                (46, x, y + 2e-3, deep),
                (54, x, y + 2e-3, deep),
                (64, x, y + 2e-3, HEIGHT + 8e-3),
                (73, x, y + 2e-3, HEIGHT + 8e-3),
            ],
        )


GREEN, BLUE = (0.30, 0.46, 0.36, 1.0), (0.22, 0.36, 0.52, 1.0)
STEEL, ROSE = (0.45, 0.48, 0.52, 1.0), (0.56, 0.34, 0.36, 1.0)


def _desk(scene: bpy.types.Scene, width: float) -> None:
    _link(scene, "Desk", block(width, 0.07, 4e-3), (0.0, 0.0, DESK), (0.20, 0.17, 0.15, 1.0))


def _link(
    scene: bpy.types.Scene, name: str, data: bpy.types.Mesh, at: Any, colour: tuple[float, ...]
) -> bpy.types.Object:
    obj = bpy.data.objects.new(name, data)
    obj.location = at
    made = bpy.data.materials.new(name)
    made.diffuse_color = colour
    data.materials.append(made)
    scene.collection.objects.link(obj)
    return obj


def _touchable(obj: bpy.types.Object, friction: float, soft: float = 0.0) -> None:
    obj.dermis.role = "TOUCHABLE"
    obj.dermis.material.friction = friction
    obj.dermis.material.surface_stiffness_mpa_m = soft


def _finger(scene: bpy.types.Scene, name: str, preset: str, level: str) -> bpy.types.Object:
    obj = bpy.data.objects.new(name, fingertip_mesh(1.0))
    scene.collection.objects.link(obj)
    obj.dermis.role = "FINGER"
    skin = obj.dermis.finger.skin
    try:
        skin_properties.apply_preset(skin, library().skin(preset))
        skin.preset = preset
    except DermisError:
        pass  # removed by the user: the defaults do
    fit(obj, skin_properties.lengths(skin), metres_per_unit(scene))  # the window's scene may have another unit
    skin.level, skin.shown = level, True
    return obj


def _path(obj: bpy.types.Object, rows: list[tuple[float, float, float, float]]) -> None:
    """Key a finger's way: rows of frame and place [m]."""
    frames = [row[0] for row in rows]
    for axis in range(3):
        compat.set_keys(obj, "location", axis, frames, [row[1 + axis] for row in rows], interpolation="BEZIER")

"""The example: a pair of fingers strokes a ribbed plate and lifts a box, another feels bumps on a touch screen.

Everything has its real size; the scene's unit is the metre, shown in millimetres.
"""

from __future__ import annotations

import math
from typing import Any

import bpy
import numpy as np
from mathutils import Euler, Vector

from .. import compat
from .._core import DermisError
from ..fingertip_mesh import mesh as fingertip_mesh
from ..preferences import library
from ..properties import scene_properties

FPS, LAST = 24, 97  # four seconds
PLATE, BOX, SCREEN = Vector((-0.085, 0.0, 0.006)), Vector((0.0, 0.02, 0.02)), Vector((0.1, 0.0, 0.004))
BOX_SIZE = (0.030, 0.030, 0.040)
SCREEN_SIZE = (0.096, 0.060)
RIB_PERIOD, RIB_HEIGHT = 0.004, 0.0003
NAME = "Dermis Demo"


def build(tactor: str, friction: str) -> bpy.types.Scene:
    """Return a new scene with everything in it.

    Args:
        tactor, friction: keys of a shear tactor's and of a friction screen's preset; '' leaves the fingers bare.
    """
    scene = bpy.data.scenes.new(NAME)
    scene.render.fps, scene.render.fps_base = FPS, 1.0
    scene.frame_start, scene.frame_end = 1, LAST
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 1.0
    scene.unit_settings.length_unit = "MILLIMETERS"
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.render.resolution_x, scene.render.resolution_y = 1280, 720
    _stage(scene)
    plate = _link(scene, "Plate", ribbed_plate(0.090, 0.056, 0.006), PLATE, (0.42, 0.45, 0.49, 1.0))
    box = _link(scene, "Box", _block(*BOX_SIZE), BOX, (0.16, 0.36, 0.50, 1.0))
    screen = screen_object(SCREEN_SIZE, bumps_image(SCREEN_SIZE), 1.0)
    scene.collection.objects.link(screen)
    screen.location = SCREEN
    _touchable(
        plate,
        "grill_plate",
        texture_on=True,
        texture_amplitude_x=0.25,
        texture_amplitude_y=0.05,
        texture_period_x=RIB_PERIOD,
        texture_period_y=RIB_PERIOD,
        transient_frequency=150.0,
    )
    _touchable(box, "wood", weight_on=True, weight_gravity=0.05, weight_acceleration=0.05, mass=0.08, held_mode="keyed")
    index, thumb = (_finger(scene, name, tactor) for name in ("Index", "Thumb"))
    reader = _finger(scene, "Reader", friction)
    if friction:
        reader.dermis.finger.devices[0].screen = screen
    _animate_pair(index, thumb, box)
    _animate_reader(reader)
    scene_properties.stamp(scene)
    scene.frame_set(1)
    return scene


def look(context: bpy.types.Context) -> None:
    """Make the first finger active and turn the window's 3D views to the scene."""
    fingers = (o for o in context.scene.objects if o.dermis.role == "FINGER")  # by name: Index comes first
    context.view_layer.objects.active = min(fingers, key=lambda o: o.name)
    if bpy.app.background or context.window is None:
        return
    for area in context.window.screen.areas:
        if area.type != "VIEW_3D":
            continue
        space = area.spaces.active
        space.clip_start, space.lens = 0.002, 50.0
        space.shading.color_type = "TEXTURE"
        space.shading.show_cavity = space.shading.show_shadows = True
        space.overlay.show_relationship_lines = space.overlay.show_cursor = False
        space.show_region_ui = True
        view = space.region_3d
        view.view_perspective = "PERSP"
        view.view_location = Vector((0.044, 0.0, -0.004))
        view.view_rotation = Euler((math.radians(58.0), 0.0, math.radians(3.0))).to_quaternion()
        view.view_distance = 0.31


def bumps_image(size: tuple[float, float]) -> bpy.types.Image:
    """Return a new image of round bumps on flat ground, packed into the file.

    Args:
        size: width and height that it will cover [m].
    """
    width, height = 384, max(8, round(384 * size[1] / size[0]))
    x, y = np.meshgrid((np.arange(width) + 0.5) / width * size[0], (np.arange(height) + 0.5) / height * size[1])
    relief = np.zeros_like(x)
    pitch, radius = size[0] / 6.0, size[0] / 14.0
    rows = max(1, int(size[1] / pitch))
    for row in range(rows):
        for column in range(6):
            cx = (column + 0.5) * pitch
            cy = 0.5 * size[1] + (row - 0.5 * (rows - 1)) * pitch
            r = np.hypot(x - cx, y - cy) / radius
            relief = np.maximum(relief, np.where(r < 1.0, np.cos(0.5 * np.pi * np.minimum(r, 1.0)) ** 2, 0.0))
    image = bpy.data.images.new("Bumps", width, height, float_buffer=True, is_data=True)
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = relief[..., None]
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    image.pack()
    return image


def screen_object(size: tuple[float, float], image: bpy.types.Image | None, unit: float) -> bpy.types.Object:
    """Return a new touch screen, not yet in any collection: a rectangle that looks along +Z and shows its relief."""
    w, h = 0.5 * size[0] / unit, 0.5 * size[1] / unit
    data = bpy.data.meshes.new("Touch Screen")
    data.from_pydata([(-w, -h, 0.0), (w, -h, 0.0), (w, h, 0.0), (-w, h, 0.0)], [], [(0, 1, 2, 3)])
    layer = data.uv_layers.new(name="UVMap")
    layer.data.foreach_set("uv", [0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0])
    obj = bpy.data.objects.new("Touch Screen", data)
    obj.dermis.role = "SCREEN"
    obj.dermis.screen.image = image
    material = _material("Touch Screen", (0.10, 0.13, 0.17, 1.0))
    if image is not None:
        nodes = material.node_tree.nodes
        texture = nodes.new("ShaderNodeTexImage")
        texture.image = image
        shader = next(n for n in nodes if n.type == "BSDF_PRINCIPLED")
        material.node_tree.links.new(texture.outputs["Color"], shader.inputs["Base Color"])
        nodes.active = texture
    data.materials.append(material)
    return obj


def ribbed_plate(width: float, depth: float, thickness: float) -> bpy.types.Mesh:
    """Return a plate whose top carries ribs along Y; the top's crests lie at z = 0 [m]."""
    columns = round(width / RIB_PERIOD) * 12
    x = np.linspace(-0.5 * width, 0.5 * width, columns + 1)
    top = 0.5 * RIB_HEIGHT * (np.cos(2.0 * np.pi * x / RIB_PERIOD) - 1.0)
    n, d = columns + 1, 0.5 * depth
    low = np.full(n, -thickness)
    rows = ((-d, top), (d, top), (d, low), (-d, low))
    vertices = np.vstack([np.column_stack([x, np.full(n, y), z]) for y, z in rows])
    i = np.arange(columns)
    faces = [(int(a), int(a + 1), int(a + n + 1), int(a + n)) for start in (0, n, 2 * n) for a in i + start]
    faces += [(int(a + 3 * n), int(a + 3 * n + 1), int(a + 1), int(a)) for a in i]
    faces += [(0, n, 2 * n, 3 * n), (columns, columns + 3 * n, columns + 2 * n, columns + n)]
    data = bpy.data.meshes.new("Plate")
    data.from_pydata(vertices.tolist(), [], faces)
    data.update()
    return data


def _stage(scene: bpy.types.Scene) -> None:
    _link(scene, "Desk", _block(0.36, 0.16, 0.006), Vector((0.01, 0.0, -0.003)), (0.20, 0.17, 0.15, 1.0))
    _link(
        scene,
        "Screen Body",
        _block(SCREEN_SIZE[0] + 0.010, SCREEN_SIZE[1] + 0.010, 0.0036),
        Vector((SCREEN.x, SCREEN.y, 0.0018)),
        (0.05, 0.055, 0.06, 1.0),
    )
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.lens, camera.data.clip_start = 50.0, 0.005
    camera.data.display_size = 0.02
    camera.location = (0.075, -0.40, 0.29)
    camera.rotation_euler = (Vector((0.008, 0.0, 0.012)) - camera.location).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(camera)
    scene.camera = camera
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 3.0, (math.radians(40.0), math.radians(20.0), 0.0)
    scene.collection.objects.link(sun)


def _link(scene: bpy.types.Scene, name: str, data: bpy.types.Mesh, at: Vector, colour: Any) -> bpy.types.Object:
    obj = bpy.data.objects.new(name, data)
    obj.location = at
    if colour is not None:
        data.materials.append(_material(name, colour))
    scene.collection.objects.link(obj)
    return obj


def _material(name: str, colour: tuple[float, ...]) -> bpy.types.Material:
    made = bpy.data.materials.new(name)
    if made.node_tree is None:
        made.use_nodes = True
    made.diffuse_color = colour
    shader = next(n for n in made.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    shader.inputs["Base Color"].default_value = colour
    return made


def _block(x: float, y: float, z: float) -> bpy.types.Mesh:
    """Return a closed block around its middle, with a fine chamfer so that edges catch light."""
    import bmesh

    data = bpy.data.meshes.new("Block")
    block = bmesh.new()
    bmesh.ops.create_cube(block, size=1.0)
    bmesh.ops.scale(block, vec=(x, y, z), verts=block.verts)
    bmesh.ops.bevel(
        block, geom=block.edges[:], offset=0.05 * min(x, y, z) + 0.0002, segments=2, profile=0.5, affect="EDGES"
    )
    block.to_mesh(data)
    block.free()
    return data


def _finger(scene: bpy.types.Scene, name: str, device: str) -> bpy.types.Object:
    obj = _link(scene, name, fingertip_mesh(1.0), Vector((0.0, 0.0, 0.1)), None)
    obj.dermis.role = "FINGER"
    if device:
        obj.dermis.finger.devices.add().preset = device
    return obj


def _touchable(obj: bpy.types.Object, preset: str, **values: Any) -> None:
    """Take a material preset where there is one, and set what the demo needs whatever it says (SI)."""
    obj.dermis.role = "TOUCHABLE"
    try:
        scene_properties.apply_parameters(obj.dermis.material, library().material(preset))
        obj.dermis.material.preset = preset
    except DermisError:
        pass  # removed by the user: the values below do
    scene_properties.apply_parameters(obj.dermis.material, values)


def _keys(obj: bpy.types.Object, path: str, rows: list[tuple[Any, ...]], interpolation: str = "BEZIER") -> None:
    """Key a property: rows of (frame, value ...)."""
    frames = [row[0] for row in rows]
    for index in range(len(rows[0]) - 1):
        compat.set_keys(obj, path, index, frames, [row[1 + index] for row in rows], interpolation=interpolation)


def _animate_pair(index: bpy.types.Object, thumb: bpy.types.Object, box: bpy.types.Object) -> None:
    """Tap the plate, stroke it there and back, pinch the box, lift and shake it."""
    touch = 0.0002  # the pad's skin gives way by less than its touch distance
    plate, side = PLATE.z + touch, 0.5 * BOX_SIZE[0] + touch
    left, right = PLATE.x - 0.030, PLATE.x + 0.030
    grip = BOX.z + 0.006
    _keys(
        index,
        "location",
        [
            (1, left, 0.0, plate + 0.030),
            (9, left, 0.0, plate),
            (13, left, 0.0, plate),
            (25, right, 0.0, plate),
            (29, right, 0.0, plate),
            (41, left, 0.0, plate),
            (44, left, 0.0, plate),
            (50, -0.05, 0.0, 0.055),
            (58, 0.045, BOX.y, 0.050),
            (64, side + 0.010, BOX.y, grip),
            (67, side, BOX.y, grip),
            *_lifted(side, grip),
        ],
    )
    _keys(
        thumb,
        "location",
        [
            (1, -0.040, 0.050, 0.030),
            (50, -0.040, 0.050, 0.030),
            (58, -side - 0.022, BOX.y, 0.040),
            (64, -side - 0.010, BOX.y, grip),
            (67, -side, BOX.y, grip),
            *_lifted(-side, grip),
        ],
    )
    quarter = 0.5 * math.pi
    _keys(index, "rotation_euler", [(1, 0, 0, 0), (46, 0, 0, 0), (60, 0, quarter, 0), (97, 0, quarter, 0)])
    _keys(thumb, "rotation_euler", [(1, 0, 0, 0), (48, 0, 0, 0), (60, 0, -quarter, 0), (97, 0, -quarter, 0)])
    _keys(
        box,
        "location",
        [(1, *BOX), (67, *BOX), *((f, 0.0, BOX.y, z - grip + BOX.z) for f, _, _, z in _lifted(0.0, grip))],
    )
    compat.set_keys(box, "dermis.material.held", 0, [1, 68, 96], [0, 1, 1], interpolation="CONSTANT")


def _lifted(x: float, z: float) -> list[tuple[float, float, float, float]]:
    """Where the hand goes with the box: up, two shakes, and a halt."""
    heights = ((69, 0.0), (78, 0.030), (82, 0.018), (86, 0.034), (90, 0.020), (94, 0.028), (97, 0.028))
    return [(frame, x, BOX.y, z + up) for frame, up in heights]


def _animate_reader(reader: bpy.types.Object) -> None:
    """Come down on the screen and zigzag over the bumps."""
    top = SCREEN.z + 0.0002
    w, h = 0.42 * SCREEN_SIZE[0], 0.30 * SCREEN_SIZE[1]
    rows = [(1, SCREEN.x - w, SCREEN.y - h, top + 0.025), (10, SCREEN.x - w, SCREEN.y - h, top)]
    for i, y in enumerate((-h, 0.0, h)):
        start, end = (-w, w) if i % 2 == 0 else (w, -w)
        rows += [(13 + 27 * i, SCREEN.x + start, SCREEN.y + y, top), (34 + 27 * i, SCREEN.x + end, SCREEN.y + y, top)]
    rows += [(97, SCREEN.x - w, SCREEN.y + h, top + 0.02)]
    rows[-2] = (88, *rows[-2][1:])
    _keys(reader, "location", rows)

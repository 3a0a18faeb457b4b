"""Build the main example scene.

A finger strokes a ribbed plate. It and a thumb then lift a box. A third finger feels bumps on a touch screen.
Everything has its real size; the scene's unit is the metre, shown in millimetres.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any

import bpy
import numpy as np
from mathutils import Vector

from .. import compat
from .._core import DermisError
from ..fingertip_mesh import coloured, shader_of
from ..preferences import library
from ..properties import object_properties
from . import demo_stage
from .demo_shapes import RIB_PERIOD, chamfered_block, mesh, ribbed_plate

FPS, LAST = 24, 97  # frame rate [Hz] and last frame, for four seconds
PLATE, BOX, SCREEN = Vector((-0.085, 0.0, 0.006)), Vector((0.0, 0.02, 0.02)), Vector((0.1, 0.0, 0.004))
BOX_SIZE = (0.030, 0.030, 0.040)
SCREEN_SIZE = (0.096, 0.060)
NAME = "Dermis Demo"
BUMPS = 22.5  # approximate number of bumps on a screen


def build(tactor: str, friction: str) -> bpy.types.Scene:
    """Return a new scene with all objects of the example.

    Args:
        tactor, friction: keys of a shear tactor's and of a friction screen's preset; '' leaves the fingers bare.
    """
    scene = demo_stage.begin(NAME, FPS, LAST)
    scene.render.resolution_x, scene.render.resolution_y = 1280, 720
    _furnish(scene)
    plate = demo_stage.add(scene, "Plate", ribbed_plate(0.090, 0.056, 0.006), PLATE, (0.42, 0.45, 0.49, 1.0))
    box = demo_stage.add(scene, "Box", chamfered_block(*BOX_SIZE), BOX, (0.16, 0.36, 0.50, 1.0))
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
    index, thumb = (demo_stage.finger(scene, name, tactor) for name in ("Index", "Thumb"))
    reader = demo_stage.finger(scene, "Reader", friction)
    if friction:
        reader.dermis.finger.devices[0].screen = screen
    _animate_pair(index, thumb, box)
    _animate_reader(reader)
    return demo_stage.finish(scene, (0.075, -0.40, 0.29), (0.008, 0.0, 0.012), lens=50.0)


def look(context: bpy.types.Context) -> None:
    """Make the first finger active, and turn the 3D views to the scene."""
    views = demo_stage.look(context, (0.044, 0.0, -0.004), (58.0, 0.0, 3.0), 0.31, lens=50.0, colours="TEXTURE")
    for space in views:
        space.shading.show_cavity = space.shading.show_shadows = True
        space.overlay.show_cursor = False


def bumps_image(size: tuple[float, float]) -> bpy.types.Image:
    """Return a new image of round bumps on flat ground, packed into the file.

    Args:
        size: width and height of the screen that it covers [m].
    """
    pitch = min(math.sqrt(size[0] * size[1] / BUMPS), *size)
    density = min(64.0 / pitch, 4096.0 / max(size))
    width, height = (max(8, round(density * length)) for length in size)
    x, y = (_from_bumps(n, length, pitch) for n, length in ((width, size[0]), (height, size[1])))
    r = np.hypot(*np.meshgrid(x, y)) / (6.0 / 14.0 * pitch)
    relief = np.where(r < 1.0, np.cos(0.5 * np.pi * np.minimum(r, 1.0)) ** 2, 0.0)
    image = bpy.data.images.new("Bumps", width, height, float_buffer=True, is_data=True)
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = relief[..., None]
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    image.pack()
    return image


def _from_bumps(pixels: int, length: float, pitch: float) -> np.ndarray:
    """Return the signed distance of each pixel to the nearest bump [m].

    It is measured along one side of the image, from the middle of the bump. Its shape is (pixels,).
    """
    count = max(1, int(length / pitch + 1e-6))
    place = ((np.arange(pixels) + 0.5) / pixels - 0.5) * length / pitch + 0.5 * (count - 1)
    return (place - np.clip(np.round(place), 0, count - 1)) * pitch


def screen_object(size: tuple[float, float], image: bpy.types.Image | None, unit: float) -> bpy.types.Object:
    """Return a new touch screen that is in no collection yet.

    It is a rectangle that faces +Z and shows its relief.
    """
    w, h = 0.5 * size[0] / unit, 0.5 * size[1] / unit
    data = mesh("Touch Screen", [(-w, -h, 0.0), (w, -h, 0.0), (w, h, 0.0), (-w, h, 0.0)], [(0, 1, 2, 3)])
    layer = data.uv_layers.new(name="UVMap")
    layer.data.foreach_set("uv", [0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0])
    obj = bpy.data.objects.new("Touch Screen", data)
    obj.dermis.role = "SCREEN"
    obj.dermis.screen.image = image
    material = coloured("Touch Screen", (0.10, 0.13, 0.17, 1.0))
    if image is not None:
        nodes = material.node_tree.nodes
        texture = nodes.new("ShaderNodeTexImage")
        texture.image = image
        material.node_tree.links.new(texture.outputs["Color"], shader_of(material).inputs["Base Color"])
        nodes.active = texture
    data.materials.append(material)
    return obj


def _furnish(scene: bpy.types.Scene) -> None:
    desk, body = chamfered_block(0.36, 0.16, 0.006), (SCREEN_SIZE[0] + 0.010, SCREEN_SIZE[1] + 0.010, 0.0036)
    demo_stage.add(scene, "Desk", desk, (0.01, 0.0, -0.003), (0.20, 0.17, 0.15, 1.0))
    at = (SCREEN.x, SCREEN.y, 0.0018)
    demo_stage.add(scene, "Screen Body", chamfered_block(*body), at, (0.05, 0.055, 0.06, 1.0))
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 3.0, (math.radians(40.0), math.radians(20.0), 0.0)
    scene.collection.objects.link(sun)


def _touchable(obj: bpy.types.Object, preset: str, **values: Any) -> None:
    """Make an object touchable with a material preset and further SI values."""
    obj.dermis.role = "TOUCHABLE"
    with suppress(DermisError):  # if the user has removed the preset, the values below are enough
        object_properties.apply_parameters(obj.dermis.material, library().material(preset))
        obj.dermis.material.preset = preset
    object_properties.apply_parameters(obj.dermis.material, values)


def _animate_pair(index: bpy.types.Object, thumb: bpy.types.Object, box: bpy.types.Object) -> None:
    """Key the pair: tap and stroke the plate, then pinch, lift, shake the box."""
    touch = 0.0002  # [m] gap at which the finger touches; the pad's touch distance is larger
    plate, side = PLATE.z + touch, 0.5 * BOX_SIZE[0] + touch
    left, right = PLATE.x - 0.030, PLATE.x + 0.030
    grip = BOX.z + 0.006
    demo_stage.key(
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
    demo_stage.key(
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
    demo_stage.key(index, "rotation_euler", [(1, 0, 0, 0), (46, 0, 0, 0), (60, 0, quarter, 0), (97, 0, quarter, 0)])
    demo_stage.key(thumb, "rotation_euler", [(1, 0, 0, 0), (48, 0, 0, 0), (60, 0, -quarter, 0), (97, 0, -quarter, 0)])
    demo_stage.key(
        box,
        "location",
        [(1, *BOX), (67, *BOX), *((f, 0.0, BOX.y, z - grip + BOX.z) for f, _, _, z in _lifted(0.0, grip))],
    )
    compat.set_keys(box, "dermis.material.held", 0, [1, 68, 96], [0, 1, 1], interpolation="CONSTANT")
    # The hand takes over the load gradually, because a sudden weight would be faster than the device.
    gravity = box.dermis.material.weight_gravity
    compat.set_keys(box, "dermis.material.weight_gravity", 0, [68, 71], [0.0, gravity])


def _lifted(x: float, z: float) -> list[tuple[float, float, float, float]]:
    """Return the keys of a hand that lifts the box, shakes it twice and halts."""
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
    demo_stage.key(reader, "location", rows)

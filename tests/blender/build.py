"""Small exact scenes for the tests that need Blender."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np

from blender_addon import compat, preferences
from blender_addon._core import core
from blender_addon.results import store
from blender_addon.sampling import scene_sweep
from core.scene.tactile_scene import constant


def empty(name: str, location: Sequence[float] = (0.0, 0.0, 0.0)) -> bpy.types.Object:
    """Add an empty to the scene."""
    obj = bpy.data.objects.new(name, None)
    bpy.context.scene.collection.objects.link(obj)
    obj.location = location
    return obj


def mesh_object(name: str, vertices: Any, faces: Any, location: Sequence[float] = (0.0, 0.0, 0.0)) -> bpy.types.Object:
    """Add a mesh object to the scene."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([tuple(map(float, v)) for v in vertices], [], [tuple(map(int, f)) for f in faces])
    mesh.update()
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(obj)
    obj.location = location
    return obj


CUBE = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
CUBE_FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def cube(name: str = "Cube", size: float = 1.0, location: Sequence[float] = (0.0, 0.0, 0.0)) -> bpy.types.Object:
    """Add a touchable cube of an edge length."""
    obj = mesh_object(name, np.array(CUBE) * size, CUBE_FACES, location)
    obj.dermis.role = "TOUCHABLE"
    return obj


def finger(name: str = "Finger", location: Sequence[float] = (0.0, 0.0, 5.0)) -> bpy.types.Object:
    """Add a finger without a device, whose contact is solved at nodes whatever the default is."""
    obj = empty(name, location)
    obj.dermis.role = "FINGER"
    obj.dermis.finger.skin.contact = "nodes"
    return obj


def pressing() -> tuple[bpy.types.Scene, bpy.types.Object]:
    """Return a scene of nine frames and its active finger, which presses a plate and slides 2 mm on it."""
    scene, hand = span(1, 9), finger()
    hand.dermis.finger.skin.level = "draft"
    cube("Plate", 0.04, (0.0, 0.0, 0.0))
    z = [0.04, 0.022, *[0.0193] * 7]
    keys(hand, "location", list(range(1, 10)), np.column_stack([np.zeros(9), np.linspace(0, 2e-3, 9), z]))
    scene.dermis.sample_rate = 48.0
    bpy.context.view_layer.objects.active = hand
    return scene, hand


def screen(name: str = "Screen", width: float = 0.2, height: float = 0.1) -> bpy.types.Object:
    """Add a touch screen of a size, in the XY plane."""
    w, h = width / 2, height / 2
    obj = mesh_object(name, [(-w, -h, 0), (w, -h, 0), (w, h, 0), (-w, h, 0)], [(0, 1, 2, 3)])
    obj.dermis.role = "SCREEN"
    return obj


def keys(owner: bpy.types.ID, path: str, frames: Sequence[float], values: Any, interpolation: str = "LINEAR") -> None:
    """Key a property, or each component of a vector given as rows of `values`."""
    table = np.asarray(values, np.float64)
    columns = table[:, None] if table.ndim == 1 else table
    for index in range(columns.shape[1]):
        compat.set_keys(owner, path, index, frames, columns[:, index].tolist(), interpolation=interpolation)


def keep(scene: Any, *outputs: Any, content_hash: str = "hash") -> Any:
    """Keep some tracks as the scene's bake, as if it had been made from the scene as it is; return the `Result`.

    Fingers that are missing are put into the scene, and something to touch, far away.
    """
    for name in dict.fromkeys(output.finger for output in outputs):
        obj = bpy.data.objects.get(name) or bpy.data.objects.new(name, None)
        if obj.name not in scene.objects:
            scene.collection.objects.link(obj)
        obj.dermis.role = "FINGER"
    if not any(obj.dermis.role == "TOUCHABLE" for obj in scene.objects):
        block = bpy.data.objects.get("Far Block") or cube("Far Block", location=(0.0, 0.0, -50.0))
        if block.name not in scene.objects:
            scene.collection.objects.link(block)
    bpy.context.view_layer.update()
    sampled = scene_sweep.sample(scene)
    inputs = core.steps.drain(core.pipeline.inputs.sampled(sampled, preferences.library()))
    return store.keep(scene, core.pipeline.bake.Bake(outputs, (), {}, content_hash, inputs=inputs))


def span(first: int, last: int, fps: int = 24, fps_base: float = 1.0) -> bpy.types.Scene:
    """Set the scene's range and frame rate; return the scene."""
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = first, last
    scene.render.fps, scene.render.fps_base = fps, fps_base
    return scene


def joined(tactile: Any) -> dict[str, Any]:
    """Draw all chunks of a sampled scene and join their arrays; what a chunk does not bring comes from the header."""
    chunks = list(tactile.chunks)
    deforming = sorted({b for c in chunks for b in c.surfaces})
    keys = sorted({key for c in chunks for key in c.animated})

    def surface(b: int, c: Any) -> Any:
        return c.surfaces.get(b) or (tactile.bodies[b].mesh,) * len(c.times)

    def values(key: str, c: Any) -> Any:
        return c.animated[key] if key in c.animated else np.full(len(c.times), constant(tactile, key))

    out: dict[str, Any] = {
        "frames": np.concatenate([c.frames for c in chunks]),
        "times": np.concatenate([c.times for c in chunks]),
        "fingers": np.concatenate([c.fingers for c in chunks], axis=1),
        "bodies": np.concatenate([c.bodies for c in chunks], axis=1),
        "screens": np.concatenate([c.screens for c in chunks], axis=1),
        "surfaces": {b: [m for c in chunks for m in surface(b, c)] for b in deforming},
        "animated": {key: np.concatenate([values(key, c) for c in chunks]) for key in keys},
    }
    return out

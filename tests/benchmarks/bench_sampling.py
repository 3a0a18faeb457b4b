"""What sampling a scene costs over Blender's own evaluation of the same moments, in processor's time.

Two kinds of scene in which every moment must be looked at: meshes that armatures bend, and a scene in which scripts run
at changes of the frame, though they change nothing. The limits are 1.1 times the ratios of 2.66 and 2.82 that were
measured before faces that bend were cut as Blender cuts them, and before it was watched what scripts change.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from . import Result, benchmark, one_blas_thread

MESHES, AROUND, ALONG, FRAMES, TURNS = 5, 24, 24, 49, 7
STILL = 10
"""Objects that nothing moves, in the scene with scripts."""


@benchmark("sample_bent_ratio", limit=2.9, quick=True)
def sample_bent() -> Result:
    """Five tubes of 576 quads that armatures bend."""
    return _measured("sample_bent_ratio", _bent)


@benchmark("sample_scripted_ratio", limit=3.1, quick=True)
def sample_scripted() -> Result:
    """A finger over still boxes and a touch screen, with a script that changes nothing."""
    return _measured("sample_scripted_ratio", _scripted)


def _idle(_scene: Any, _depsgraph: Any = None) -> None: ...


def _measured(name: str, make: Callable[[], Any]) -> Result:
    import bpy
    import numpy as np

    import blender_addon
    from blender_addon.sampling import frames as frames_of
    from blender_addon.sampling import scene_sweep

    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender_addon.register()
    try:
        scene = make()
        frames, _ = frames_of.sweep_frames(scene, frames_of.frame_range(scene), 240.0)
        places = [(int(frame), frame - int(frame)) for frame in frames.tolist()]
        ours, bare = [], []
        with one_blas_thread():
            for turn in range(TURNS + 1):
                before = time.process_time()
                for whole, part in places:
                    scene.frame_set(whole, subframe=part)
                middle = time.process_time()
                sampled = scene_sweep.sample(scene)
                begun = time.process_time()
                chunks = list(sampled.chunks)
                after = time.process_time()
                if turn:  # the first loads modules
                    bare.append(middle - before)
                    ours.append(after - begun)
        scene.frame_set(whole, subframe=part)
        wrong = _wrong(scene, chunks, [body.name for body in sampled.bodies])
    finally:
        blender_addon.unregister()
        if _idle in bpy.app.handlers.frame_change_post:
            bpy.app.handlers.frame_change_post.remove(_idle)
    ratios = np.array(ours) / np.array(bare)
    each = 1e6 / len(places)
    peers = {"sampling, us": each * min(ours), "frame_set, us": each * min(bare)}
    return Result(name, float(np.median(ratios)), "1", float(np.percentile(ratios, 95)), peers, wrong)


def _wrong(scene: Any, chunks: list[Any], names: list[str]) -> str | None:
    """Return in words which surface of the last sample is not Blender's."""
    import bpy
    import numpy as np

    depsgraph = bpy.context.evaluated_depsgraph_get()
    for body, meshes in chunks[-1].surfaces.items():
        evaluated = scene.objects[names[body]].evaluated_get(depsgraph)
        truth = np.array([vertex.co for vertex in evaluated.data.vertices], np.float64)
        if not np.array_equal(meshes[-1].vertices, truth):
            return f"the surface of '{names[body]}' is not Blender's at the last sample"
    return None


def _bent() -> Any:
    import bpy
    import numpy as np

    from tests.blender import build

    scene = build.span(1, FRAMES)
    turns = 2 * np.pi * np.arange(AROUND) / AROUND
    ring = 0.01 * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    heights = np.linspace(0.0, 0.1, ALONG + 1)
    places = np.array([(x, y, z) for z in heights.tolist() for x, y in ring.tolist()])
    cells = [(r, a, (a + 1) % AROUND) for r in range(ALONG) for a in range(AROUND)]
    faces = [(r * AROUND + a, r * AROUND + b, (r + 1) * AROUND + b, (r + 1) * AROUND + a) for r, a, b in cells]
    for i in range(MESHES):
        tube = build.mesh_object(f"Tube {i}", places, faces, (0.03 * i, 0.0, 0.0))
        tube.dermis.role = "TOUCHABLE"
        bpy.ops.object.armature_add(location=(0.03 * i, 0.0, 0.0))
        rig = bpy.context.object
        bpy.ops.object.mode_set(mode="EDIT")
        low = rig.data.edit_bones[0]
        low.name, low.tail = "Low", (0.0, 0.0, 0.05)
        high = rig.data.edit_bones.new("High")
        high.head, high.tail, high.parent = (0.0, 0.0, 0.05), (0.0, 0.0, 0.1), low
        bpy.ops.object.mode_set(mode="OBJECT")
        weights = np.clip((places[:, 2] - 0.04) / 0.02, 0.0, 1.0)
        for group, share in (("Low", 1.0 - weights), ("High", weights)):
            made = tube.vertex_groups.new(name=group)
            for vertex, weight in enumerate(share.tolist()):
                made.add([vertex], weight, "REPLACE")
        tube.modifiers.new("Armature", "ARMATURE").object = rig
        rig.pose.bones["High"].rotation_mode = "XYZ"
        build.keys(rig, 'pose.bones["High"].rotation_euler', [1, FRAMES], [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    _moving_finger()
    return scene


def _scripted() -> Any:
    import bpy

    from tests.blender import build

    scene = build.span(1, FRAMES)
    for i in range(STILL):
        build.cube(f"Box {i}", 0.05, (0.1 * i, 0.0, 0.0))
    build.screen()
    _moving_finger()
    bpy.app.handlers.frame_change_post.append(_idle)
    return scene


def _moving_finger() -> None:
    import bpy

    from tests.blender import build

    tip = build.finger()
    build.keys(tip, "location", [1, FRAMES], [(0.0, 0.0, 0.2), (0.1, 0.0, 0.15)])
    bpy.context.view_layer.update()

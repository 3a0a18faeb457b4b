"""What a bake costs beyond Blender's own: per sample of 240 Hz, five fingers over three objects, on HapTip."""

from __future__ import annotations

import time

from . import Result, benchmark, one_blas_thread, timing

FINGERS, BODIES, FRAMES, REPEAT = 5, 3, 121, 9


@benchmark("bake_own_us", limit=150, quick=True)
def bake_own() -> Result:
    """A whole bake minus a bare frame_set sweep over the same sub-frames, in turns, divided by the samples."""
    import bpy

    import blender_addon
    from blender_addon import baking
    from blender_addon.sampling import frames as frames_of
    from core.presets import Library
    from core.steps import drain

    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender_addon.register()
    try:
        scene = _scene()
        library = Library(None)
        frames, _ = frames_of.sweep_frames(scene, frames_of.frame_range(scene), 240.0)
        places = [(int(frame), frame - int(frame)) for frame in frames.tolist()]
        own, bare = [], []
        with one_blas_thread():
            for turn in range(REPEAT + 1):
                before = time.perf_counter()
                for whole, part in places:
                    scene.frame_set(whole, subframe=part)
                middle = time.perf_counter()
                bake = drain(baking.bake(scene, library))
                after = time.perf_counter()
                if turn:  # the first loads modules
                    bare.append(1e6 * (middle - before) / len(places))
                    own.append(1e6 * (after - middle) / len(places) - bare[-1])
    finally:
        blender_addon.unregister()
    touched = sum(float(output.signals["contact"].max()) for output in bake.outputs)
    wrong = None if touched == FINGERS else f"only {touched:g} of {FINGERS} fingers touched anything"
    found = timing(own)
    return Result("bake_own_us", found.median, "us", found.p95, {"bare frame_set": timing(bare).median}, wrong)


def _scene():
    """Five fingers that come down on three boxes, slide over them and lift off."""
    import bpy
    import numpy as np

    from tests.blender import build

    scene = build.span(1, FRAMES)
    for i in range(BODIES):
        body = build.cube(f"Box {i}", 0.1, (0.2 * i, 0, 0))
        body.dermis.material.texture_on = body.dermis.material.weight_on = True
        build.keys(body, "location", [1, FRAMES], [(0.2 * i, 0, 0), (0.2 * i, 0.02, 0.0)])
    for i in range(FINGERS):
        tip = build.finger(f"Finger {i}")
        x = 0.2 * (i % BODIES) - 0.02 + 0.01 * i
        path = np.array([(x, -0.03, 0.08), (x, -0.03, 0.0502), (x, 0.03, 0.0502), (x, 0.03, 0.08)])
        build.keys(tip, "location", [1, 24, 90, FRAMES], path, "BEZIER")
        tip.dermis.finger.devices.add().preset = "haptip"
    bpy.context.view_layer.update()
    return scene

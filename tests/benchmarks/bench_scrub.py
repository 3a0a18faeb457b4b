"""What a frame costs while an artist scrubs five fingers in contact, in Blender.

Measured is everything of ours between Blender's evaluation of a frame and the drawing: sampling the scene, gaps,
contact with its history, displacement and von Mises stress, and the deformed, refined surface with its normals. The
evaluation itself (frame_set) is outside the clock, and so is what the graphics card does. All five draft skins touch in
every frame that counts; they slide there and back, so the solver works in each.
"""

from __future__ import annotations

from typing import Any

from . import Result, benchmark, measure, timing

NAME = "scrub_skin_5fingers_ms"
FRAMES = range(28, 46)  # of the demo: pressed and sliding
FINGERS = 5


@benchmark(NAME, limit=6.0)
def scrub_five_fingers() -> Result:
    """Scrub the five-finger demo forward through its slide, again and again."""
    import time

    import bpy

    import blender_addon

    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender_addon.register()
    try:
        from blender_addon.demos import demo_skin
        from blender_addon.preview import skin_preview
        from blender_addon.viewport import shown as views
        from blender_addon.viewport import skin_shown

        scene = demo_skin.build(FINGERS)
        bpy.context.window.scene = scene
        frames: list[int] = []
        parts: list[tuple[float, float]] = []
        error = ""

        def following() -> None:
            if not frames:
                frames.extend(FRAMES)
                skin_preview.reset()  # or what was solved before would only be shown again
                scene.frame_set(FRAMES[0] - 1)  # a step back: it starts from rest, outside the clock
                skin_preview.step(bpy.context)
            scene.frame_set(frames.pop(0))

        def frame() -> Any:
            nonlocal error
            started = time.perf_counter()
            states = skin_preview.step(bpy.context)
            solved = time.perf_counter()
            drawn = skin_shown.shown(scene, views.skins(scene))
            parts.append((solved - started, time.perf_counter() - solved))
            touching = sum(s.touching for s in states)
            if touching != FINGERS or any(not s.converged or s.work != "solved" for s in states):
                error = f"{touching} of {FINGERS} fingers touch, or one was not solved"
            return drawn

        ours = measure(frame, 180, warmup=2 * len(FRAMES), setup=following)
        counted = parts[2 * len(FRAMES) :]
        step, draw = (timing([1e3 * p[i] for p in counted]).median for i in (0, 1))
        return Result(NAME, ours.median, "ms", ours.p95, {"contact": step, "stress and surface": draw}, error or None)
    finally:
        blender_addon.unregister()
        bpy.ops.wm.read_factory_settings(use_empty=True)

"""What it takes to bake again in Blender: the same scene, and one in which a material of one finger's object changed.

Two fingers with thimbles on standard skins come down on a box each, slide and lift off; two seconds at 240 Hz, one
process. Bakes take turns, so that a machine that others use slows all alike; ratios are of the processor's time.
"""

from __future__ import annotations

import functools
import time
from typing import Any, NamedTuple

from . import Result, benchmark, one_blas_thread, timing

FRAMES, TURNS = 49, 5


class Taken(NamedTuple):
    """Seconds of bakes: on the clock, and of the processor."""

    clock: list[float]
    processor: list[float]


@benchmark("rebake_unchanged_s", limit=0.3, quick=True)
def unchanged() -> Result:
    """The same scene again, everything but its sampling taken from the bake before; a first bake beside it."""
    taken = _bakes()
    again, first = (timing(taken[name].clock) for name in ("unchanged", "first"))
    worked = timing(taken["unchanged"].processor).median
    return Result("rebake_unchanged_s", again.median, "s", again.p95, {"first": first.median, "processor's": worked})


@benchmark("rebake_one_material_ratio", limit=0.55, quick=True)
def one_material() -> Result:
    """One of two fingers concerned, over a first bake."""
    taken = _bakes()
    changed, first = (timing(taken[name].processor).median for name in ("one material", "first"))
    return Result("rebake_one_material_ratio", changed / first, "1", None, {"first, s": first})


@functools.cache
def _bakes() -> dict[str, Taken]:
    """Return what bakes of each kind took, after one that made the tables."""
    import bpy

    import blender_addon
    from blender_addon import baking
    from core.presets import Library
    from core.steps import drain

    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender_addon.register()
    taken = {name: Taken([], []) for name in ("first", "unchanged", "one material")}
    try:
        scene = _scene()
        library, friction = Library(None), 0.5

        def baked(name: str, expected: int) -> None:
            clock, processor = time.perf_counter(), time.process_time()
            made = drain(baking.bake(scene, library, cores=1))
            taken[name].processor.append(time.process_time() - processor)
            taken[name].clock.append(time.perf_counter() - clock)
            assert made.skipped.get("fingers_unchanged", 0) == expected, made.skipped
            assert all(output.signals["contact"].any() for output in made.outputs), "nothing was touched"

        with one_blas_thread():
            for turn in range(TURNS + 1):
                baking.forget()
                baked("first", 0)
                baked("unchanged", 2)
                friction += 0.01
                bpy.data.objects["Box 0"].dermis.material.friction = friction
                baked("one material", 1)
                if not turn:  # which loads modules and makes tables
                    for found in taken.values():
                        found.clock.clear()
                        found.processor.clear()
    finally:
        blender_addon.unregister()
    return taken


def _scene() -> Any:
    """Return two fingers that come down on a box each, slide and lift off."""
    import bpy

    from tests.blender import build

    scene = build.span(1, FRAMES)
    for i in range(2):
        build.cube(f"Box {i}", 0.04, (0.3 * i, 0.0, 0.0))
        tip = build.finger(f"Finger {i}")
        x = 0.3 * i
        path = [(x, -4e-3, 25e-3), (x, -4e-3, 19e-3), (x, 4e-3, 19e-3), (x, 4e-3, 25e-3)]
        build.keys(tip, "location", [1, 9, 40, FRAMES], path, "BEZIER")
        tip.dermis.finger.devices.add().preset = "thimble_3rrs"
    bpy.context.view_layer.update()
    return scene

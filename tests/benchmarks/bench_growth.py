"""How a bake's time and memory grow with what a scene has: fingers, things that nobody touches, length.

Timed is the processor's work on a bake in one process, from poses to tracks, after one that made the tables; sizes take
turns. An exponent is the slope of a straight line through the logarithms of time and size.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from . import Result, benchmark, one_blas_thread

RATE, TURNS = 240.0, 3
FINGERS, OBJECTS, SECONDS = (1, 2, 4, 8), (1, 10, 100, 1000), (0.5, 1.5, 4.5, 13.5)
COUNT, LONGER = 121, 481  # samples, where the length is not what grows


@benchmark("growth_fingers", limit=1.05)
def fingers() -> Result:
    """Fingers with pins on draft skins, a rolling ball each."""
    return _grown("growth_fingers", FINGERS, [_scene(n, n) for n in FINGERS])


@benchmark("growth_idle_objects", limit=0.3, quick=True)
def idle_objects() -> Result:
    """One such finger, beside balls of 1,280 faces half a metre away."""
    return _grown("growth_idle_objects", OBJECTS, [_scene(1, 1, idle=n) for n in OBJECTS])


@benchmark("growth_track", limit=1.02)
def track() -> Result:
    """One such finger, for longer and longer."""
    counts = [int(s * RATE) + 1 for s in SECONDS]
    return _grown("growth_track", SECONDS, [_scene(1, 1, count) for count in counts])


@benchmark("idle_10fingers_ratio", limit=1.05, quick=True)
def idle_fingers() -> Result:
    """One such finger beside nine that touch nothing, over the finger alone, two seconds."""
    alone, beside = _times([_scene(1, 1, LONGER), _scene(10, 1, LONGER)])
    return Result("idle_10fingers_ratio", beside / alone, "1", None, {"alone, s": alone})


@benchmark("memory_mb_per_min_finger", limit=5.0)
def memory() -> Result:
    """What a bake holds of a finger with a thimble's forces, commands and signals, a minute of touch at 240 Hz."""
    from core.pipeline.kept_shares import KeptShares

    held = {}
    for level in ("standard", "draft"):
        before = KeptShares()
        _baked(_scene(1, 1, 2 * COUNT, level=level, device="thimble_3rrs"), before)
        held[level] = before.size / 1e6 / (2 * COUNT / RATE / 60.0)
    return Result("memory_mb_per_min_finger", held["standard"], "MB", None, {"draft": held["draft"]})


def _grown(name: str, sizes: Sequence[float], scenes: Sequence[Any]) -> Result:
    times = _times(scenes)
    slope = float(np.polyfit(np.log(sizes), np.log(times), 1)[0])
    last = math.log(times[-1] / times[-2]) / math.log(sizes[-1] / sizes[-2])
    peers = {f"{size:g}: s": taken for size, taken in zip(sizes, times, strict=True)}
    return Result(name, slope, "1", None, {"from the last but one": last, **peers})


def _times(scenes: Sequence[Any]) -> list[float]:
    """Return the least time of the processor that a bake of each took [s]: others' work only adds to it."""
    taken: list[list[float]] = [[] for _ in scenes]
    with one_blas_thread():
        _baked(scenes[0])
        for _ in range(TURNS):
            for scene, own in zip(scenes, taken, strict=True):
                before = time.process_time()
                _baked(scene)
                own.append(time.process_time() - before)
    return [min(own) for own in taken]


def _baked(scene: Any, before: Any = None) -> None:
    from core.pipeline.render import render
    from core.presets import Library
    from core.steps import drain

    made = drain(render(scene, Library(), before=before))
    assert any(output.signals["contact"].any() for output in made.outputs), "nothing was touched"


@functools.cache
def _ball() -> Any:
    from core.surface.gap import Surface

    return Surface.sphere(15e-3, facets=1200).mesh


def _scene(
    fingers: int,
    touching: int,
    count: int = COUNT,
    *,
    idle: int = 0,
    level: str = "draft",
    device: str = "pin_array_128",
) -> Any:
    """Return fingers in a row, of which some have a ball that rolls under them, and balls that nobody is near."""
    from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, Mesh, TactileScene

    ball = _ball()
    times = np.arange(count) / RATE
    hands = np.tile(np.eye(4), (fingers, count, 1, 1))
    hands[:, :, 0, 3] = 0.1 * np.arange(fingers)[:, None]
    balls = np.tile(np.eye(4), (touching + idle, count, 1, 1))
    phase = np.pi * times
    balls[:touching, :, 0, 3] = hands[:touching, :, 0, 3] + 2e-3 * np.sin(2 * phase)
    balls[:touching, :, 2, 3] = 0.9e-3 - 0.5e-3 * np.cos(phase) - float(ball.vertices[:, 2].max())
    balls[touching:, :, 1, 3] = 0.5 + 0.04 * np.arange(idle)[:, None]
    worn = tuple(Finger(f"finger {i}", (DeviceUse(device),), {"skin_level": level}) for i in range(fingers))
    meshes = [ball] * touching + [Mesh(ball.vertices.copy(), ball.triangles) for _ in range(idle)]
    bodies = tuple(Body(f"ball {i}", mesh, {"friction": 0.6}) for i, mesh in enumerate(meshes))
    cuts = [slice(i, i + 60) for i in range(0, count, 60)]
    chunks = [Chunk(times[c] * RATE, times[c], hands[:, c], balls[:, c], hands[:0, c]) for c in cuts]
    return TactileScene("growth", Fraction(int(RATE)), (0, count - 1), RATE, worn, bodies, (), chunks)

"""A bake that starts with the finger inside a body: processor's seconds, and how far off forces are.

They are compared with those of a finger that comes there from outside.
"""

from __future__ import annotations

import functools
import tempfile
import time
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks import Result, benchmark

Array = NDArray[np.float64]
RATE = 240.0
DEPTH, SLIDE = 3e-3, 3e-3  # of the finger in the body, and of its way along it [m]
DOWN, ALONG = 31, 30  # samples of the way down, or of rest inside, and of the slide
RUNS = 1
LIMIT = 5.0  # [s]


class Bodies(NamedTuple):
    """Bodies and where their origins are along X if the finger is above their highest place [m]."""

    meshes: dict[str, tuple[Any, float]]


@functools.cache
def bodies() -> Bodies:
    """Return a ball, a box whose edge is under the finger, and a ball of 5,120 triangles with bumps of 0.1 mm."""
    from core.scene.tactile_scene import Mesh
    from core.surface.gap import Surface

    ball, wide = Surface.sphere(15e-3, facets=5000), 15e-3
    centre = np.array([0.0, 0.0, -wide])
    ways = (ball.vertices - centre) / wide
    bumps = centre + ways * (wide + 0.1e-3 * np.prod(np.sin(15.0 * ways), axis=1))[:, None]
    box = Surface.block(2 * wide, 2 * wide, 20e-3)
    meshes = {"ball": (ball.mesh, 0.0), "edge": (box.mesh, wide), "mesh": (Mesh(bumps, ball.mesh.triangles), 0.0)}
    return Bodies(meshes)


def scene(name: str, inside: bool) -> Any:
    """Return a finger with a thimble and a body that is 3 mm inside it from the first sample on, or comes there."""
    from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, TactileScene

    mesh, aside = bodies().meshes[name]
    count = DOWN + ALONG
    down = np.full(DOWN, DEPTH) if inside else np.linspace(-0.1e-3, DEPTH, DOWN)
    times = np.arange(count) / RATE
    poses = np.tile(np.eye(4), (1, count, 1, 1))
    poses[0, :, 0, 3] = aside
    poses[0, DOWN:, 1, 3] = np.linspace(0.0, SLIDE, ALONG + 1)[1:]
    poses[0, :, 2, 3] = np.concatenate([down, np.full(ALONG, DEPTH)])
    hands = np.tile(np.eye(4), (1, count, 1, 1))
    finger = Finger("finger", (DeviceUse("thimble_3rrs"),), {"skin_level": "standard"})
    chunk = Chunk(times * RATE, times, hands, poses, hands[:0])
    body = Body(name, mesh, {"friction": 0.6})
    return TactileScene("inside", Fraction(int(RATE)), (0, count - 1), RATE, (finger,), (body,), (), [chunk])


@functools.cache
def cache() -> Any:
    """Return where tables are kept that a first bake makes."""
    from core.cache import Cache

    return Cache(Path(tempfile.mkdtemp(prefix="dermis-bench-inside-")), 10**9)


def bake(name: str, inside: bool) -> tuple[float, Array]:
    """Return the processor's seconds of a bake, and the normal force on the skin at each sample of its device [N]."""
    from core.pipeline.render import render
    from core.presets import Library
    from core.steps import drain

    start = time.process_time()
    made = drain(render(scene(name, inside), Library(), cache=cache()))
    return time.process_time() - start, np.asarray(made.outputs[0].signals["target_force"], np.float64)


@benchmark("inside_bake_s", limit=LIMIT, quick=True)
def inside() -> Result:
    """Processor's seconds of a bake of 61 samples that starts 3 mm inside a ball, an edge or a mesh, the worst."""
    bake("ball", False)  # makes the tables
    runs = {way: {name: [bake(name, way) for _ in range(RUNS)] for name in bodies().meshes} for way in (True, False)}
    seconds = {
        way: {name: float(np.median([taken for taken, _ in found])) for name, found in named.items()}
        for way, named in runs.items()
    }
    apart = 0.0
    for name in bodies().meshes:
        one, other = runs[True][name][0][1], runs[False][name][0][1]
        apart = max(apart, float(np.abs(one[-1] / other[-1] - 1.0)))
        assert other[-1] > 0.1, "the finger touches"
    worst = max(seconds[True], key=lambda name: seconds[True][name])
    told = [f"{name} {taken:.3g} s, from outside {seconds[False][name]:.3g} s" for name, taken in seconds[True].items()]
    print(f"inside_bake_s: {'; '.join(told)}; settled forces {100 * apart:.2g} % apart")
    wrong = None if apart <= 1e-2 else f"settled forces are {100 * apart:.2g} % apart"
    return Result("inside_bake_s", seconds[True][worst], "s", None, {"from outside": seconds[False][worst]}, wrong)

"""What a finger pays for what it does not touch: the faces of a fine mesh, and objects beside its path.

Timed are samples of `SkinSampler`, as a sweep of a scene takes them: one fingertip at 240 Hz, friction 0.6, pressed by
1 mm and sliding at 20 mm/s, in chunks of 64. Runs that are compared take turns chunk by chunk, so that a machine that
others use slows both.
"""

from __future__ import annotations

import functools
import gc
import time
import tracemalloc
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

from . import Result, Timing, benchmark, one_blas_thread, timing
from .bench_gap import even_sphere

MU, RATE, SPEED, DEPTH, CHUNK = 0.6, 240.0, 20e-3, 1e-3, 64
PRESS, CHUNKS = 60, 16
RADIUS, COUNT = 12e-3, 10
# What is beside the path is so far from the pad [m]: less than skin may bulge out.
BESIDE = 2e-3

Step = Callable[[int], None]


@benchmark("faces_ratio", limit=1.5, quick=True)
def faces() -> Result:
    """A ball of 82k faces over one of 1.3k."""
    many, few = _interleaved(_sliding(_ball(64)), _sliding(_ball(8)))
    peers = {"82k, ms": many.median, "82k p95, ms": many.p95, "1.3k, ms": few.median, "1.3k p95, ms": few.p95}
    return Result("faces_ratio", many.median / few.median, "1", None, peers)


@benchmark("near_objects_ratio", limit=1.15, quick=True)
def near_objects() -> Result:
    """Ten boxes of 4,800 faces beside the path over none; thirty, and ten that fly to and fro, beside it."""
    flying = _sliding(_plate(), COUNT, flying=True)
    ten, none, thirty, fast = _interleaved(*(_sliding(_plate(), count) for count in (COUNT, 0, 3 * COUNT)), flying)
    peers = {"thirty": thirty.median / none.median, "flying": fast.median / none.median, "none, ms": none.median}
    return Result("near_objects_ratio", ten.median / none.median, "1", None, peers)


@benchmark("near_objects_mb", limit=40.0)
def near_objects_mb() -> Result:
    """What the same ten boxes take more, at its most."""
    most = []
    for count in (0, COUNT):
        gc.collect()
        tracemalloc.start()
        step = _sliding(_plate(), count)
        for k in range(CHUNKS):
            step(k)
        most.append(tracemalloc.get_traced_memory()[1] / 1e6)
        tracemalloc.stop()
    return Result("near_objects_mb", most[1] - most[0], "MB")


@benchmark("hover_ms", limit=0.1, quick=True)
def hover() -> Result:
    """A finger that glides 2 mm above a box."""
    ours = _interleaved(_sliding(_plate(), depth=-2e-3))[0]
    return Result("hover_ms", ours.median, "ms", ours.p95)


def _interleaved(*steps: Step) -> list[Timing]:
    """Return the time of a sample of each of several fingers, whose chunks take turns, once they are pressed."""
    times: list[list[float]] = [[] for _ in steps]
    with one_blas_thread():
        for k in range(CHUNKS):
            for step, own in zip(steps, times, strict=True):
                started = time.perf_counter()
                step(k)
                own.append((time.perf_counter() - started) * 1e3 / CHUNK)
    return [timing(own[1:]) for own in times]


def _along(k: Any) -> Any:
    """Return where the finger is at frames, to and fro over 6 mm [m]."""
    way = np.maximum(np.asarray(k, dtype=np.float64) - PRESS, 0.0) * SPEED / RATE
    return 3e-3 - np.abs((way + 3e-3) % 12e-3 - 6e-3)


def _sliding(mesh: Any, count: int = 0, depth: float = DEPTH, flying: bool = False) -> Step:
    """Return a function that takes a finger's next chunk on a mesh whose top is its origin, boxes beside its way."""
    from core.contact.skin_sampler import SkinSampler
    from core.scene.tactile_scene import Body, Chunk, Finger, Mesh, TactileScene

    skin = _skin()
    low, high = skin.positions.min(axis=0), skin.positions.max(axis=0)
    box = Mesh(*_box(20, 4e-3))
    bodies = [Body("ground", mesh, {"friction": MU})]
    bodies += [Body(f"box {i}", Mesh(box.vertices.copy(), box.triangles), {"friction": MU}) for i in range(count)]
    scene = TactileScene(
        "near", Fraction(24), (1, 100), RATE, (Finger("index", (), {"solved_at": "samples"}),), tuple(bodies), (), ()
    )
    sampler = SkinSampler(scene, {0: skin})
    poses = np.tile(np.eye(4), (1 + count, CHUNK, 1, 1))
    for i in range(count):  # on either side, one behind the other
        out = 4e-3 + BESIDE
        poses[1 + i, :, :3, 3] = (low[0] - out, high[0] + out)[i % 2], (i // 2 - 2) * 5e-3, 4e-3

    def step(k: int) -> None:
        at = np.arange(k * CHUNK, (k + 1) * CHUNK)
        fingers, objects = np.tile(np.eye(4), (1, CHUNK, 1, 1)), poses.copy()
        fingers[0, :, 1, 3] = _along(at)
        fingers[0, :, 2, 3] = -low[2] - depth * (np.minimum(1.0, (at + 1) / PRESS) if depth > 0.0 else 1.0)
        if flying:
            objects[1:, :, 1, 3] += 20e-3 * np.sin(6.0 * np.pi * at / RATE)
        sampler.add(Chunk(at / 10 + 1, at / RATE, fingers, objects, np.zeros((0, CHUNK, 4, 4))))

    return step


def _ball(divisions: int) -> Any:
    """Return a ball of 20 n^2 faces, its top the origin."""
    from core.scene.tactile_scene import Mesh

    vertices, triangles = even_sphere(divisions, RADIUS)
    return Mesh(vertices - [0.0, 0.0, RADIUS], triangles.astype(np.int32))


def _plate() -> Any:
    from core.scene.tactile_scene import Mesh

    vertices, triangles = _box(1, 0.05)
    return Mesh(vertices - [0.0, 0.0, 0.05], triangles)


def _box(cells: int, half: float) -> tuple[Any, Any]:
    """Return vertices [m] and triangles of a cube about the origin, each face divided into cells."""
    line = np.linspace(-half, half, cells + 1)
    u, w = (grid.ravel() for grid in np.meshgrid(line, line, indexing="ij"))
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    a, b, c, d = corner, corner + cells + 1, corner + cells + 2, corner + 1
    flat = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    vertices, triangles = [], []
    for axis in range(3):
        for side in (-half, half):
            points = np.empty((u.size, 3))
            points[:, axis], points[:, (axis + 1) % 3], points[:, (axis + 2) % 3] = side, u, w
            triangles.append((flat if side > 0 else flat[:, ::-1]) + u.size * len(vertices))
            vertices.append(points)
    return np.concatenate(vertices), np.concatenate(triangles).astype(np.int32)


@functools.cache
def _skin() -> Any:
    from core.skin.model import fingertip_skin

    return fingertip_skin(level="standard")

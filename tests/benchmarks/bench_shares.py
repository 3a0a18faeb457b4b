"""Baking on all cores: finger-frames a second of six thimbles, from poses to angles, in one process and in two."""

from __future__ import annotations

import functools
import json
import os
import tempfile
import time
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from tests.benchmarks import Result, benchmark

FINGERS, COUNT, RATE = 6, 481, 240.0
RUNS = 3
LEVELS = {"draft": 2400.0, "standard": 2000.0}  # finger-frames a second: ten and eight fingers in real time


@dataclass(frozen=True)
class Baked:
    """One bake.

    Attributes:
        seconds: on the clock. processor: of all processes [s]. bytes: of all tracks. contact: share of samples.
    """

    seconds: float
    processor: float
    bytes: bytes
    contact: float


@functools.cache
def scene(level: str) -> Any:
    """Return six fingers, each with a thimble, on balls of 15 mm that roll under them and press 0.4 to 1.4 mm deep."""
    from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, TactileScene
    from core.surface.gap import Surface

    times = np.arange(COUNT) / RATE
    ball = Surface.sphere(15e-3, facets=1200).mesh
    hands = np.tile(np.eye(4), (FINGERS, COUNT, 1, 1))
    hands[:, :, 0, 3] = 40e-3 * np.arange(FINGERS)[:, None]
    balls = np.tile(np.eye(4), (FINGERS, COUNT, 1, 1))
    phase = 2 * np.pi * times[None] / 2 + np.arange(FINGERS)[:, None]
    balls[:, :, 0, 3] = hands[:, :, 0, 3] + 2e-3 * np.sin(2 * phase)
    balls[:, :, 2, 3] = 0.9e-3 - 0.5e-3 * np.cos(phase) - float(ball.vertices[:, 2].max())
    fingers = tuple(Finger(f"finger {i}", (DeviceUse("thimble_3rrs"),), {"skin_level": level}) for i in range(FINGERS))
    bodies = tuple(Body(f"ball {i}", ball, {"friction": 0.6}) for i in range(FINGERS))
    cuts = [slice(i, i + 60) for i in range(0, COUNT, 60)]
    chunks = [Chunk(times[c] * RATE, times[c], hands[:, c], balls[:, c], hands[:0, c]) for c in cuts]
    return TactileScene("six", Fraction(int(RATE)), (0, COUNT - 1), RATE, fingers, bodies, (), chunks)


@functools.cache
def library() -> Any:
    """Return the presets, with a thimble that takes a command a sample."""
    from core.presets import Library

    folder = Path(tempfile.mkdtemp(prefix="dermis-bench-presets-"))
    preset = {**Library().load("devices", "thimble_3rrs"), "rate": RATE}
    (folder / "devices").mkdir()
    (folder / "devices" / "thimble_3rrs.json").write_text(json.dumps(preset))
    return Library(folder)


@functools.cache
def cache() -> Any:
    """Return where tables are kept that a first bake makes."""
    from core.cache import Cache

    return Cache(Path(tempfile.mkdtemp(prefix="dermis-bench-bake-")), 10**9)


def bake(level: str, workers: int) -> Baked:
    """Bake the scene from the poses on."""
    from core.pipeline.render import render
    from core.steps import drain
    from core.work.processes import ProcessExecutor

    start, before = time.perf_counter(), os.times()
    with ProcessExecutor(workers) as executor:
        made = drain(render(scene(level), library(), cache=cache(), executor=executor))
        taken = time.perf_counter() - start
    after = os.times()  # the processes have ended, so theirs counts
    processor = sum(after[k] - before[k] for k in range(4))
    values = b"".join(output.track.values.tobytes() for output in made.outputs)
    return Baked(taken, processor, values, float(np.mean([o.signals["contact"].mean() for o in made.outputs])))


@functools.cache
def bakes(level: str) -> dict[int, list[Baked]]:
    """Return some bakes by one process and by two, after one that made the tables."""
    made: dict[int, list[Baked]] = {1: [], 2: []}
    folder = tempfile.mkdtemp(prefix="dermis-bench-compiled-")  # as a person's Python keeps them
    with patch.dict(os.environ, {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": folder}):
        bake(level, 1)
        for _ in range(RUNS):
            for workers, found in made.items():
                found.append(bake(level, workers))
    assert len({b.bytes for found in made.values() for b in found}) == 1, "the same bytes"
    assert made[1][0].contact > 0.9
    return made


def rate(found: list[Baked]) -> float:
    """Return finger-frames a second."""
    return FINGERS * COUNT / float(np.median([b.seconds for b in found]))


@benchmark("bake_ffps", quick=True)
def draft() -> Result:
    """Finger-frames a second of a bake of six thimbles on draft skins, two processes; byte-equal to one process."""
    return _rate("bake_ffps", "draft")


@benchmark("bake_standard_ffps")
def standard() -> Result:
    """The same on standard skins."""
    return _rate("bake_standard_ffps", "standard")


def _rate(name: str, level: str) -> Result:
    found, least = bakes(level), LEVELS[level]
    two, one = rate(found[2]), rate(found[1])
    wrong = None if two >= least else f"below {least:g} finger-frames a second"
    return Result(name, two, "1/s", None, {"one process": one}, wrong)


@benchmark("bake_cpu_overhead", limit=1.10)
def overhead() -> Result:
    """Processor seconds of a bake by two processes over one: six thimbles, draft and standard, the worse."""
    worst = max(
        float(np.median([b.processor for b in bakes(level)[2]]) / np.median([b.processor for b in bakes(level)[1]]))
        for level in LEVELS
    )
    return Result("bake_cpu_overhead", worst, "", None, {})

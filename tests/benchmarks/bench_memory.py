"""What a skin takes of a computer's memory while it is previewed.

Measured is a process of its own: what Blender holds for the scene, and scipy for itself, is there before the first
frame is played. Counted are whole pages of the system, not what Python asked for: tables that are merely reserved cost
what the system gives for them.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from . import Result, benchmark

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = "import os, sys; from tests.benchmarks import bench_memory; print('ANSWER', *bench_memory.grown(), flush=True)"
LAST = "; sys.stderr.flush(); os._exit(0)"  # the ordinary end of an interpreter with Blender may hang


@benchmark("skin_memory_mb", limit=100.0)
def skin_memory() -> Result:
    """One standard skin in contact on points that slides over a ball, an edge and ribs, with what is drawn of it."""
    with tempfile.TemporaryDirectory(prefix="dermis-bench-memory-") as folder:
        (first, _), (most, before) = (_process(folder) for _ in range(2))
    return Result("skin_memory_mb", most, "MB", None, {"before the ribs": before, "the first time, tables made": first})


def _process(folder: str) -> tuple[float, float]:
    """Return what `grown` gives in a process of its own, whose cache is among the temporary files in a folder."""
    command, variables = [sys.executable, "-c", SCRIPT + LAST], {**os.environ, "TMPDIR": folder}
    done = subprocess.run(command, cwd=ROOT, env=variables, capture_output=True, text=True, timeout=300)
    answers = [line.split()[1:] for line in done.stdout.splitlines() if line.startswith("ANSWER")]
    if not answers:
        raise RuntimeError((done.stderr.strip().splitlines() or ["no answer"])[-1])
    most, before = (float(number) for number in answers[0])
    return most, before


def grown() -> tuple[float, float]:
    """Return how much a process takes more for a skin, at its most, and before it comes to the ribs [MB]."""
    import bpy
    import scipy.linalg.lapack
    import scipy.spatial

    import blender_addon

    assert scipy.linalg.lapack and scipy.spatial  # what is loaded once, whatever the number of skins
    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender_addon.register()
    from blender_addon import choices
    from blender_addon.demos import demo_skin
    from blender_addon.viewport import shown

    choices.refresh()
    scene = demo_skin.build(1)
    finger = next(obj.dermis.finger for obj in scene.objects if obj.dermis.role == "FINGER")
    assert (finger.skin.level, finger.skin.contact) == ("standard", "points"), (finger.skin.level, finger.skin.contact)
    bpy.context.window.scene = scene
    frames = range(scene.frame_start, scene.frame_end + 1)
    for frame in frames:
        scene.frame_set(frame)
    before, held = _resident(), []
    for frame in frames:
        scene.frame_set(frame)
        shown.on_frame(scene)
        held.append(_resident() - before)
    return max(held), max(held[: 2 * len(held) // 3])  # each of the three things takes a third of the time


def _resident() -> float:
    """Return what this process has of the memory [MB]; Linux alone says so without help."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6

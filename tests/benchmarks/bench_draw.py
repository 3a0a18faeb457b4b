"""What drawing costs, and how soon something is seen: Python's part, with a card and a layout that take everything.

Drawing is timed without a window: what the graphics card and Blender's own interface do comes on top. The first preview
is timed in a process of its own, which opens a file with a demo after the add-on was enabled; skins and tables are on
disk from the process before.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from . import Result, benchmark, timing

TIMES = 60
ROOT = Path(__file__).resolve().parents[2]
DEMOS = ("demo", "thimble", "pins", "five")
FIRST = """
import os, sys, time
import bpy
import blender_addon
from tests.benchmarks.bench_play import _built
path, which = sys.argv[1:]
blender_addon.register()
if which:
    from blender_addon.viewport import shown
    bpy.context.window.scene = scene = _built(which)
    scene.frame_set(40)
    shown.on_frame(scene)
    bpy.ops.wm.save_as_mainfile(filepath=path)
    print("SAVED", flush=True)
else:
    bpy.ops.wm.open_mainfile(filepath=path)
    wall, started = time.perf_counter(), time.process_time()
    from blender_addon.viewport import shown
    shown.work()
    now = shown.now(bpy.context.scene)
    assert now is not None and now.devices is not None and now.devices.rows, now
    print("TOOK", 1e3 * (time.process_time() - started), 1e3 * (time.perf_counter() - wall), flush=True)
os._exit(0)
"""


@benchmark("overlay_draw_ms", limit=4.0, quick=True)
def overlay_draw() -> Result:
    """Every view of five fingers in contact, with skins, thimbles and their cards."""
    return _drawn("overlay_draw_ms", "five", lambda callbacks, _layout: [callback() for callback in callbacks])


@benchmark("panel_draw_ms", limit=1.0, quick=True)
def panel_draw() -> Result:
    """Every panel of the tab that is shown for an active finger; the peer is after an edit that nobody has seen yet."""
    from tests.blender import stand_in

    def edited() -> None:
        import bpy

        from blender_addon import changes

        changes.mark_dirty(bpy.context.view_layer.objects.active.name)

    def draw(_callbacks: Any, layout: Any) -> None:
        stand_in.draw_panels(layout)

    after = _drawn("panel_draw_ms", "five", draw, before=edited)
    found = _drawn("panel_draw_ms", "five", draw)
    return Result("panel_draw_ms", found.value, "ms", found.p95, {"after an edit": after.value or 0.0})


@benchmark("preview_first_ms", limit=300.0)
def preview_first() -> Result:
    """The first preview of the demo after a file was opened; the others are peers, and so is the wall's time."""
    found = {which: _first(which) for which in DEMOS}
    peers = {which: took for which, (took, _) in found.items() if which != "demo"}
    return Result("preview_first_ms", found["demo"][0], "ms", None, {**peers, "demo, wall": found["demo"][1]})


def _drawn(name: str, which: str, draw: Callable[[Any, Any], Any], before: Callable[[], None] = lambda: None) -> Result:
    with _shown(which) as (callbacks, layout):
        times = []
        for _ in range(TIMES):
            before()
            started = time.process_time()
            draw(callbacks, layout)
            times.append(1e3 * (time.process_time() - started))
    return Result(name, timing(times[5:]).median, "ms", timing(times[5:]).p95)


@contextmanager
def _shown(which: str) -> Iterator[tuple[Any, Any]]:
    """Build a demo at a frame in which it touches; give its draw callbacks and a layout."""
    import bpy
    import pytest

    from tests.blender import stand_in

    from .bench_play import FIVE, _blender, _built

    with _blender() as handler, pytest.MonkeyPatch.context() as patch:
        scene = _built(which)
        bpy.context.window.scene = scene
        fingers = [obj for obj in scene.objects if obj.dermis.role == "FINGER"]
        bpy.context.view_layer.objects.active = fingers[0]
        for frame in (FIVE.frames.start, FIVE.frames.start + 1):
            scene.frame_set(frame)
            handler(scene)
        _, modules = stand_in.graphics_card()
        for module, content in modules.items():
            patch.setitem(sys.modules, module, content)
        callbacks = stand_in.draw_callbacks()
        window = bpy.context.window_manager.windows[0]
        area = next(a for a in window.screen.areas if a.type == "VIEW_3D")
        region = next(r for r in area.regions if r.type == "WINDOW")
        with bpy.context.temp_override(window=window, area=area, region=region):
            yield callbacks, stand_in.Anything()


def _first(which: str) -> tuple[float, float]:
    """Return the time of the first preview of a demo, the processor's and the wall's [ms]: median of three starts."""
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "demo.blend")
        _run(path, which)
        found = sorted(tuple(json.loads(f"[{_run(path, '')}]")) for _ in range(3))
    return float(found[1][0]), float(found[1][1])


def _run(path: str, which: str) -> str:
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run(
        [sys.executable, "-c", FIRST, path, which], cwd=ROOT, env=env, capture_output=True, text=True, timeout=600
    )
    told = [line for line in done.stdout.splitlines() if line.startswith(("SAVED", "TOOK"))]
    if not told:
        raise RuntimeError(done.stderr[-2000:])
    return ", ".join(told[-1].split()[1:])

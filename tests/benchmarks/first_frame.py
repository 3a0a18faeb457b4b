"""Demos of `bench_first_frame` in their own process: `python -m tests.benchmarks.first_frame FOLDER PROFILE DEMO`.

The profile 'made' builds demos and saves them. Any other opens their files one after the other as a window would, goes
to frames of the first touch, and prints the longest call of each as JSON.
"""

from __future__ import annotations

import gc
import json
import os
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

FRAMES, QUIET = (20, 21, 22, 30), 0.3  # frames that are looked at; [s] without a timer after which all is done
MOST = 240.0  # [s] that a frame may take until it is shown


class Clock:
    """Keeps what calls took: by the clock on the wall and of the thread's processor time [ms]."""

    def __init__(self) -> None:
        self.all: list[tuple[float, float, str]] = []
        self.running: list[str] = []

    def timed(self, what: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Return a call that is timed."""

        def called(*given: Any, **named: Any) -> Any:
            self.running.append(what)
            wall, cpu = time.perf_counter(), time.thread_time()
            try:
                return call(*given, **named)
            finally:
                self.running.pop()
                self.all.append((1e3 * (time.perf_counter() - wall), 1e3 * (time.thread_time() - cpu), what))

        return called


class Reads:
    """Keeps the modules that the window's thread reads within timed calls: each is a file that a window waits for.

    It is the first of Python's finders, and finds nothing itself.
    """

    def __init__(self, clock: Clock) -> None:
        self.all: list[str] = []
        self._clock = clock

    def find_spec(self, name: str, _path: Any = None, _target: Any = None) -> None:
        """See `importlib.abc.MetaPathFinder`."""
        if self._clock.running and threading.get_ident() == threading.main_thread().ident:
            self.all.append(f"{name} in {self._clock.running[-1]}")


class Timers:
    """Stands for Blender's timers, which fire in a window alone."""

    def __init__(self, clock: Clock) -> None:
        self.due: dict[Any, float] = {}
        self.clock = clock

    def register(self, function: Any, *, first_interval: float = 0.0, persistent: bool = False) -> None:
        """See `bpy.app.timers`."""
        self.due[function] = time.perf_counter() + first_interval

    def is_registered(self, function: Any) -> bool:
        """See `bpy.app.timers`."""
        return function in self.due

    def unregister(self, function: Any) -> None:
        """See `bpy.app.timers`."""
        del self.due[function]

    def fire(self) -> bool:
        """Call the timers that are due; return whether there was one."""
        now = time.perf_counter()
        ready = [function for function, at in self.due.items() if at <= now]
        for function in ready:
            if function not in self.due:
                continue
            name = f"{function.__module__}.{function.__qualname__}"
            again = self.clock.timed(name, function)()
            if again is None:
                self.due.pop(function, None)
            elif function in self.due:
                self.due[function] = time.perf_counter() + again
        return bool(ready)


def build(folder: Path, demos: list[str]) -> None:
    """Build demos in this window, and save a file of each; the peer is enabled, so that its bytecode is written."""
    import blender_addon

    from .bench_first_frame import DEMOS

    peer()
    for demo in demos:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        blender_addon.register()
        operator, given = DEMOS[demo]
        getattr(bpy.ops.dermis, operator)(**given)
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / f"{demo}.blend"))
        blender_addon.unregister()


def peer() -> float:
    """Return how long this process takes to enable Blender's own node_wrangler: processor time [ms]."""
    import addon_utils  # there once bpy is

    began = time.thread_time()
    if addon_utils.enable("node_wrangler") is None:
        raise RuntimeError("Blender's node_wrangler could not be enabled, which the longest call is compared with")
    return 1e3 * (time.thread_time() - began)


def measure(paths: list[str]) -> list[dict[str, Any]]:
    """Open demos as a window does, and return the longest call of each and the peer's time."""
    import pytest

    import blender_addon

    peers, clock = peer(), Clock()
    timers = Timers(clock)
    patch = pytest.MonkeyPatch()
    for name in ("register", "unregister", "is_registered"):
        patch.setattr(bpy.app.timers, name, getattr(timers, name))
    from blender_addon import handlers, redraw

    patch.setattr(redraw, "watched", lambda: True)
    lists = [(on, function) for on, function in handlers.table()]
    patch.setattr(handlers, "table", lambda: tuple((on, _persistent(clock.timed(f.__name__, f))) for on, f in lists))
    blender_addon.register()
    from tests.blender import stand_in

    graphics, modules = stand_in.graphics_card()
    for module, content in modules.items():
        patch.setitem(sys.modules, module, content)
    callbacks = stand_in.draw_callbacks()
    layout = stand_in.Anything()
    drawn = [clock.timed(c.__qualname__, c) for c in callbacks]
    panels = clock.timed("panels", lambda: stand_in.draw_panels(layout))

    def draw() -> None:
        window = bpy.context.window_manager.windows[0]
        area = next(a for a in window.screen.areas if a.type == "VIEW_3D")
        region = next(r for r in area.regions if r.type == "WINDOW")
        with bpy.context.temp_override(window=window, area=area, region=region):
            for callback in drawn:
                graphics.boxes.clear()  # the stand-in compares texts with all of them
                callback()
            panels()

    def settle() -> None:
        started = last = time.perf_counter()
        while time.perf_counter() - last < QUIET and time.perf_counter() - started < MOST:
            if timers.fire():
                draw()
                last = time.perf_counter()
            time.sleep(1e-3)  # others may have the interpreter

    reads = Reads(clock)
    patch.setattr(sys, "meta_path", [reads, *sys.meta_path])
    found = []
    for path in paths:
        clock.all.clear()
        reads.all.clear()
        bpy.ops.wm.open_mainfile(filepath=path)
        draw()
        settle()
        scene = bpy.context.scene
        for frame in FRAMES:
            scene.frame_set(frame)
            draw()
            settle()
        clock.timed("full collection of garbage", gc.collect)()  # it comes by chance, in any of the calls
        from blender_addon.viewport import shown  # no sooner: it is among what is read

        found.append({"peer": peers, "reads": list(reads.all), **_shown(shown.now(scene)), **_longest(clock)})
    return found


def _shown(now: Any) -> dict[str, Any]:
    """Return whether anything is shown of a scene, and what is noted of its skins."""
    notes = [] if now is None else [s.note for s in now.skins.states]
    rows = [] if now is None or now.devices is None else [r.finger for r in now.devices.rows]
    skins = [] if now is None else [s for s in now.skins.states if s.model is not None]
    return {"shown": bool(rows or skins), "notes": notes}


def _longest(clock: Clock) -> dict[str, Any]:
    """Return the longest calls, by the clock on the wall and by the processor's time."""
    took, used, what = max(clock.all)
    _, cpu, busiest = max(clock.all, key=lambda call: call[1])
    return {
        "wall": took,
        "wall_cpu": used,
        "what": what,
        "cpu": cpu,
        "busiest": busiest,
        "longest": sorted(clock.all, reverse=True)[:12],
    }


def _persistent(call: Any) -> Any:
    from bpy.app.handlers import persistent

    return persistent(call)


if __name__ == "__main__":
    folder, profile, *which = sys.argv[1:]
    if profile == "made":
        build(Path(folder), which)
        print("TOOK []", flush=True)
    else:
        print("TOOK", json.dumps(measure([str(Path(folder) / f"{demo}.blend") for demo in which])), flush=True)
    os._exit(0)

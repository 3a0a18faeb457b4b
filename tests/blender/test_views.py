"""What draws is read by a thread: no callback, panel, frame or timer of a window reads it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
AS_IN_A_WINDOW = """
import importlib.abc, os, sys, threading, time
import bpy, pytest
import blender_addon
from blender_addon import handlers, redraw, views
from tests.benchmarks.first_frame import Clock, Timers
from tests.blender import stand_in

patch, timers = pytest.MonkeyPatch(), Timers(Clock())
for name in ("register", "unregister", "is_registered"):
    patch.setattr(bpy.app.timers, name, getattr(timers, name))
patch.setattr(redraw, "watched", lambda: True)
for module, content in stand_in.graphics_card()[1].items():
    patch.setitem(sys.modules, module, content)
blender_addon.register()
by_us = []


class Seen(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name.startswith("blender_addon.") and threading.current_thread() is threading.main_thread():
            by_us.append(name.partition(".")[2])


def tell(what):
    print(what, *by_us, flush=True)
    by_us.clear()


def used():
    if there:
        stand_in.draw(stand_in.draw_callbacks(), stand_in.Anything())
    else:
        for callback in stand_in.draw_callbacks():
            callback()
    on_frame = next(f for _, f in handlers.table() if f.__name__ == "_on_frame")
    on_frame(bpy.context.scene, bpy.context.evaluated_depsgraph_get())
    timers.fire()


sys.meta_path.insert(0, Seen())
there = False
if sys.argv[1] == "start":
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    tell("OPENED")
used()
tell("DRAWN")
end = time.monotonic() + 60
while not views.there() and time.monotonic() < end:
    time.sleep(0.005)
    timers.fire()
there = True
used()
tell("LATER")
names = ("viewport.cards", "viewport.shown", "results.store")
print("READ", *(name for name in names if "blender_addon." + name in sys.modules), flush=True)
os._exit(0)
"""
OF_EVERY_FILE = {"changes", "scene_time", "action_content", "identity", "loading"}


def in_a_window(when: str) -> dict[str, set[str]]:
    """Return what the window's own thread has read, and when, in a Blender of its own."""
    done = subprocess.run(
        [sys.executable, "-c", AS_IN_A_WINDOW, when], cwd=ROOT, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return {line.split()[0]: set(line.split()[1:]) for line in done.stdout.splitlines() if line[:4].isupper()}


def test_what_draws_is_read_before_the_first_draw_by_a_thread() -> None:
    read = in_a_window("start")
    assert read["OPENED"] <= OF_EVERY_FILE
    assert read["DRAWN"] <= OF_EVERY_FILE and not read["LATER"]
    assert read["READ"] == {"viewport.cards", "viewport.shown", "results.store"}


def test_where_the_addon_is_enabled_by_hand_the_first_draw_asks_for_it() -> None:
    read = in_a_window("by hand")
    assert read["DRAWN"] <= OF_EVERY_FILE and not read["LATER"]
    assert read["READ"] == {"viewport.cards", "viewport.shown", "results.store"}

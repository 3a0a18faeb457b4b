"""The longest that a window waits for us at the first frames of every demo, with an empty cache and in a fresh process.

Timed is each single call of a handler, a timer or a draw callback, by the clock on the wall and imports included, from
the opening of the file until nothing is left to do. Blender as a module fires no timers and draws nothing: timers are
called from here when they are due, and callbacks draw on a stand-in. Blender's own evaluation is outside the clock.
A full collection of garbage, which may come due in any call, is timed as one of its own.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from . import Result, benchmark

NAME = "first_frame_block_ms"
ROOT = Path(__file__).resolve().parents[2]
MOTORS = ("flat", "back", "tip", "left", "right", "complex")
TOUCHES = ("BALL", "EDGE", "BACK", "FRONT", "PRESS", "SLIDE", "PLATE", "BLOCK", "CUP", "FOAM")
DEMOS = {
    "scene": ("demo_scene", {}),
    **{f"skin {which}": ("demo_skin_scene", {"fingers": which}) for which in ("ONE", "FIVE", "TISSUES")},
    "pins": ("demo_pins_scene", {}),
    **{f"thimble {which}": ("demo_thimble_scene", {"touch": which}) for which in TOUCHES},
    **{f"motors {which}": ("demo_motors_scene", {"touch": which}) for which in MOTORS},
    "hexapod": ("demo_motors_scene", {"touch": "flat", "device": "hexapod"}),
}


@benchmark(NAME, limit=50.0)
def first_frame_block() -> Result:
    """The worst demo; the others are peers, each with the piece of work that took longest."""
    longest, told = {}, {}
    for demo in DEMOS:
        found = _measured(demo)
        longest[demo], told[demo] = found["wall"], found
        own, busiest = found["wall_cpu"], f"at most {found['cpu']:.0f} in {found['busiest']}"
        print(f"{demo}: {found['wall']:.0f} ms in {found['what']}; processor {own:.0f} ms, {busiest}", flush=True)
    worst = max(longest, key=lambda demo: longest[demo])
    unfinished = [demo for demo in DEMOS if not told[demo]["shown"]]
    error = f"nothing was shown in the end: {', '.join(unfinished)}" if unfinished else None
    return Result(NAME, longest[worst], "ms", None, longest, error)


def _measured(demo: str) -> dict[str, Any]:
    """Return what a demo's longest piece of work was, in a process and a profile of its own."""
    with tempfile.TemporaryDirectory() as folder:
        run(Path(folder), "made", demo)
        (found,) = run(Path(folder), "cold", demo)
        return found


def run(folder: Path, profile: str, *demos: str) -> list[dict[str, Any]]:
    """Build demos in a process of its own, or open them there, and return what each took.

    Args:
        folder: where the files are, and profiles of Blender.
        profile: its name; 'made' builds the demos, any other opens them one after the other.
    """
    own = folder / profile  # a checkout keeps what Blender's profile has otherwise among temporary files
    own.mkdir(exist_ok=True)
    env = {
        **os.environ,
        "BLENDER_USER_RESOURCES": str(own),
        "TMPDIR": str(own),
        "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
    }
    line = [sys.executable, "-m", "tests.benchmarks.first_frame", str(folder), profile, *demos]
    done = subprocess.run(line, cwd=ROOT, env=env, capture_output=True, text=True, timeout=600)
    told = [row for row in done.stdout.splitlines() if row.startswith("TOOK")]
    if not told:
        raise RuntimeError(done.stderr[-2000:])
    found: list[dict[str, Any]] = json.loads(told[-1].partition(" ")[2])
    return found

"""The stored bakes of a file's scenes come back after it was opened: tracks in a timer, skins when first needed.

Nothing is written and no port is opened because a file was opened; without a window nothing is read either.
"""

from __future__ import annotations

import bpy

from .. import redraw, reporting
from .._core import DermisError
from . import store

DELAY = 0.05  # [s] after the file: it is seen first


def request() -> None:
    """Ask for the stored bakes of all scenes."""
    if redraw.watched() and not bpy.app.timers.is_registered(_on_timer):
        bpy.app.timers.register(_on_timer, first_interval=DELAY)


def cancel() -> None:
    """Forget requests."""
    if bpy.app.timers.is_registered(_on_timer):
        bpy.app.timers.unregister(_on_timer)


def work() -> int:
    """Read the stored bake of every scene that has one and no other; return how many came back.

    One that is gone or cannot be read is left where it is: the panel offers to try, and says why not.
    """
    found = 0
    for scene in bpy.data.scenes:
        if scene.dermis.bake_key and store.state(scene) == "none":
            try:
                result = store.load(scene) if store.has_owner(scene) else None
            except DermisError as error:
                reporting.show((error.as_finding(),), f"Stored bake of {scene.name}")
                continue
            if result is not None:
                found += 1
                now = store.current(scene)
                if scene == bpy.context.scene and now is not None:
                    reporting.show(now.bake.all_findings, f"Stored bake of {scene.name}")
    return found


def _on_timer() -> None:
    if work():
        redraw.request()

"""Read the stored bakes of a file's scenes after it was opened.

A timer reads the tracks; skins are read when they are first needed. Opening a file writes nothing and opens no port.
Without a window, nothing is read either.
"""

from __future__ import annotations

import bpy

from .. import redraw, reporting
from .._core import DermisError
from . import store

DELAY = 0.05  # [s] delay of the timer, in which the opened file is drawn


def request() -> None:
    """Request the stored bakes of all scenes."""
    if redraw.watched() and not bpy.app.timers.is_registered(_on_timer):
        bpy.app.timers.register(_on_timer, first_interval=DELAY)


def cancel() -> None:
    """Cancel the request."""
    if bpy.app.timers.is_registered(_on_timer):
        bpy.app.timers.unregister(_on_timer)


def work() -> int:
    """Read the stored bakes of scenes without a result; return their number.

    A bake that is gone is skipped. One that cannot be read is reported, and stays stored.
    """
    found = 0
    for scene in bpy.data.scenes:
        if scene.dermis.bake_key and store.state(scene) == "none":
            try:
                result = store.load(scene) if store.has_owner(scene) else None
            except DermisError as error:
                reporting.show((error.as_finding(),), f"Stored bake of {scene.name}", scene)
                continue
            if result is not None:
                found += 1
                now = store.current(scene)
                if scene == bpy.context.scene and now is not None:
                    reporting.show(now.bake.all_findings, f"Stored bake of {scene.name}", scene)
    return found


def _on_timer() -> None:
    if work():
        redraw.request()

"""Drawing the views again, once their contents have been computed.

Whoever changes the display asks with `request`, wherever it lies; the work itself is hooked in by `viewport/shown`,
so that nothing down here knows the contents. Draw callbacks read what the work has left behind, and work nothing out.
"""

from __future__ import annotations

from collections.abc import Callable

import bpy

DRAWN = ("VIEW_3D", "DOPESHEET_EDITOR", "GRAPH_EDITOR")  # the editors that show something of ours
SETTLE = 0.05  # [s] from the first request to the work; those that come meanwhile are the same one


def watched() -> bool:
    """Return whether somebody looks at a window; in background nobody waits for a view."""
    return not bpy.app.background


work: Callable[[], None] | None = None
"""Computes the contents of the views."""


def request() -> None:
    """Ask for the display to be computed anew and drawn soon; many requests give one."""
    if watched() and not bpy.app.timers.is_registered(_on_timer):
        bpy.app.timers.register(_on_timer, first_interval=SETTLE)


def cancel() -> None:
    """Forget requests."""
    if bpy.app.timers.is_registered(_on_timer):
        bpy.app.timers.unregister(_on_timer)


def views() -> None:
    """Let every editor that shows something of ours draw again."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in DRAWN:
                area.tag_redraw()


def _on_timer() -> None:
    try:
        if work is not None:
            work()
    finally:
        views()

"""Redraws of the views, once their contents have been computed.

Code that changes the display calls `request`. `views` sets the work that computes the contents, so that this module
does not depend on them. Draw callbacks read the results of the work, and compute nothing.
"""

from __future__ import annotations

from collections.abc import Callable

import bpy

DRAWN = ("VIEW_3D", "DOPESHEET_EDITOR", "GRAPH_EDITOR")  # the editors in which the add-on draws
SETTLE = 0.05  # [s] from the first request to the work; further requests in this time add nothing


def watched() -> bool:
    """Return whether there may be a window; in background nobody waits for a view."""
    return not bpy.app.background


work: Callable[[], None] | None = None
"""Computes the contents of the views."""


def request() -> None:
    """Request that the display is soon computed and drawn again.

    Several requests within `SETTLE` seconds give one redraw.
    """
    if watched() and not bpy.app.timers.is_registered(_on_timer):
        bpy.app.timers.register(_on_timer, first_interval=SETTLE)


def cancel() -> None:
    """Forget requests."""
    if bpy.app.timers.is_registered(_on_timer):
        bpy.app.timers.unregister(_on_timer)


def views() -> None:
    """Let every editor in which the add-on draws draw again."""
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

"""Detection of work that steps through the frames.

During such work nobody has chosen the scene's frame, so a device on a finger holds still. Baking, exporting and
sampling step through the frames under `changes.muted`. Rendering and Blender's own bakes do so in jobs and modal
operators of their own.
"""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.handlers import persistent

from .. import changes

# Blender's modal operators that step through the frames; Python can query only few of their jobs. They end with the
# first event after their work. Until then the last frame holds, to which they have returned.
STEPPING = frozenset(
    {
        "RENDER_OT_opengl",
        "PTCACHE_OT_bake",
        "PTCACHE_OT_bake_all",
        "FLUID_OT_bake_all",
        "FLUID_OT_bake_data",
        "FLUID_OT_bake_noise",
        "FLUID_OT_bake_mesh",
        "FLUID_OT_bake_particles",
        "FLUID_OT_bake_guides",
        "OBJECT_OT_simulation_nodes_cache_bake",
        "OBJECT_OT_simulation_nodes_cache_calculate_to_frame",
        "OBJECT_OT_geometry_node_bake_single",
        "DPAINT_OT_bake",
    }
)

_rendering = False


def held() -> bool:
    """Return whether something steps through the frames."""
    return changes.sweeping() or _rendering or bpy.app.is_job_running("RENDER") or _stepping()


def _stepping() -> bool:
    manager = bpy.context.window_manager
    windows = manager.windows if manager is not None else ()
    return any(operator.bl_idname in STEPPING for window in windows for operator in window.modal_operators)


@persistent
def _on_render_start(*_: Any) -> None:
    global _rendering
    _rendering = True


@persistent
def _on_render_end(*_: Any) -> None:
    global _rendering
    _rendering = False


def callbacks() -> tuple[tuple[list[Any], Any], ...]:
    """Return Blender's lists of handlers, and the handler that watches for renders in each."""
    on = bpy.app.handlers
    return (
        (on.render_init, _on_render_start),
        (on.render_complete, _on_render_end),
        (on.render_cancel, _on_render_end),
        (on.load_pre, _on_render_end),
    )


def forget() -> None:
    """Forget a running render, because its end is not watched any more."""
    _on_render_end()

"""Blender's application handlers, in one table, and the verb of its command line.

Handlers record changes, and let the preview follow.

Nothing imports this module but the package itself.
"""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.handlers import persistent

from . import baking, changes, commands, identity, on_demand, redraw, reporting, views
from .properties import scene_properties, skin_properties
from .results import exported, recall, store, trusted
from .streaming import streamed_track
from .viewport import shown

COMMAND = "dermis"  # blender --command dermis

_command: Any = None


@persistent
def _on_depsgraph(_scene: bpy.types.Scene, depsgraph: Any = None) -> None:
    before = changes.lineage()
    changed = changes.note_updates(depsgraph)
    if changes.lineage() != before:
        for scene in bpy.data.scenes:
            streamed_track.relabel(scene)
    if changed or changes.lineage() != before:
        redraw.request()


@persistent
def _on_frame(scene: bpy.types.Scene, depsgraph: Any = None) -> None:
    # Without a window nobody sees a preview. A sweep or a render job must not wait for one.
    if changes.sweeping() or depsgraph is None or not redraw.watched() or bpy.app.is_job_running("RENDER"):
        return
    changes.note_clock(scene)
    if views.there():
        shown.on_frame(scene)


@persistent
def _on_history(*_: Any) -> None:
    changes.note_history()


@persistent
def _on_load(*_: Any) -> None:
    skin_properties.settle()
    scene_properties.settle()
    changes.note_file()
    for kept in on_demand.read(store, baking, trusted, exported, shown, reporting):
        kept.forget()
    recall.request()
    views.there()  # begins to load the modules that draw: Blender opens a file when it starts, before it draws
    identity.note(store.baked() if any(scene.dermis.bake_owners for scene in bpy.data.scenes) else {})


@persistent
def _on_import(*_: Any) -> None:
    skin_properties.settle()
    scene_properties.settle()


@persistent
def _on_save(*_: Any) -> None:
    identity.settle()
    for scene in bpy.data.scenes:
        if any(obj.dermis.role != "NONE" for obj in scene.objects):
            scene_properties.stamp(scene)


def table() -> tuple[tuple[list[Any], Any], ...]:
    """Return Blender's lists of handlers, each with a handler of the add-on."""
    on = bpy.app.handlers
    return (
        (on.depsgraph_update_post, _on_depsgraph),
        (on.frame_change_post, _on_frame),
        (on.undo_post, _on_history),
        (on.redo_post, _on_history),
        (on.load_post, _on_load),
        (on.blend_import_post, _on_import),
        (on.save_pre, _on_save),
    )


def register() -> None:
    """Add every handler once, and give Blender the command."""
    global _command
    for handlers, function in table():
        if function not in handlers:
            handlers.append(function)
    _command = bpy.utils.register_cli_command(COMMAND, lambda arguments: commands.main(arguments))
    recall.request()  # for the file that is open already


def unregister() -> None:
    """Remove every handler, and take the command back."""
    global _command
    for handlers, function in table():
        if function in handlers:
            handlers.remove(function)
    if _command is not None:
        bpy.utils.unregister_cli_command(_command)
        _command = None
    recall.cancel()
    changes.clear_dirty()

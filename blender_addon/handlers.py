"""Blender's application handlers, in one table: they write the ledger of changes, and let the preview follow.

Nothing imports this module but the package itself.
"""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.handlers import persistent

from . import baking, changes, identity, redraw, reporting
from .devices import skin_models
from .preview import skin_preview
from .properties import scene_properties, skin_properties
from .results import exported, recall, store, trusted
from .streaming import streamed_track
from .viewport import shown


@persistent
def _on_depsgraph(_scene: bpy.types.Scene, depsgraph: Any = None) -> None:
    before = changes.lineage()
    changed = changes.note_updates(depsgraph)
    if changes.lineage() != before:
        for scene in bpy.data.scenes:
            streamed_track.relabel(scene)
    if changed or changes.lineage() != before:
        skin_preview.request()


@persistent
def _on_frame(scene: bpy.types.Scene, depsgraph: Any = None) -> None:
    # Without a window nobody looks; a sweep or a render job must not pay for a preview.
    if changes.sweeping() or depsgraph is None or not redraw.watched() or bpy.app.is_job_running("RENDER"):
        return
    changes.note_clock(scene)
    shown.on_frame(scene)


@persistent
def _on_history(*_: Any) -> None:
    changes.note_history()


@persistent
def _on_load(*_: Any) -> None:
    skin_properties.settle()
    scene_properties.settle()
    changes.note_file()
    store.forget()
    baking.forget()
    trusted.forget()
    exported.forget()
    recall.request()
    shown.forget()
    reporting.clear()
    identity.note(store.baked())


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
    """Return every list that holds a handler of ours, with the handler."""
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
    """Add every handler once."""
    for handlers, function in table():
        if function not in handlers:
            handlers.append(function)
    skin_models.on_made = skin_preview.request
    recall.request()  # of the file that is open already


def unregister() -> None:
    """Remove every handler."""
    for handlers, function in table():
        if function in handlers:
            handlers.remove(function)
    skin_models.on_made = None
    recall.cancel()
    changes.clear_dirty()

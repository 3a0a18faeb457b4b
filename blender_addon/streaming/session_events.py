"""Events outside the panel that end or change a session.

These are opened files, undo, renders, the key for Stop, and the add-on's end.
"""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.handlers import persistent

from .. import on_demand
from . import frame_hold, session

_keys: list[tuple[Any, Any]] = []


@persistent
def _on_load(*_: Any) -> None:
    for streams in on_demand.read(session):
        streams.end()


@persistent
def _on_history(*_: Any) -> None:
    for streams in on_demand.read(session):
        streams.restored()


def _table() -> tuple[tuple[list[Any], Any], ...]:
    on = bpy.app.handlers
    own = (on.load_pre, _on_load), (on.undo_post, _on_history), (on.redo_post, _on_history)
    return (*own, *frame_hold.callbacks())


def register() -> None:
    """Watch for opened files, undo and renders; bind the stop to its key."""
    for handlers, function in _table():
        if function not in handlers:
            handlers.append(function)
    configuration = bpy.context.window_manager.keyconfigs.addon if bpy.context.window_manager else None
    if configuration is not None:
        keymap = configuration.keymaps.new(name="Window", space_type="EMPTY")
        _keys.append((keymap, keymap.keymap_items.new("dermis.stream_stop", "ESC", "PRESS", shift=True)))


def unregister() -> None:
    """End streaming, and stop watching."""
    while _keys:
        keymap, item = _keys.pop()
        keymap.keymap_items.remove(item)
    for streams in on_demand.read(session):
        streams.end()
        streams.end_timer()
    frame_hold.forget()
    for handlers, function in _table():
        if function in handlers:
            handlers.remove(function)

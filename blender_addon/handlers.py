"""Blender's application handlers: one table, and the record of what changed since the last bake.

Everything here runs on every change and every frame, so it only notes things down. What was noted is read by
`results.store` (is the bake out of date?) and `device_preview` (may the trail go on?).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy
from bpy.app.handlers import persistent

# Changes of these types reach the sampled scene; others, such as screens and brushes, do not.
_RELEVANT = (
    "Object",
    "Action",
    "Armature",
    "Camera",
    "Collection",
    "Curve",
    "Curves",
    "Image",
    "Key",
    "Lattice",
    "Mesh",
    "MetaBall",
    "NodeTree",
    "Scene",
    "Speaker",
    "World",
)

_dirty: set[str] = set()
_expected: set[str] = set()
_muted = 0
_generation = 0
_ticks = 0
_edits = 0


def dirty() -> frozenset[str]:
    """Return the names of what changed since `clear_dirty`; empty means that a bake made then still holds."""
    return frozenset(_dirty)


def generation() -> int:
    """Return a number that rises with every undo, redo and loaded file: nothing noted before it holds after it."""
    return _generation


def ticks() -> int:
    """Return a number that rises with everything that happens to the scene, for caches of what panels draw."""
    return _ticks


def edits() -> int:
    """Return a number that rises with every change of the scene, but not with the frame."""
    return _edits + _generation


def mark_dirty(name: str = "settings") -> None:
    """Note that something changed."""
    global _edits, _ticks
    _ticks += 1
    if not _muted:
        _edits += 1
        _dirty.add(name)


def expect(name: str) -> None:
    """Note that the next change of the scene of this name is of settings on which no bake depends."""
    _expected.add(name)


def clear_dirty() -> None:
    """Forget changes, because a bake has just seen them."""
    _dirty.clear()


@contextmanager
def muted() -> Iterator[None]:
    """Ignore what happens inside: our own sweep changes frames, not the scene."""
    global _muted
    _muted += 1
    try:
        yield
    finally:
        _muted -= 1


def sweeping() -> bool:
    """Tell whether a sweep of ours is under way: the scene is then at a frame to which nobody has put it."""
    return _muted > 0


@persistent
def _on_depsgraph(_scene: bpy.types.Scene, depsgraph: Any = None) -> None:
    global _edits, _ticks
    _ticks += 1
    if _muted or depsgraph is None:
        return
    changed, expected = False, frozenset(_expected)
    _expected.clear()
    for update in depsgraph.updates:
        if isinstance(update.id, bpy.types.Scene) and update.id.name in expected:
            continue
        # Selecting an object also arrives here, with neither flag set.
        if (update.is_updated_transform or update.is_updated_geometry or isinstance(update.id, bpy.types.Action)) and (
            type(update.id).__name__ in _RELEVANT or isinstance(update.id, bpy.types.Object | bpy.types.Action)
        ):
            _dirty.add(update.id.name)
            _edits += 1
            changed = True
    if changed and not bpy.app.background:
        from .preview import skin_preview

        skin_preview.request()


@persistent
def _on_frame(scene: bpy.types.Scene, depsgraph: Any = None) -> None:
    # Without a window nobody looks; a sweep or a render job must not pay for a preview.
    if _muted or depsgraph is None or bpy.app.background or bpy.app.is_job_running("RENDER"):
        return
    from .preview import device_preview, skin_preview

    device_preview.on_frame(scene)
    skin_preview.on_frame(scene, device_preview.take_sample())


@persistent
def _on_history(*_: Any) -> None:
    global _generation, _ticks
    _generation += 1
    _ticks += 1
    _dirty.add("undo")


@persistent
def _on_load(*_: Any) -> None:
    global _generation, _ticks
    _generation += 1
    _ticks += 1
    _dirty.clear()
    _dirty.add("file")
    from . import reporting
    from .results import store
    from .streaming import finger_ids

    store.forget()
    reporting.clear()
    finger_ids.note()


@persistent
def _on_save(*_: Any) -> None:
    from .properties.scene_properties import stamp
    from .streaming import finger_ids

    finger_ids.settle()
    for scene in bpy.data.scenes:
        if any(obj.dermis.role != "NONE" for obj in scene.objects):
            stamp(scene)


def table() -> tuple[tuple[list[Any], Any], ...]:
    """Return every list that holds a handler of ours, with the handler."""
    on = bpy.app.handlers
    return (
        (on.depsgraph_update_post, _on_depsgraph),
        (on.frame_change_post, _on_frame),
        (on.undo_post, _on_history),
        (on.redo_post, _on_history),
        (on.load_post, _on_load),
        (on.save_pre, _on_save),
    )


def register() -> None:
    """Add every handler once."""
    for handlers, function in table():
        if function not in handlers:
            handlers.append(function)


def unregister() -> None:
    """Remove every handler."""
    for handlers, function in table():
        if function in handlers:
            handlers.remove(function)
    _dirty.clear()

"""Record of changes to scenes: names changed since a bake, and counters.
The counters rise with the changes that they count. Of the add-on, the module imports only `action_content` and
`scene_time`, so that modules that declare properties or sweep the frames can import it. `handlers` passes on the
updates that Blender reports. `results.store` reads whether a bake is out of date, the preview whether its history still
holds, and caches whether their contents still hold.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy

from . import action_content, scene_time

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
_counts: dict[int, int] = {}  # by session uid: number of reported changes of data
_beyond: dict[int, int] = {}  # by session uid: number of changes of files that belong to data
_expected: set[int] = set()  # session uids of data whose next change concerns no bake
_muted = 0
_generation = 0
_ticks = 0
_edits = 0
_forms = 0
_clocks: dict[int, tuple[float, ...]] = {}  # by the scene's session uid
_renames = 0
_names: tuple[tuple[int, str], ...] = ()  # session uids and names of objects with a role, at the last check


def dirty() -> frozenset[str]:
    """Return the names of data that were reported as changed since `clear_dirty`.

    If there are none, a bake made then still holds. If there are some, it may: undo gives data back.
    """
    return frozenset(_dirty)


def generation() -> int:
    """Return a number that rises with every undo, redo and loaded file.

    Nothing that was kept before such a step holds after it.
    """
    return _generation


def lineage() -> int:
    """Return a number that rises with every undo, redo, loaded file and rename.

    Renames count if the object has a role. When the number rises, state that is kept by a name or that follows from an
    earlier frame does not hold any more. A rename alone leaves a bake valid.
    """
    return _generation + _renames


def ticks() -> int:
    """Return a number that rises at every update of the scene.

    Caches of panels use it.
    """
    return _ticks


def edits() -> int:
    """Return a number that rises with every change of the scene.

    A change of the frame alone does not count.
    """
    return _edits + _generation


def forms() -> int:
    """Return a number that rises with every change of the scene but motion.

    It counts changes of shapes, pictures and settings, not of objects' places.
    """
    return _forms + _generation


def mark_dirty(name: str = "settings") -> None:
    """Note that something changed."""
    global _edits, _forms, _ticks
    _ticks += 1
    if not _muted:
        _edits += 1
        _forms += 1
        _dirty.add(name)


def mark_beyond(changed: bpy.types.ID) -> None:
    """Note a change that results depend on, and that no property of the data shows, such as of a file."""
    _beyond[changed.session_uid] = beyond(changed.session_uid) + 1
    mark_dirty(changed.name)


def beyond(uid: int) -> int:
    """Return the number of calls of `mark_beyond` for a data-block, by its session uid."""
    return _beyond.get(uid, 0)


def count(uid: int) -> int:
    """Return how often Blender has reported a change of a data-block, by its session uid.

    Undo of another change may be reported, too.
    """
    return _counts.get(uid, 0)


def expect(changed: bpy.types.ID) -> None:
    """Note that no bake depends on the next change of a scene or an object."""
    _expected.add(changed.session_uid)
    if isinstance(changed, bpy.types.Object) and changed.data is not None:  # Blender reports it with the object
        _expected.add(changed.data.session_uid)


def clear_dirty() -> None:
    """Forget changes, because a bake has just seen them."""
    _dirty.clear()
    _look_at_clocks()
    action_content.look()


def note_updates(depsgraph: bpy.types.Depsgraph | None) -> bool:
    """Note Blender's updates; return whether a bake depends on any of them."""
    global _edits, _forms, _ticks
    _ticks += 1
    if _muted or depsgraph is None:
        return False
    if any(_says_nothing(update) for update in depsgraph.updates):
        _look_at_names()
    changed, expected = False, frozenset(_expected)
    _expected.clear()
    for update in depsgraph.updates:
        if isinstance(update.id, bpy.types.Scene):
            changed |= note_clock(update.id.original)
        if expected and update.id.original.session_uid in expected:
            continue
        # Selecting an object also arrives here, with neither flag set; so do channels of an action.
        if (
            action_content.is_new(update.id.original)
            if isinstance(update.id, bpy.types.Action)
            else (update.is_updated_transform or update.is_updated_geometry)
            and (type(update.id).__name__ in _RELEVANT or isinstance(update.id, bpy.types.Object))
        ):
            uid = update.id.original.session_uid
            _dirty.add(update.id.name)
            _counts[uid] = count(uid) + 1
            _edits += 1
            _forms += update.is_updated_geometry or not isinstance(update.id, bpy.types.Object)
            changed = True
    return changed


def note_clock(scene: bpy.types.Scene) -> bool:
    """Note a scene's frame rate and time stretching; return whether they changed.

    Blender's update of a scene does not name the setting that changed.
    """
    before, now = _clocks.get(scene.session_uid), scene_time.settings(scene)
    _clocks[scene.session_uid] = now
    changed = before not in (None, now) and not _muted
    if changed:
        mark_dirty(scene.name)
    return changed


def _says_nothing(update: Any) -> bool:
    """Return whether an object is reported though nothing was evaluated anew.

    Blender reports an object so when it is selected or renamed.
    """
    return isinstance(update.id, bpy.types.Object) and not (update.is_updated_transform or update.is_updated_geometry)


def _look_at_names() -> None:
    global _names, _renames
    names = tuple((obj.session_uid, obj.name_full) for obj in bpy.data.objects if obj.dermis.role != "NONE")
    if names != _names:
        _names = names
        _renames += 1


def note_history() -> None:
    """Note an undo or a redo."""
    _begin_generation("undo")


def note_file() -> None:
    """Note that another file was opened, and forget the changes of the last one."""
    _dirty.clear()
    _counts.clear()
    _beyond.clear()
    _look_at_clocks()
    _begin_generation("file")


@contextmanager
def muted() -> Iterator[None]:
    """Ignore changes inside: our own sweep changes frames, not the scene."""
    global _muted
    _muted += 1
    try:
        yield
    finally:
        _muted -= 1


def sweeping() -> bool:
    """Return whether a sweep of the add-on is under way.

    The scene is then at a frame that nobody has chosen.
    """
    return _muted > 0


def _look_at_clocks() -> None:
    _clocks.clear()
    _clocks.update((scene.session_uid, scene_time.settings(scene)) for scene in bpy.data.scenes)


def _begin_generation(why: str) -> None:
    global _generation, _ticks
    _generation += 1
    _ticks += 1
    _dirty.add(why)

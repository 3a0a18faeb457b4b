"""Identities of fingers and of their devices, which do not depend on names.

Bakes, calibrations and streams belong to identities. An identity is a property of the object, or of the item in its
list of devices, and is saved in the .blend. A copy of a finger is another finger. The copied property does not count
for it, whether the original still exists or not. Undo may remove a property, so the session keeps the identities, too.
A linked object without the property is identified by its file and its name in that file, which cannot be changed here.

The identity of a device counts only among the devices of its finger. A copied finger has copies of its devices, which
differ from the originals by the identity of the finger.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import bpy

LEGACY = "dermis_finger_id"  # a custom property, in which earlier versions kept a finger's identity


class Device(NamedTuple):
    """A device on a finger, by the identities of both.

    '' stands for an identity that has not been given yet; such a device cannot be recognized.
    """

    finger: str
    device: str


class Place(NamedTuple):
    """Last known name and session uid of an object, to find it again quickly."""

    name: str  # in full
    uid: int  # session uid

    @classmethod
    def of(cls, obj: bpy.types.Object) -> Place:
        """Return the place of an object."""
        return cls(obj.name_full, obj.session_uid)

    def finger(self, scene: bpy.types.Scene) -> bpy.types.Object | None:
        """Return the object, even under a new name, if it is a finger of a scene.

        Otherwise None.
        """
        obj = named(scene, self.name)
        if obj is None or obj.session_uid != self.uid:
            obj = next((o for o in scene.objects if o.session_uid == self.uid), None)
        return obj if obj is not None and obj.dermis.role == "FINGER" else None


class _Item(NamedTuple):
    identity: str
    preset: str


_given: dict[int, str] = {}  # by the object's session uid
_items: dict[int, tuple[_Item, ...]] = {}  # by the same uid: its devices when they were last given identities
_revision = 0


def identity(obj: bpy.types.Object) -> str:
    """Return a finger's identity, '' if it has none of its own. Writes nothing."""
    own = _claimed(obj)
    if not own or obj.session_uid in _given:
        return own
    elder = any(o.session_uid < obj.session_uid and _claimed(o) == own for o in _fingers())
    if not elder and own not in _given.values():
        return own
    there = _of_file(obj)
    return there if there != own and there not in _given.values() else ""


def devices(obj: bpy.types.Object) -> tuple[str, ...]:
    """Return the identities of a finger's devices, in their order.

    '' for a device that has none. Writes nothing.
    """
    own: list[str] = []
    items = obj.dermis.finger.devices
    for item in items:
        said = item.identity
        own.append(said if is_identity(said) and said not in own else "")
    if not all(own):
        for i, (item, kept) in enumerate(zip(items, _items.get(obj.session_uid, ()), strict=False)):
            if not own[i] and kept.preset == item.preset and kept.identity not in own:  # undo has removed the property
                own[i] = kept.identity
        if obj.library is not None:
            own = [said or _hashed(_of_file(obj), str(i)) for i, said in enumerate(own)]
    return tuple(own)


def revision() -> int:
    """Return a number that rises at every call of `give`, for caches."""
    return _revision


def is_identity(text: str) -> bool:
    """Return whether a text can be an identity."""
    return re.fullmatch(r"[0-9a-f]{32}", text) is not None


def give(obj: bpy.types.Object) -> str:
    """Return a finger's identity, and give it and its devices the missing ones.

    This makes no bake out of date.
    """
    global _revision
    _revision += 1
    own = identity(obj) or os.urandom(16).hex()
    _given[obj.session_uid] = own
    items = tuple(said or os.urandom(16).hex() for said in devices(obj))
    _items[obj.session_uid] = tuple(
        _Item(said, item.preset) for said, item in zip(items, obj.dermis.finger.devices, strict=True)
    )
    _write(obj, own, items)
    return own


def worn(obj: bpy.types.Object) -> list[tuple[Device, Any]]:
    """Return a finger's enabled devices with a preset, and their settings."""
    own = identity(obj)
    pairs = zip(devices(obj), obj.dermis.finger.devices, strict=True)
    return [(Device(own, said), item) for said, item in pairs if item.enabled and item.preset]


def fingers(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Return the fingers of a scene."""
    return [obj for obj in scene.objects if obj.dermis.role == "FINGER"]


def finger_with(own: str, scene: bpy.types.Scene) -> bpy.types.Object | None:
    """Return the finger of a scene with an identity, None without one."""
    if not own:
        return None
    return next((o for o in fingers(scene) if identity(o) == own), None)


def named(scene: bpy.types.Scene, name: str) -> bpy.types.Object | None:
    """Return the object of a scene with a full name, None if there is none.

    The full name of a linked object includes its file.
    """
    for layer in scene.view_layers:  # a view layer looks a name up, which is faster than a search of the file's list
        obj = layer.objects.get(name)
        if obj is not None and obj.name_full == name:
            return obj
    obj = bpy.data.objects.get(name)
    if obj is None or obj.name_full != name:
        obj = next((o for o in scene.objects if o.name_full == name), None) if " [" in name else None
    return obj if obj is not None and is_in(obj, scene) else None


def is_in(obj: bpy.types.Object, scene: bpy.types.Scene) -> bool:
    """Return whether a scene has an object."""
    # layers know objects by name, which is many times faster than the scene's own list
    return any(is_in_layer(obj, layer) for layer in scene.view_layers) or any(other == obj for other in scene.objects)


def is_in_layer(obj: bpy.types.Object, layer: bpy.types.ViewLayer) -> bool:
    """Return whether a view layer has an object.

    The answer is right even if an object of another file has the same name.
    """
    found = layer.objects.get(obj.name)
    return found == obj or (found is not None and any(other == obj for other in layer.objects))


def note(baked: Mapping[str, str]) -> None:
    """Remember the identities in a file that has just been opened.

    An object that has the same property later is a copy.

    Args:
        baked: names of fingers when they were baked, by identity. Two objects have the same identity if the file was
            saved without this add-on. Then the one with this name keeps it.
    """
    _given.clear()
    _items.clear()
    said: dict[str, list[bpy.types.Object]] = {}
    for obj in sorted(_fingers(), key=lambda o: o.session_uid):
        said.setdefault(_claimed(obj), []).append(obj)
    for own, objects in said.items():
        if own:
            known = next((obj for obj in objects if obj.name_full == baked.get(own)), objects[0])
            _given[known.session_uid] = own


def settle() -> None:
    """Write all identities into the file's properties before it is saved.

    Otherwise a copy could be taken for its original when the file is opened again.
    """
    for obj, own in [(obj, identity(obj)) for obj in _fingers()]:
        _write(obj, own, devices(obj) if own else ())


def _claimed(obj: bpy.types.Object) -> str:
    said = _given.get(obj.session_uid) or obj.dermis.identity or obj.get(LEGACY, "")
    return said if isinstance(said, str) and is_identity(said) else _of_file(obj)


def _of_file(obj: bpy.types.Object) -> str:
    """Return the identity of a linked object from its file and its name there.

    '' for an object of this file. Only the file's name and its folder's name count, so that a project may be moved as a
    whole.
    """
    if obj.library is None:
        return ""
    path = Path(bpy.path.abspath(obj.library.filepath, library=obj.library.parent))
    return _hashed(*path.parts[-2:], obj.name)


def _hashed(*texts: str) -> str:
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:32]


def _fingers() -> Iterator[bpy.types.Object]:
    seen = set()
    for scene in bpy.data.scenes:
        for obj in fingers(scene):
            if obj.session_uid not in seen:
                seen.add(obj.session_uid)
                yield obj


def _write(obj: bpy.types.Object, own: str, items: tuple[str, ...]) -> None:
    if obj.library is not None:  # linked data cannot be written
        return
    if LEGACY in obj:
        del obj[LEGACY]
    if obj.dermis.identity != own:
        obj.dermis.identity = own
    for item, said in zip(obj.dermis.finger.devices, items, strict=False):
        if item.identity != said:
            item.identity = said

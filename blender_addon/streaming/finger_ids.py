"""Who a finger is, whatever it is called: the key under which this computer remembers which device it wears.

The identity is a custom property of the object. A copy of a finger is another finger, so it is worth nothing there,
whether the original is still around or not. Undo may take the property back: a session remembers it too.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator

import bpy

PROPERTY = "dermis_finger_id"

_given: dict[int, str] = {}  # by the object's session uid


def identity(obj: bpy.types.Object) -> str:
    """Return a finger's identity, '' where it has none of its own. Writes nothing."""
    own = _claimed(obj)
    if not own or obj.session_uid in _given:
        return own
    elder = any(o.session_uid < obj.session_uid and _claimed(o) == own for o in _fingers())
    return "" if elder or own in _given.values() else own


def is_identity(text: str) -> bool:
    """Return whether a text can be an identity."""
    return re.fullmatch(r"[0-9a-f]{32}", text) is not None


def give(obj: bpy.types.Object) -> str:
    """Return a finger's identity; one that has none is given one, unless it is linked and cannot keep it: ''."""
    own = identity(obj)
    if own or obj.library is not None:
        return own
    own = os.urandom(16).hex()
    _given[obj.session_uid] = own
    _write(obj, own)
    return own


def finger_with(identities: frozenset[str], scene: bpy.types.Scene) -> bpy.types.Object | None:
    """Return the finger of a scene that has one of some identities."""
    return next((o for o in scene.objects if o.dermis.role == "FINGER" and identity(o) in identities), None)


def note() -> None:
    """Remember who is who in a file that has just been opened: what says the same later is a copy."""
    _given.clear()
    _given.update([(obj.session_uid, own) for obj in _fingers() if (own := identity(obj))])


def settle() -> None:
    """Write down who is who, before a file is saved: a copy shall not come back as the finger it was copied from."""
    for obj, own in [(obj, identity(obj)) for obj in _fingers()]:
        _write(obj, own)


def _claimed(obj: bpy.types.Object) -> str:
    said = _given.get(obj.session_uid) or obj.get(PROPERTY, "")
    return said if isinstance(said, str) and is_identity(said) else ""


def _fingers() -> Iterator[bpy.types.Object]:
    seen = set()
    for scene in bpy.data.scenes:
        for obj in scene.objects:
            if obj.session_uid not in seen and obj.dermis.role == "FINGER":
                seen.add(obj.session_uid)
                yield obj


def _write(obj: bpy.types.Object, own: str) -> None:
    if obj.library is not None or obj.get(PROPERTY, "") == own:  # what is linked cannot be written
        return
    if own:
        obj[PROPERTY] = own
    else:
        del obj[PROPERTY]

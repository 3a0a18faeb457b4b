"""Find the data-blocks that depend on others, by following their users."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import bpy

_NO_LINK = ("Scene", "WindowManager", "WorkSpace", "Screen", "Window", "Library", "Text")

Users = Mapping[Any, set[Any]]


def dependants(
    sources: set[Any], users: Users | None = None, leads: Callable[[Any, Any], bool] | None = None
) -> set[Any]:
    """Return the sources and every ID that refers to one of them.

    References may lead through other IDs.

    Args:
        users: the users of each ID; Blender's own map if None.
        leads: whether a user of an ID (the second argument) depends on that ID (the first). If None, every user does,
            except a collection.
    """
    if not sources:
        return set()
    users = bpy.data.user_map() if users is None else users
    leads = _refers if leads is None else leads
    found, pending = set(sources), list(sources)
    while pending:
        used = pending.pop()
        for user in users.get(used, ()):
            if user not in found and type(user).__name__ not in _NO_LINK and leads(used, user):
                found.add(user)
                pending.append(user)
    return found


class Shapes:
    """The objects that get their shape from others.

    It is valid only until the file changes.
    """

    def __init__(self) -> None:
        self._users = bpy.data.user_map()
        for obj in bpy.data.objects:
            if obj.parent is not None and obj.parent.is_instancer:  # the parent shows it on its vertices or faces
                self._users.setdefault(obj, set()).add(obj.parent)

    def of(self, source: bpy.types.ID, *, shown: bool = False) -> frozenset[int]:
        """Return session uids of objects whose shape can depend on `source`.

        Args:
            source: an object or a collection.
            shown: return those that depend on whether the source is shown; modifiers and nodes that refer to an object
                itself do not.
        """

        def leads(used: Any, user: Any) -> bool:
            if shown and used == source and isinstance(used, bpy.types.Object):
                return isinstance(user, bpy.types.Collection) or (used.parent == user and user.is_instancer)
            return _shapes(used, user)

        found = dependants({source}, self._users, leads) - {source}
        return frozenset(o.session_uid for o in found if isinstance(o, bpy.types.Object) and _has_parts(o))


def _refers(_used: Any, user: Any) -> bool:
    return not isinstance(user, bpy.types.Collection)


def _shapes(used: Any, user: Any) -> bool:
    """Return whether the shape of a user can depend on an ID.

    Some collections only say where forces act.
    """
    if not isinstance(used, bpy.types.Collection):
        return True
    if isinstance(user, bpy.types.Object):
        return user.instance_collection == used or any(m.type in ("BOOLEAN", "NODES") for m in user.modifiers)
    if isinstance(user, bpy.types.ParticleSettings):
        return bool(user.instance_collection == used)
    return isinstance(user, bpy.types.Collection | bpy.types.NodeTree)


def _has_parts(obj: bpy.types.Object) -> bool:
    return bool(obj.is_instancer) or len(obj.modifiers) > 0

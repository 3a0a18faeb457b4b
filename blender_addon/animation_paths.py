"""Animation that follows when an element leaves a collection.

Keys and drivers name an element by its number. When one is removed its own must go and those of its later neighbours
must be renumbered, or they would move the element in its place.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import bpy

from . import compat


def element_removed(owner: bpy.types.ID, collection: str, index: int) -> list[str]:
    """Let keys, NLA strips and drivers follow the removal of an element.

    Return the drivers that lost their source. An action that others use too, or that is linked, is copied first,
    because the elements of the others have not moved.

    Args:
        collection: path of the collection, such as 'dermis.finger.devices'.
        index: index of the removed element.
    """
    pattern = re.compile(rf"{re.escape(collection)}\[(\d+)\]")
    animation = owner.animation_data
    if animation is not None:
        _in_actions(owner, animation, pattern, index)
        _renumber(animation.drivers, pattern, index)
    return _in_targets(owner, pattern, index)


def _followed(path: str, pattern: re.Pattern[str], index: int) -> str | None:
    """Return the new path, '' if its element is gone, None if it does not change."""
    found = pattern.match(path)
    if found is None or int(found[1]) < index:
        return None
    if int(found[1]) == index:
        return ""
    return f"{path[: found.start(1)]}{int(found[1]) - 1}{path[found.end(1) :]}"


def _renumber(curves: Any, pattern: re.Pattern[str], index: int) -> None:
    """Remove and renumber the curves of a channel bag, or drivers."""
    for curve in list(curves):
        path = _followed(curve.data_path, pattern, index)
        if path == "":
            curves.remove(curve)
        elif path is not None:
            curve.data_path = path


def _in_actions(owner: bpy.types.ID, animation: Any, pattern: re.Pattern[str], index: int) -> None:
    """Edit each action and slot of an owner once.

    Actions that others use, or that are linked, are copied first.
    """
    copies: dict[bpy.types.Action, bpy.types.Action] = {}
    done = set()
    for holder in compat.action_holders(animation):
        action, slot = holder.action, holder.action_slot
        if action is None or slot is None or (action, slot.handle) in done:
            continue
        handle = slot.handle
        if not any(_followed(c.data_path, pattern, index) is not None for c in _curves(action, handle)):
            continue
        if action not in copies and (not action.is_editable or any(user != owner for user in slot.users())):
            copies[action] = action.copy()
        if action in copies:
            action = copies[action]
            holder.action = action
            holder.action_slot = next(s for s in action.slots if s.handle == handle)
        if (action, handle) not in done:
            for bag in compat.channelbags(action):
                if bag.slot_handle == handle:
                    _renumber(bag.fcurves, pattern, index)
            done.add((action, handle))


def _curves(action: bpy.types.Action, handle: int) -> Iterator[Any]:
    for bag in compat.channelbags(action):
        if bag.slot_handle == handle:
            yield from bag.fcurves


def _in_targets(owner: bpy.types.ID, pattern: re.Pattern[str], index: int) -> list[str]:
    """Renumber the owner's elements in drivers' variables.

    Drivers whose source is gone are muted; return their paths.
    """
    lost = []
    for user in _animated():
        for curve in user.animation_data.drivers:
            for target in (t for v in curve.driver.variables if v.type == "SINGLE_PROP" for t in v.targets):
                path = _followed(target.data_path, pattern, index) if target.id == owner else None
                if path is not None:
                    target.data_path = path
                if path == "":
                    curve.mute = True  # so that its target stands still
                    lost.append(f"{user.name_full}: {curve.data_path}")
    return lost


def _animated() -> Iterator[Any]:
    """Yield every ID of this file with animation data once.

    Node trees inside other IDs are included.
    """
    seen = set()
    for prop in bpy.data.bl_rna.properties:
        if prop.type != "COLLECTION":
            continue
        for item in getattr(bpy.data, prop.identifier):
            if not isinstance(item, bpy.types.ID):
                continue
            for user in (item, getattr(item, "node_tree", None)):
                if user is not None and user not in seen and getattr(user, "animation_data", None) is not None:
                    seen.add(user)
                    yield user

"""Conditions under which operators can be pressed and panels are shown."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import bpy

from . import changes, loading
from ._core import core

T = TypeVar("T", bound=type)

_fingers: core.recent.Recent[tuple[int, int, int], tuple[tuple[str, None], ...]] = core.recent.Recent(4)


def needs(test: Callable[[bpy.types.Context], Any], message: str = "") -> Callable[[T], T]:
    """Return a decorator: an operator or panel is available if a test holds.

    A panel is also hidden until the modules that panels query are loaded, because its draw must not load them.

    Args:
        message: tooltip of an operator's button that cannot be pressed: the step that has to come first.
    """

    def decorate(decorated: T) -> T:
        panel = issubclass(decorated, bpy.types.Panel)

        def poll(cls: Any, context: bpy.types.Context) -> bool:
            if message:
                cls.poll_message_set(message)
            return (not panel or loading.addon_loaded()) and bool(test(context))

        setattr(decorated, "poll", classmethod(poll))  # noqa: B010  # mypy knows no attribute of T
        return decorated

    return decorate


def active_finger(context: bpy.types.Context) -> bpy.types.Object | None:
    """Return the active object if it is a finger, else None."""
    obj = context.object
    return obj if obj is not None and obj.dermis.role == "FINGER" else None


def finger_at_hand(context: bpy.types.Context) -> bpy.types.Object | None:
    """Return the finger that an operator shall use, None if there is none.

    It is the active object if that is a finger of this file. If another object is active, it is the nearest selected
    finger, else the nearest of all. These have to be visible, of this file and without a parent. Their distance is
    measured from the active object, or from the 3D cursor if there is none.
    """
    active = context.object
    if active is not None and active.dermis.role == "FINGER":
        return own_finger(context)
    scene = context.scene
    names = _fingers.make(  # searched once after each change, not at each redraw
        (scene.session_uid, changes.ticks(), len(scene.objects)),
        lambda: tuple((o.name, None) for o in scene.objects if o.dermis.role == "FINGER" and o.library is None),
    )
    there = filter(None, map(bpy.data.objects.get, names))
    fingers = [obj for obj in there if obj.is_editable and obj.parent is None and obj.visible_get()]
    at = active.matrix_world.translation if active is not None else context.scene.cursor.location
    return min(
        fingers, key=lambda obj: (not obj.select_get(), (obj.matrix_world.translation - at).length), default=None
    )


def own_finger(context: bpy.types.Context) -> bpy.types.Object | None:
    """Return the active object if it is a finger whose edits are saved, else None.

    Such a finger is of this file, or is an override.
    """
    finger = active_finger(context)
    return finger if finger is not None and finger.is_editable else None

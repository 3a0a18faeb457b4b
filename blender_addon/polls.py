"""When operators can be pressed, and panels are there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import bpy

from . import changes
from ._core import core

T = TypeVar("T", bound=type)

_fingers: core.recent.Recent[tuple[int, int, int], tuple[tuple[str, None], ...]] = core.recent.Recent(4)


def needs(test: Callable[[bpy.types.Context], Any], message: str = "") -> Callable[[T], T]:
    """Return a decorator that lets an operator or panel of Blender be there where a test holds.

    Args:
        message: for who points at an operator's button that cannot be pressed: what to do first.
    """

    def decorate(decorated: T) -> T:
        def poll(cls: Any, context: bpy.types.Context) -> bool:
            if message:
                cls.poll_message_set(message)
            return bool(test(context))

        setattr(decorated, "poll", classmethod(poll))  # noqa: B010  # mypy knows no attribute of T
        return decorated

    return decorate


def active_finger(context: bpy.types.Context) -> bpy.types.Object | None:
    """Return the active object where it is a finger."""
    obj = context.object
    return obj if obj is not None and obj.dermis.role == "FINGER" else None


def finger_at_hand(context: bpy.types.Context) -> bpy.types.Object | None:
    """Return the finger that is meant, whatever is active: it, else the nearest selected one, else the nearest of all.

    Only those whose edits are saved and that nothing carries. Nearest is measured from the active object, else from the
    3D cursor.
    """
    active = context.object
    if active is not None and active.dermis.role == "FINGER":
        return own_finger(context)
    scene = context.scene
    names = _fingers.make(  # looked for once after each change, and not once a redraw
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
    """Return the active object where it is a finger whose edits are saved: one of this file, or an override."""
    finger = active_finger(context)
    return finger if finger is not None and finger.is_editable else None

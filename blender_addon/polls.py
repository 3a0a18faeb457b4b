"""When operators can be pressed, and panels are there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import bpy

T = TypeVar("T", bound=type)


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


def own_finger(context: bpy.types.Context) -> bpy.types.Object | None:
    """Return the active object where it is a finger whose edits are saved: one of this file, or an override."""
    finger = active_finger(context)
    return finger if finger is not None and finger.is_editable else None

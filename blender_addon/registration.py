"""Registration of a module's classes and of its properties on Blender's types."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import bpy

from . import on_demand

Hung = tuple[type, str, Any]


def registration(
    classes: Sequence[type], *hung: Hung, forget: Sequence[Any] = ()
) -> tuple[Callable[[], None], Callable[[], None]]:
    """Return `register` and `unregister` of a module.

    Args:
        hung: properties on Blender's own types: the type, the name and the property. When a property is removed, its
            values stay in the file as plain data.
        forget: modules whose `forget` is called first by `unregister`, if they have been loaded.
    """
    add, remove = bpy.utils.register_classes_factory(classes)

    def register() -> None:
        add()
        for owner, name, declared in hung:
            setattr(owner, name, declared)

    def unregister() -> None:
        for module in on_demand.read(*forget):
            module.forget()
        for owner, name, _ in reversed(hung):
            delattr(owner, name)
        remove()

    return register, unregister

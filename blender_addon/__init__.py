"""Dermis in Blender: animate a finger, get a command track for a tactile device."""

PACKAGE = __package__  # the three-part name in an installed extension; extension_path_user takes no other

from . import commands, handlers, jobs, operators, overlay, panels, preferences, properties  # noqa: E402

MODULES = (preferences, properties, jobs, operators, panels, overlay, handlers, commands)


def register() -> None:
    """Register everything, in the order in which it depends on each other."""
    for module in MODULES:
        module.register()


def unregister() -> None:
    """Undo `register`, in reverse."""
    for module in reversed(MODULES):
        module.unregister()

"""Dermis in Blender: animate a finger, get a command track for a tactile device."""

PACKAGE = __package__  # the three-part name in an installed extension; extension_path_user takes no other

from . import (  # noqa: E402
    commands,
    handlers,
    jobs,
    operators,
    overlay,
    panels,
    pin_view,
    platform_view,
    preferences,
    properties,
    properties_design,
    properties_skin,
    properties_stream,
    properties_thimble,
    skin_live,
    skin_view,
    streaming,
    thimble_view,
)

MODULES = (
    preferences, properties_skin, properties_thimble, properties, properties_design, properties_stream, jobs, operators,
    panels, overlay, pin_view, thimble_view, platform_view, skin_live, skin_view, handlers, streaming, commands,
)  # fmt: skip


def register() -> None:
    """Register everything, in the order in which it depends on each other."""
    for module in MODULES:
        module.register()


def unregister() -> None:
    """Undo `register`, in reverse."""
    for module in reversed(MODULES):
        module.unregister()

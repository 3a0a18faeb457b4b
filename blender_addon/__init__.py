"""Dermis in Blender: animate a finger, get a command track for a tactile device."""

from . import commands, handlers, jobs, operators, panels, preferences
from .design import design_properties
from .preview import skin_preview
from .properties import object_properties, scene_properties
from .streaming import session_events, streaming_properties
from .timeline import strip
from .viewport import cards, overlay, shown, skin_view

MODULES = (
    preferences,
    object_properties,
    scene_properties,
    design_properties,
    streaming_properties,
    jobs,
    operators,
    panels,
    overlay,
    skin_preview,
    shown,
    skin_view,
    strip,
    cards,
    handlers,
    session_events,
    commands,
)


def register() -> None:
    """Register everything, in the order in which it depends on each other."""
    for module in MODULES:
        module.register()


def unregister() -> None:
    """Undo `register`, in reverse."""
    for module in reversed(MODULES):
        module.unregister()

"""Dermis in Blender: command tracks for tactile devices from animated fingers."""

from . import on_demand

on_demand.modules_of(globals())  # before the other imports, so that their imports of this package are on demand

from . import handlers, jobs, operators, panels, preferences, views  # noqa: E402
from .design import design_properties  # noqa: E402
from .properties import object_properties, scene_properties  # noqa: E402
from .streaming import session_events, streaming_properties  # noqa: E402

MODULES = (
    preferences,
    object_properties,
    scene_properties,
    design_properties,
    streaming_properties,
    jobs,
    operators,
    panels,
    views,
    handlers,
    session_events,
)


def register() -> None:
    """Register all modules, each after those that it depends on."""
    for module in MODULES:
        module.register()


def unregister() -> None:
    """Undo `register`, in reverse."""
    for module in reversed(MODULES):
        module.unregister()

"""Settings of a device."""

# mypy: disable-error-code="valid-type"
# No postponed annotations here: Blender reads the properties from them when a class is registered.

from typing import Any

import bpy
from bpy.props import PointerProperty, StringProperty

from .. import choices
from .._core import core
from .fields import OVERRIDE, declared, switch, touched


def _is_screen(_self: Any, obj: bpy.types.Object) -> bool:
    return obj.dermis.role == "SCREEN"


@declared(core.parameters.device.DEVICE)
class DermisDevice(bpy.types.PropertyGroup):
    """One device worn by a finger, or one screen device that it touches."""

    identity: StringProperty(description="Identity that stays when names change", options={"HIDDEN"}, override=OVERRIDE)
    preset: StringProperty(
        name="Device",
        description="Device preset, by its file name",
        search=lambda _self, _context, text: choices.search("devices", text),
        options=set(),
        update=touched,
        override=OVERRIDE,
    )
    enabled: switch("Enabled", "Bake a track for this device", True)
    screen: PointerProperty(
        name="Screen",
        description="The touch screen that this finger touches; empty: every screen in the scene",
        type=bpy.types.Object,
        poll=_is_screen,
        update=touched,
        override=OVERRIDE,
    )

"""Settings of an object: parameters are saved in the .blend, results outside it.

Readers do not convert by hand: `parameters(group)` gives a group's values in SI under the engine's names
(`touch_distance_mm` -> `touch_distance` in metres), and `TABLES[type(group)]` their rows, for readers that sample
animated values. A screen's width and height are the bounds of its mesh in its own XY.
"""

# mypy: disable-error-code="valid-type"
# No postponed annotations here: Blender reads the properties from them when a class is registered.

from typing import Any

import bpy
from bpy.props import CollectionProperty, EnumProperty, IntProperty, PointerProperty, StringProperty

from .. import choices
from .._core import core
from ..registration import registration
from .fields import OVERRIDE, apply, declare_one, declared, device_name, switch, touched, unfelt, values
from .screen_properties import DermisScreen
from .skin_properties import DermisSkin


def _is_screen(_self: Any, obj: bpy.types.Object) -> bool:
    return obj.dermis.role == "SCREEN"


@declared(core.parameters.device.DEVICE)
class DermisDevice(bpy.types.PropertyGroup):
    """One device worn by a finger, or one screen device that it touches."""

    identity: StringProperty(description="Identity that stays when names change", options={"HIDDEN"}, override=OVERRIDE)
    preset: StringProperty(
        name="Device", description="Device preset, by its file name", options=set(), update=touched, override=OVERRIDE
    )
    preset_name: device_name("preset", "Preset of this device", worn=True)
    enabled: switch("Enabled", "Bake a track for this device", True)
    screen: PointerProperty(
        name="Screen",
        description="Touch screen that this finger touches. If empty, every screen in the scene",
        type=bpy.types.Object,
        poll=_is_screen,
        update=touched,
        override=OVERRIDE,
    )


@declared(core.parameters.material.BODY)
class DermisMaterial(bpy.types.PropertyGroup):
    """Haptic material and behaviour of something that can be touched."""

    preset: StringProperty(
        name="Preset",
        description="Preset from which the values below were taken last",
        search=lambda _self, _context, text: choices.search("materials", text),
        options=set(),
        override=OVERRIDE,
    )
    curved: declare_one(core.parameters.material.CURVED)


_rows = core.parameters


@declared(_rows.finger.FINGER)
class DermisFinger(bpy.types.PropertyGroup):
    """A fingertip: origin at the pad's centre, +Y towards the tip, +Z towards the nail."""

    skin: PointerProperty(description="Shape, tissue and contact of the skin", type=DermisSkin, override=OVERRIDE)
    devices: CollectionProperty(
        description="Devices on this finger", type=DermisDevice, override={"LIBRARY_OVERRIDABLE", "USE_INSERTION"}
    )
    active_device: IntProperty(
        name="Active Device",
        description="Place in the list of devices",
        default=0,
        min=0,
        options=set(),
        override=OVERRIDE,
        update=unfelt,
    )


class DermisObject(bpy.types.PropertyGroup):
    """What an object is to Dermis."""

    role: EnumProperty(
        name="Role",
        description="Role of this object",
        items=(
            ("NONE", "Nothing", "Dermis ignores this object"),
            ("FINGER", "Finger", "A fingertip"),
            ("TOUCHABLE", "Touchable", "An object that fingers can feel"),
            ("SCREEN", "Touch Screen", "A touch screen that renders friction"),
        ),
        default="NONE",
        options=set(),
        update=touched,
        override=OVERRIDE,
    )
    identity: StringProperty(description="Identity that stays when names change", options={"HIDDEN"}, override=OVERRIDE)
    finger: PointerProperty(description="Settings of a finger", type=DermisFinger, override=OVERRIDE)
    material: PointerProperty(
        description="Settings of an object that can be felt", type=DermisMaterial, override=OVERRIDE
    )
    screen: PointerProperty(description="Settings of a touch screen", type=DermisScreen, override=OVERRIDE)


TABLES: dict[type, core.parameters.parameter.Table] = {
    DermisDevice: _rows.device.DEVICE,
    DermisFinger: _rows.finger.FINGER,
    DermisMaterial: _rows.material.BODY,
    DermisScreen: _rows.screen.SCREEN,
}


def parameters(group: Any) -> dict[str, Any]:
    """Return a group's values in SI, by the engine's names, as in `Body.parameters`."""
    return values(group, TABLES[type(group)])


def apply_parameters(group: Any, given: dict[str, Any]) -> list[str]:
    """Set a group's properties from SI values; return the names that it does not have."""
    return apply(group, TABLES[type(group)], given)


register, unregister = registration(
    (DermisSkin, DermisDevice, DermisFinger, DermisMaterial, DermisScreen, DermisObject),
    (
        bpy.types.Object,
        "dermis",
        PointerProperty(type=DermisObject, name="Dermis", description="Settings of Dermis", override=OVERRIDE),
    ),
)

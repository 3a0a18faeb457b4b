"""What the artist sets, and nothing else: parameters live in the .blend, results outside it.

Readers do not convert by hand: `parameters(group)` gives a group's values in SI under the engine's names
(`touch_distance_mm` -> `touch_distance` in metres), and `TABLES[type(group)]` their rows, for readers that sample
animated values. A screen's width and height are the bounds of its mesh in its own XY.
"""

# mypy: disable-error-code="valid-type"
# No postponed annotations here: Blender reads the properties from them when a class is registered.

from typing import Any

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from .._core import core
from ..compat import BLEND_RELATIVE
from ..registration import registration
from .device_properties import DermisDevice
from .fields import OVERRIDE, apply, declared, touched, values
from .material_properties import DermisMaterial
from .screen_properties import DermisScreen
from .skin_properties import DermisSkin, DermisSkinView
from .thimble_view_properties import DermisThimbleView

FILE_VERSION = 1  # raise it when a property is renamed or means something else, and migrate older files on loading
_rows = core.parameters


@declared(_rows.finger.FINGER)
class DermisFinger(bpy.types.PropertyGroup):
    """A fingertip: origin at the pad's centre, +Y towards the tip, +Z towards the nail."""

    skin: PointerProperty(type=DermisSkin, override=OVERRIDE)
    devices: CollectionProperty(type=DermisDevice, override={"LIBRARY_OVERRIDABLE", "USE_INSERTION"})
    active_device: IntProperty(name="Active Device", default=0, min=0, options=set(), override=OVERRIDE)


class DermisObject(bpy.types.PropertyGroup):
    """What an object is to Dermis."""

    role: EnumProperty(
        name="Role",
        description="What this object is to Dermis",
        items=(
            ("NONE", "Nothing", "Dermis ignores this object"),
            ("FINGER", "Finger", "A fingertip that feels"),
            ("TOUCHABLE", "Touchable", "An object that fingers can feel"),
            ("SCREEN", "Touch Screen", "A touch screen that renders friction"),
        ),
        default="NONE",
        options=set(),
        update=touched,
        override=OVERRIDE,
    )
    finger: PointerProperty(type=DermisFinger, override=OVERRIDE)
    material: PointerProperty(type=DermisMaterial, override=OVERRIDE)
    screen: PointerProperty(type=DermisScreen, override=OVERRIDE)


class DermisScene(bpy.types.PropertyGroup):
    """Settings of the whole scene."""

    # 0: no Dermis yet. Blender does not store values that equal the default, so that must not be the version.
    file_version: IntProperty(default=0, options={"HIDDEN"})
    sample_rate: FloatProperty(
        name="Sampling",
        description="Samples a second of the sweep over the animation, whatever the frame rate",
        default=240.0,
        min=1.0,
        max=10_000.0,
        soft_min=60.0,
        soft_max=1000.0,
        unit="FREQUENCY",
        options=set(),
        update=touched,
    )
    use_range: BoolProperty(
        name="Own Range",
        description="Bake another range than the scene's frame range",
        default=False,
        options=set(),
        update=touched,
    )
    frame_start: IntProperty(name="Start", description="First frame to bake", default=1, options=set(), update=touched)
    frame_end: IntProperty(name="End", description="Last frame to bake", default=250, options=set(), update=touched)
    output_dir: StringProperty(
        name="Output",
        description="Folder for exported tracks",
        default="//tracks/",
        subtype="DIR_PATH",
        options=BLEND_RELATIVE,
    )
    plots: BoolProperty(
        name="With Plots", description="Write a PNG plot beside each exported track", default=False, options=set()
    )
    skin_view: PointerProperty(type=DermisSkinView)
    thimble_view: PointerProperty(type=DermisThimbleView)
    live_preview: BoolProperty(
        name="Live Preview",
        description="Evaluate the current frame while you scrub, where no fresh bake covers it",
        default=True,
        options=set(),
    )
    show_twin: BoolProperty(
        name="Device Twin", description="Draw the device on the finger, moving as it will", default=True, options=set()
    )
    show_readout: BoolProperty(
        name="Readout", description="Write the devices' values into the view", default=True, options=set()
    )
    twin_exaggeration: FloatProperty(
        name="Exaggeration",
        description="Draw the tactor's movement this many times as large as it is",
        default=1.0,
        min=0.1,
        max=100.0,
        soft_min=1.0,
        soft_max=10.0,
        precision=1,
        options=set(),
    )
    bake_key: StringProperty(description="Which stored result the last bake gave", options={"HIDDEN"})
    active_finding: IntProperty(default=-1, options={"HIDDEN"})


TABLES: dict[type, core.parameters.parameter.Table] = {
    DermisDevice: _rows.device.DEVICE,
    DermisFinger: _rows.finger.FINGER,
    DermisMaterial: _rows.material.BODY,
    DermisScreen: _rows.screen.SCREEN,
}


def parameters(group: Any) -> dict[str, Any]:
    """Return a group's values in SI, by the engine's names: what `Body.parameters` and its like take."""
    return values(group, TABLES[type(group)])


def apply_parameters(group: Any, given: dict[str, Any]) -> list[str]:
    """Set a group's properties from SI values; return the names that it does not have."""
    return apply(group, TABLES[type(group)], given)


def stamp(scene: bpy.types.Scene) -> None:
    """Note which version of these properties a scene was made with; a newer one that it holds stays said."""
    scene.dermis.file_version = max(scene.dermis.file_version, FILE_VERSION)


CLASSES: tuple[type, ...] = (
    *(DermisSkin, DermisSkinView, DermisThimbleView),
    *(DermisDevice, DermisFinger, DermisMaterial, DermisScreen, DermisObject, DermisScene),
)


register, unregister = registration(
    CLASSES,
    (bpy.types.Object, "dermis", PointerProperty(type=DermisObject, name="Dermis", override=OVERRIDE)),
    (bpy.types.Scene, "dermis", PointerProperty(type=DermisScene, name="Dermis")),
)

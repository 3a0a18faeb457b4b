"""What the artist sets, and nothing else: parameters live in the .blend, results outside it.

Units. Everything that a property holds is SI except where its *name* ends in a unit: `_mm` (millimetres),
`_mm_s` (millimetres a second) or `_mpa_m` (megapascals a metre, which are kilopascals a millimetre). Blender
would scale properties of unit LENGTH by the scene's unit scale, so a scene in feet or millimetres would show a
fingertip's half a millimetre as something else; these properties use Blender's lens unit instead, which means
millimetres in every scene. Angles are radians (Blender shows degrees).

Readers do not convert by hand: `parameters(group)` gives a group's values in SI under the engine's names
(`touch_distance_mm` -> `touch_distance` in metres), and `ATTRIBUTES[type(group)]` lists attribute, engine name and
factor, for readers that sample animated values. A screen's width and height are the bounds of its mesh in its own XY.
"""

# mypy: disable-error-code="valid-type"
# No postponed annotations here: Blender reads the properties from them when a class is registered.

from typing import Any

import bpy
from bpy.props import BoolProperty, CollectionProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..compat import BLEND_RELATIVE
from .device_properties import DermisDevice
from .fields import OVERRIDE, Attribute, attributes_of, choice, millimetres, number, switch, touched
from .material_properties import DermisMaterial
from .screen_properties import DermisScreen
from .skin_properties import DermisSkin, DermisSkinView
from .thimble_view_properties import DermisThimbleView

FILE_VERSION = 1


class DermisFinger(bpy.types.PropertyGroup):
    """A fingertip: origin at the pad's centre, +Y towards the tip, +Z towards the nail."""

    touch_distance_mm: millimetres(
        "Touch Gap",
        "The pad counts as touching where a surface is at most this far from its centre",
        0.5,
        0.0,
        1000.0,
        soft_max=5.0,
    )
    pattern: choice(
        "Pattern",
        "A cue of the finger's own, played on the tactor",
        (
            ("none", "None", "No pattern"),
            ("orientation", "Orientation", "The tactor rubs along a line ([S3] eq. 7)"),
            ("direction", "Direction", "The tactor moves out along a direction and comes back ([S3] eq. 8)"),
        ),
        "none",
    )
    pattern_play: switch("Play", "Key this on to start the pattern: every change from off to on starts it", False)
    pattern_angle: number(
        "Angle",
        "Direction of the pattern in the pad's plane, clockwise as in the paper",
        0.0,
        -1e4,
        1e4,
        soft_min=-6.2832,
        soft_max=6.2832,
        subtype="ANGLE",
    )
    pattern_frequency: number("Frequency", "Repetitions a second", 2.0, 0.01, 500.0, soft_max=20.0, unit="FREQUENCY")
    pattern_amplitude: number("Amplitude", "Part of the device's range", 1.0, 0.0, 1.0, subtype="FACTOR")
    pattern_repeat: switch("Repeat", "Go on while Play is on, instead of playing once", False, options=set())
    skin: PointerProperty(type=DermisSkin, override=OVERRIDE)
    devices: CollectionProperty(type=DermisDevice, override={"LIBRARY_OVERRIDABLE", "USE_INSERTION"})
    active_device: IntProperty(name="Active Device", default=0, min=0, options=set(), override=OVERRIDE)


class DermisObject(bpy.types.PropertyGroup):
    """What an object is to Dermis."""

    role: choice(
        "Role",
        "What this object is to Dermis",
        (
            ("NONE", "Nothing", "Dermis ignores this object"),
            ("FINGER", "Finger", "A fingertip that feels"),
            ("TOUCHABLE", "Touchable", "An object that fingers can feel"),
            ("SCREEN", "Touch Screen", "A touch screen that renders friction"),
        ),
        "NONE",
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


ATTRIBUTES: dict[type, tuple[Attribute, ...]] = {
    DermisDevice: attributes_of(DermisDevice, "preset", "enabled", "screen"),
    DermisFinger: attributes_of(DermisFinger, "skin", "devices", "active_device"),
    DermisMaterial: attributes_of(DermisMaterial, "preset"),
    DermisScreen: attributes_of(
        DermisScreen,
        "source",
        "image",
        "filepath",
        "sequence_start",
        "mesh_object",
        "invert",
        "zero_is_hole",
        "resolution",
    ),
}


def parameters(group: Any) -> dict[str, Any]:
    """Return a group's values in SI, by the engine's names: what `Body.parameters` and its like take."""
    return {
        a.parameter: value * a.factor if a.factor != 1.0 else value
        for a in ATTRIBUTES[type(group)]
        for value in (getattr(group, a.attribute),)
    }


def apply_parameters(group: Any, values: dict[str, Any]) -> list[str]:
    """Set a group's properties from SI values; return the names that it does not have."""
    by_name = {a.parameter: a for a in ATTRIBUTES[type(group)]}
    for name, value in values.items():
        if name in by_name:
            a = by_name[name]
            setattr(group, a.attribute, value / a.factor if a.factor != 1.0 else value)
    return [name for name in values if name not in by_name]


def stamp(scene: bpy.types.Scene) -> None:
    """Note which version of these properties a scene was made with."""
    scene.dermis.file_version = FILE_VERSION


CLASSES: tuple[type, ...] = (DermisDevice, DermisFinger, DermisMaterial, DermisScreen, DermisObject, DermisScene)


def register() -> None:
    """Register the groups and hang them on objects and scenes."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Object.dermis = PointerProperty(type=DermisObject, name="Dermis", override=OVERRIDE)
    bpy.types.Scene.dermis = PointerProperty(type=DermisScene, name="Dermis")


def unregister() -> None:
    """Undo `register`; the values stay in the file as plain data."""
    del bpy.types.Scene.dermis
    del bpy.types.Object.dermis
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)

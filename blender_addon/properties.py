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

from typing import Any, NamedTuple

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

from . import handlers
from .properties_skin import DermisSkin, DermisSkinView

FILE_VERSION = 1
FACTORS = {"_mm_s": 1e-3, "_mpa_m": 1e6, "_mm": 1e-3}
OVERRIDE = {"LIBRARY_OVERRIDABLE"}


class Attribute(NamedTuple):
    """How one property becomes an engine parameter: value_in_SI = property * factor."""

    attribute: str
    parameter: str
    factor: float


def _touched(_self: Any, _context: Any) -> None:
    handlers.mark_dirty()


def _number(name: str, text: str, default: float, low: float, high: float, **more: Any) -> Any:
    """Declare an animatable number; values are refused, not clamped, only outside what is physically possible."""
    more.setdefault("soft_min", low)
    return FloatProperty(
        name=name, description=text, default=default, min=low, max=high, update=_touched, override=OVERRIDE, **more
    )


def _millimetres(name: str, text: str, default: float, low: float, high: float, **more: Any) -> Any:
    return _number(name, text, default, low, high, unit="CAMERA", precision=3, **more)


def _switch(name: str, text: str, default: bool) -> Any:
    return BoolProperty(name=name, description=text, default=default, update=_touched, override=OVERRIDE)


def _choice(name: str, text: str, items: tuple[tuple[Any, ...], ...], default: str, **more: Any) -> Any:
    # Methods and kinds stay constant over a scene, so they cannot be keyframed.
    return EnumProperty(
        name=name, description=text, items=items, default=default, options=set(), update=_touched, override=OVERRIDE,
        **more,
    )  # fmt: skip


def _is_screen(_self: Any, obj: bpy.types.Object) -> bool:
    return obj.dermis.role == "SCREEN"


def _is_mesh(_self: Any, obj: bpy.types.Object) -> bool:
    return obj.type == "MESH" and obj.dermis.role != "SCREEN"


def _device_keys(_self: Any, _context: Any, text: str) -> list[str]:
    from .panels import choices

    return [entry.key for entry in choices.devices() if text.lower() in f"{entry.key} {entry.name}".lower()]


def _material_keys(_self: Any, _context: Any, text: str) -> list[str]:
    from .panels import choices

    return [entry.key for entry in choices.materials() if text.lower() in f"{entry.key} {entry.name}".lower()]


class DermisDevice(bpy.types.PropertyGroup):
    """One device worn by a finger, or one screen device that it touches."""

    preset: StringProperty(
        name="Device", description="Device preset, by its file name", search=_device_keys,
        options=set(), update=_touched, override=OVERRIDE,
    )  # fmt: skip
    enabled: BoolProperty(
        name="Enabled", description="Bake a track for this device", default=True, options=set(), update=_touched,
        override=OVERRIDE,
    )  # fmt: skip

    use_transient: _switch("Contact Transient", "Render the vibration of making contact ([S3] eq. 1)", True)
    use_texture: _switch("Texture", "Render the texture of what the finger slides over ([S3] eq. 2 and 3)", True)
    use_weight: _switch("Weight", "Render weight and inertia of a held object ([S3] eq. 4)", True)
    use_content: _switch("Content", "Render what moves inside a held object ([S3] eq. 5)", True)
    use_pattern: _switch("Pattern", "Render the finger's own pattern, a cue for direction ([S3] eq. 7 and 8)", True)
    projection: _choice(
        "Projection", "How a displacement in space becomes one in the tactor's plane ([S3] eq. 6)",
        (("magnitude", "Keep Magnitude", "The length is min(1, |P inv(T) d|), the direction that of P inv(T) d"),
         ("printed", "As Printed", "The formula as the paper prints it, which weakens tilted vectors twice")),
        "magnitude",
    )  # fmt: skip
    transient_axis: _choice(
        "Transient Axis", "Where the part of an impact that points into the pad goes, which a 2D tactor cannot show",
        (("tilted", "Turned to the Pad", "Turn the normal part to the pad axis that the device preset declares"),
         ("printed", "As Printed", "Drop it, as the printed formula does")),
        "tilted",
    )  # fmt: skip
    weight_sign: _choice(
        "Inertia Sign", "Sign of the acceleration term of weight ([S3] eq. 4)",
        (("paper", "As in the Paper", "The tactor moves with the acceleration"),
         ("inertia", "Inertia", "The tactor drags behind the acceleration, as a real mass would")),
        "paper",
    )  # fmt: skip
    auto_range: _switch("Auto Range", "Scale weights so that the scene's heaviest just uses the whole range and "
                        "lighter ones stay apart; without it strong accelerations saturate", False)  # fmt: skip

    screen: PointerProperty(
        name="Screen", description="The touch screen that this finger touches; empty: every screen in the scene",
        type=bpy.types.Object, poll=_is_screen, update=_touched, override=OVERRIDE,
    )  # fmt: skip
    profile: _choice(
        "Profile", "What of the relief becomes friction ([S4])",
        (("slope", "Slope", "Friction follows the slope along the movement: the gradient method"),
         ("height", "Height", "Friction follows the height under the finger"),
         ("rectangle", "Rectangle", "Full friction wherever the height is above the threshold")),
        "slope",
    )  # fmt: skip
    downhill: _choice(
        "Downhill", "What to do where the slope along the movement is negative: friction cannot be",
        (("rectify", "Rectify", "No extra friction downhill"),
         ("offset", "Offset", "Flat ground at mid range, less friction downhill"),
         ("absolute", "Absolute", "Friction of the steepness, uphill or down")),
        "rectify",
    )  # fmt: skip
    scale_mode: _choice(
        "Scale", "How slope becomes perceived friction",
        (("auto", "Automatic", "The steepest slope of the whole bake becomes friction 100"),
         ("manual", "Manual", "Use the factor f0 below")),
        "auto",
    )  # fmt: skip
    scale: _number("f0", "Perceived friction for a slope of 1 along the movement ([S4] eq. 5)", 100.0, 0.0, 1e9,
                   soft_max=1000.0)  # fmt: skip
    carrier: _number("Carrier", "Carrier frequency of the electrovibration voltage", 60.0, 1.0, 20_000.0,
                     soft_max=500.0, unit="FREQUENCY")  # fmt: skip
    direction_window: _number("Direction Window", "Length of the moving average that gives the finger's direction",
                              0.05, 0.0, 10.0, soft_max=0.5, unit="TIME_ABSOLUTE", precision=3)  # fmt: skip
    threshold: _number("Threshold", "Rectangle profile: part of the map's height above which friction is on", 0.5,
                       0.0, 1.0, subtype="FACTOR")  # fmt: skip

    pin_method: _choice(
        "Method", "How pin forces are found from what the skin shall feel ([S1])",
        (("DM2", "Deformation, Optimal (DM2)", "The pins' forces whose effect on the skin is nearest to the target's, "
          "within what a pin can do"),
         ("DM1", "Deformation, Clamped (DM1)", "As DM0, then every force moved into its range: for comparison"),
         ("DM0", "Deformation, Free (DM0)", "Pins that could pull as well as push: for comparison"),
         ("FM2", "Force, Optimal (FM2)", "The pins' forces nearest to the target's forces, within what a pin can do"),
         ("FM1", "Force, Clamped (FM1)", "As FM0, then every force moved into its range: the usual way"),
         ("FM0", "Force, Free (FM0)", "Pins that could pull as well as push: for comparison")),
        "DM2",
    )  # fmt: skip
    pin_nodes: _choice(
        "Compare", "Where the skin's deformation is compared with the target's",
        (("all", "All Tissue", "Every node of the mesh that can move, as in the paper"),
         ("surface", "Surface", "The surface of the skin"),
         ("receptor", "Receptor Depth", "0.3 to 2.0 mm below the pad, where receptors are")),
        "all",
    )  # fmt: skip
    pin_bounded: BoolProperty(
        name="Force Limit", description="Solve within the force that a pin can give; without it as the paper does, and "
        "what is too much is cut off afterwards", default=True, options=set(), update=_touched, override=OVERRIDE,
    )  # fmt: skip
    pin_lead: BoolProperty(
        name="Lead by Delay", description="Let the track run ahead by the device's control delay, so that pins press "
        "when the touch is seen", default=True, options=set(), update=_touched, override=OVERRIDE,
    )  # fmt: skip
    pin_fade_in: _number("Fade In", "Time in which the pins' forces come up at the start of the track", 0.1, 0.0, 60.0,
                         soft_max=2.0, unit="TIME_ABSOLUTE", precision=3, options=set())  # fmt: skip
    pin_fade_out: _number("Fade Out", "Time in which the pins' forces go down at the end of the track", 0.1, 0.0, 60.0,
                          soft_max=2.0, unit="TIME_ABSOLUTE", precision=3, options=set())  # fmt: skip


class DermisFinger(bpy.types.PropertyGroup):
    """A fingertip: origin at the pad's centre, +Y towards the tip, +Z towards the nail."""

    touch_distance_mm: _millimetres(
        "Touch Gap", "The pad counts as touching where a surface is at most this far from its centre", 0.5,
        0.0, 1000.0, soft_max=5.0,
    )  # fmt: skip
    pattern: _choice(
        "Pattern", "A cue of the finger's own, played on the tactor",
        (("none", "None", "No pattern"),
         ("orientation", "Orientation", "The tactor rubs along a line ([S3] eq. 7)"),
         ("direction", "Direction", "The tactor moves out along a direction and comes back ([S3] eq. 8)")),
        "none",
    )  # fmt: skip
    pattern_play: _switch("Play", "Key this on to start the pattern: every change from off to on starts it", False)
    pattern_angle: _number("Angle", "Direction of the pattern in the pad's plane, clockwise as in the paper", 0.0,
                           -1e4, 1e4, soft_min=-6.2832, soft_max=6.2832, subtype="ANGLE")  # fmt: skip
    pattern_frequency: _number("Frequency", "Repetitions a second", 2.0, 0.01, 500.0, soft_max=20.0,
                               unit="FREQUENCY")  # fmt: skip
    pattern_amplitude: _number("Amplitude", "Part of the device's range", 1.0, 0.0, 1.0, subtype="FACTOR")
    pattern_repeat: _switch("Repeat", "Go on while Play is on, instead of playing once", False)
    skin: PointerProperty(type=DermisSkin, override=OVERRIDE)
    devices: CollectionProperty(type=DermisDevice, override={"LIBRARY_OVERRIDABLE", "USE_INSERTION"})
    active_device: IntProperty(name="Active Device", default=0, min=0, options=set(), override=OVERRIDE)


class DermisMaterial(bpy.types.PropertyGroup):
    """Haptic material and behaviour of something that can be touched."""

    preset: StringProperty(
        name="Preset", description="The preset that the values below were last taken from", search=_material_keys,
        options=set(), override=OVERRIDE,
    )  # fmt: skip
    friction: _number("Friction", "Coefficient of friction between skin and surface", 0.6, 0.0, 10.0, soft_max=2.0)
    surface_stiffness_mpa_m: _number(
        "Surface Stiffness [kPa/mm]", "How hard the object's own surface is to press in, for skin: pressure for each "
        "millimetre that it yields; 0 is rigid. Skin itself has about 17", 0.0, 0.0, 1e9, soft_max=200.0, precision=1,
    )  # fmt: skip
    mass: _number("Mass [kg]", "Mass of the object, for weight and inertia", 0.05, 0.0, 1e6, soft_max=2.0,
                  precision=3)  # fmt: skip

    transient_on: _switch("Contact Transient", "A decaying vibration on making contact ([S3] eq. 1)", True)
    transient_amplitude: _number("Amplitude [s/m]", "Part of the device's range for each m/s of impact speed", 3.0,
                                 0.0, 1e4, soft_max=20.0)  # fmt: skip
    transient_decay: _number("Decay [1/s]", "How fast the vibration dies: higher for stiff materials", 60.0, 0.0, 1e5,
                             soft_max=200.0, precision=1)  # fmt: skip
    transient_frequency: _number("Frequency", "Frequency of the vibration: higher for stiff materials", 100.0, 0.1,
                                 2000.0, soft_max=500.0, unit="FREQUENCY")  # fmt: skip

    texture_on: _switch("Texture", "A vibration that follows the finger's path over the surface ([S3] eq. 2)", False)
    texture_amplitude_x: _number("Amplitude X", "Part of the device's range, for movement along the object's X", 0.4,
                                 0.0, 1.0, subtype="FACTOR")  # fmt: skip
    texture_amplitude_y: _number("Amplitude Y", "Part of the device's range, for movement along the object's Y", 0.4,
                                 0.0, 1.0, subtype="FACTOR")  # fmt: skip
    texture_period_x_mm: _millimetres("Period X", "Spatial period of the texture along the object's X", 4.0, 1e-3, 1e6,
                                      soft_min=0.1, soft_max=50.0)  # fmt: skip
    texture_period_y_mm: _millimetres("Period Y", "Spatial period of the texture along the object's Y", 4.0, 1e-3, 1e6,
                                      soft_min=0.1, soft_max=50.0)  # fmt: skip
    texture_speed_threshold_mm_s: _number(
        "Threshold [mm/s]", "Below this speed the last direction of movement is held ([S3] eq. 3)", 5.0, 0.0, 1e6,
        soft_max=100.0,
    )  # fmt: skip

    weight_on: _switch("Weight", "Weight and inertia while the object is held ([S3] eq. 4)", False)
    weight_acceleration: _number(
        "Acceleration [s²/m]", "Part of the device's range for each m/s² of acceleration", 0.05, 0.0, 1e4,
        soft_max=10.0, precision=3,
    )  # fmt: skip
    weight_gravity: _number("Gravity [s²/m]", "Part of the device's range for each m/s² of gravity: 0.1 uses 98 %",
                            0.05, 0.0, 1e4, soft_max=0.1, precision=3)  # fmt: skip

    content_on: _switch("Content", "Something that moves inside while the object is held ([S3] eq. 5)", False)
    content_kind: _choice(
        "Content", "What is inside",
        (("child", "Child Objects", "The touchable objects parented to this one"),
         ("pendulum", "Pendulum", "A body that hangs from the object's origin"),
         ("slosh", "Slosh", "A liquid that swings along the horizontal plane"),
         ("loose", "Loose Body", "A body that slides and bounces between walls")),
        "child",
    )  # fmt: skip
    content_amplitude: _number("Amplitude [1/m]", "Part of the device's range for each metre of the content's offset",
                               10.0, 0.0, 1e5, soft_max=100.0)  # fmt: skip
    content_length_mm: _millimetres("Length", "Length of the pendulum, or of the pendulum that sloshes alike", 30.0,
                                    0.1, 1e6, soft_max=300.0)  # fmt: skip
    content_size_mm: _millimetres("Room", "Half the size of the room in which the content moves", 20.0, 0.1, 1e6,
                                  soft_max=300.0)  # fmt: skip
    content_damping: _number("Damping", "Damping ratio; a loose body bounces back with 1 - damping of its speed", 0.1,
                             0.0, 1.0, subtype="FACTOR")  # fmt: skip

    held_mode: _choice(
        "Held", "When the object counts as held, which weight and content need",
        (("auto", "By Opposed Fingers", "While two fingers touch it from opposite sides"),
         ("keyed", "Keyframed", "While the switch below is on"),
         ("never", "Never", "It is never held")),
        "auto",
    )  # fmt: skip
    held: _switch("Held Now", "The object is held; key it on and off", False)


class DermisScreen(bpy.types.PropertyGroup):
    """A touch screen in the object's own XY plane, +Z towards the viewer; its size is that of the object's mesh."""

    source: _choice(
        "Relief", "Where the relief that the finger shall feel comes from",
        (("IMAGE", "Image", "An image of this file; white is high", "IMAGE_DATA", 0),
         ("FILE", "Image File", "A height or depth map from disk", "FILE_IMAGE", 1),
         ("SEQUENCE", "Image Sequence", "Numbered files, one a frame", "RENDER_ANIMATION", 2),
         ("MESH", "Mesh", "Ray-cast from any object that lies on the screen", "MESH_DATA", 3)),
        "IMAGE",
    )  # fmt: skip
    image: PointerProperty(
        name="Image", description="The relief, brighter is higher", type=bpy.types.Image, update=_touched,
        override=OVERRIDE,
    )  # fmt: skip
    filepath: StringProperty(
        name="File", description="Height map; of a sequence the first file", subtype="FILE_PATH", options=set(),
        update=_touched, override=OVERRIDE,
    )  # fmt: skip
    sequence_start: IntProperty(
        name="Start Frame", description="Scene frame that shows the sequence's first file", default=1, options=set(),
        update=_touched, override=OVERRIDE,
    )  # fmt: skip
    mesh_object: PointerProperty(
        name="Mesh", description="The object whose relief is cast onto the screen", type=bpy.types.Object,
        poll=_is_mesh, update=_touched, override=OVERRIDE,
    )  # fmt: skip
    invert: _switch("Depth Map", "The image holds depth, not height: brighter is farther away", False)
    height_mm: _millimetres("Height", "How high white stands above black", 2.0, 0.0, 1e6, soft_max=20.0)
    resolution: IntProperty(
        name="Resolution", description="Points along the longer side when a mesh is cast onto the screen",
        default=256, min=2, max=8192, soft_max=1024, options=set(), update=_touched, override=OVERRIDE,
    )  # fmt: skip
    touch_distance_mm: _millimetres("Touch Gap", "The finger counts as touching up to this far above the screen", 1.0,
                                    0.0, 1000.0, soft_max=10.0)  # fmt: skip


class DermisObject(bpy.types.PropertyGroup):
    """What an object is to Dermis."""

    role: _choice(
        "Role", "What this object is to Dermis",
        (("NONE", "Nothing", "Dermis ignores this object"),
         ("FINGER", "Finger", "A fingertip that feels"),
         ("TOUCHABLE", "Touchable", "An object that fingers can feel"),
         ("SCREEN", "Touch Screen", "A touch screen that renders friction")),
        "NONE",
    )  # fmt: skip
    finger: PointerProperty(type=DermisFinger, override=OVERRIDE)
    material: PointerProperty(type=DermisMaterial, override=OVERRIDE)
    screen: PointerProperty(type=DermisScreen, override=OVERRIDE)


class DermisScene(bpy.types.PropertyGroup):
    """Settings of the whole scene."""

    # 0: no Dermis yet. Blender does not store values that equal the default, so that must not be the version.
    file_version: IntProperty(default=0, options={"HIDDEN"})
    sample_rate: FloatProperty(
        name="Sampling", description="Samples a second of the sweep over the animation, whatever the frame rate",
        default=240.0, min=1.0, max=10_000.0, soft_min=60.0, soft_max=1000.0, unit="FREQUENCY", options=set(),
        update=_touched,
    )  # fmt: skip
    use_range: BoolProperty(
        name="Own Range", description="Bake another range than the scene's frame range", default=False, options=set(),
        update=_touched,
    )  # fmt: skip
    frame_start: IntProperty(
        name="Start", description="First frame to bake", default=1, options=set(), update=_touched
    )
    frame_end: IntProperty(name="End", description="Last frame to bake", default=250, options=set(), update=_touched)
    output_dir: StringProperty(
        name="Output", description="Folder for exported tracks", default="//tracks/", subtype="DIR_PATH", options=set()
    )
    plots: BoolProperty(
        name="With Plots", description="Write a PNG plot beside each exported track", default=False, options=set()
    )
    skin_view: PointerProperty(type=DermisSkinView)
    live_preview: BoolProperty(
        name="Live Preview", description="Evaluate the current frame while you scrub, where no fresh bake covers it",
        default=True, options=set(),
    )  # fmt: skip
    show_twin: BoolProperty(
        name="Device Twin", description="Draw the device on the finger, moving as it will", default=True, options=set()
    )
    show_readout: BoolProperty(
        name="Readout", description="Write the devices' values into the view", default=True, options=set()
    )
    twin_exaggeration: FloatProperty(
        name="Exaggeration", description="Draw the tactor's movement this many times as large as it is", default=1.0,
        min=0.1, max=100.0, soft_min=1.0, soft_max=10.0, precision=1, options=set(),
    )  # fmt: skip
    bake_key: StringProperty(description="Which stored result the last bake gave", options={"HIDDEN"})
    active_finding: IntProperty(default=-1, options={"HIDDEN"})


def _attributes(group: Any, *leave_out: str) -> tuple[Attribute, ...]:
    found = []
    for name in group.__annotations__:
        if name in leave_out:
            continue
        suffix = next((s for s in FACTORS if name.endswith(s)), "")
        found.append(Attribute(name, name.removesuffix(suffix), FACTORS.get(suffix, 1.0)))
    return tuple(found)


ATTRIBUTES: dict[type, tuple[Attribute, ...]] = {
    DermisDevice: _attributes(DermisDevice, "preset", "enabled", "screen"),
    DermisFinger: _attributes(DermisFinger, "skin", "devices", "active_device"),
    DermisMaterial: _attributes(DermisMaterial, "preset"),
    DermisScreen: _attributes(
        DermisScreen, "source", "image", "filepath", "sequence_start", "mesh_object", "invert", "resolution"
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

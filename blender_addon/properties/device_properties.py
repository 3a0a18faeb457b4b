"""What the artist sets of a device."""

# mypy: disable-error-code="valid-type"
# No postponed annotations here: Blender reads the properties from them when a class is registered.

from typing import Any

import bpy
from bpy.props import BoolProperty, IntProperty, PointerProperty, StringProperty

from .. import choices
from ..compat import BLEND_RELATIVE
from .fields import OVERRIDE, choice, millimetres, number, switch, touched


def _is_screen(_self: Any, obj: bpy.types.Object) -> bool:
    return obj.dermis.role == "SCREEN"


def _device_keys(_self: Any, _context: Any, text: str) -> list[str]:
    return [entry.key for entry in choices.devices() if text.lower() in f"{entry.key} {entry.name}".lower()]


def _felt(servo: int) -> Any:
    return number(
        f"Servo {servo}",
        "Angle of this servo from neutral at which the person first feels the disc",
        0.0,
        -3.15,
        3.15,
        soft_min=-0.698,
        soft_max=0.698,
        subtype="ANGLE",
        options=set(),
    )


class DermisDevice(bpy.types.PropertyGroup):
    """One device worn by a finger, or one screen device that it touches."""

    preset: StringProperty(
        name="Device",
        description="Device preset, by its file name",
        search=_device_keys,
        options=set(),
        update=touched,
        override=OVERRIDE,
    )
    enabled: BoolProperty(
        name="Enabled",
        description="Bake a track for this device",
        default=True,
        options=set(),
        update=touched,
        override=OVERRIDE,
    )

    use_transient: switch("Contact Transient", "Render the vibration of making contact ([S3] eq. 1)", True)
    use_texture: switch("Texture", "Render the texture of what the finger slides over ([S3] eq. 2 and 3)", True)
    use_weight: switch("Weight", "Render weight and inertia of a held object ([S3] eq. 4)", True)
    use_content: switch("Content", "Render what moves inside a held object ([S3] eq. 5)", True)
    use_pattern: switch("Pattern", "Render the finger's own pattern, a cue for direction ([S3] eq. 7 and 8)", True)
    projection: choice(
        "Projection",
        "How a displacement in space becomes one in the tactor's plane ([S3] eq. 6)",
        (
            ("magnitude", "Keep Magnitude", "The length is min(1, |P inv(T) d|), the direction that of P inv(T) d"),
            ("printed", "As Printed", "The formula as the paper prints it, which weakens tilted vectors twice"),
        ),
        "magnitude",
    )
    transient_axis: choice(
        "Transient Axis",
        "Where the part of an impact that points into the pad goes, which a 2D tactor cannot show",
        (
            ("tilted", "Turned to the Pad", "Turn the normal part to the pad axis that the device preset declares"),
            ("printed", "As Printed", "Drop it, as the printed formula does"),
        ),
        "tilted",
    )
    weight_sign: choice(
        "Inertia Sign",
        "Sign of the acceleration term of weight ([S3] eq. 4)",
        (
            ("paper", "As in the Paper", "The tactor moves with the acceleration"),
            ("inertia", "Inertia", "The tactor drags behind the acceleration, as a real mass would"),
        ),
        "paper",
    )
    auto_range: switch(
        "Auto Range",
        "Scale weights so that the scene's heaviest just uses the whole range and "
        "lighter ones stay apart; without it strong accelerations saturate",
        False,
        options=set(),
    )

    screen: PointerProperty(
        name="Screen",
        description="The touch screen that this finger touches; empty: every screen in the scene",
        type=bpy.types.Object,
        poll=_is_screen,
        update=touched,
        override=OVERRIDE,
    )
    relief: choice(
        "Relief",
        "Where the slope under the finger is read ([S4])",
        (
            (
                "map",
                "Screen's Map",
                "The relief that the touch screen was given: an image, or a mesh cast onto it once ([S4] eq. 3)",
            ),
            (
                "mesh",
                "Mesh",
                "The surface of the touchable object under the finger itself, which may move and deform; "
                "profile Slope only ([S4] eq. 6)",
            ),
        ),
        "map",
    )
    relief_formula: choice(
        "Formula",
        "How the normal of a mesh becomes friction ([S4] eq. 6)",
        (
            ("slope", "Equal to the Map", "-f0 n_xy . v / n_z, the slope of the surface: what a map of it would give"),
            (
                "printed",
                "As Printed",
                "f0 n . [v, 0], the formula as the paper prints it: its sign is opposite, downhill "
                "resists, and steep slopes are compressed",
            ),
        ),
        "slope",
    )
    profile: choice(
        "Profile",
        "What of the relief becomes friction ([S4])",
        (
            ("slope", "Slope", "Friction follows the slope along the movement: the gradient method"),
            ("height", "Height", "Friction follows the height under the finger"),
            ("rectangle", "Rectangle", "Full friction wherever the height is above the threshold"),
        ),
        "slope",
    )
    downhill: choice(
        "Downhill",
        "What to do where the slope along the movement is negative: friction cannot be",
        (
            ("rectify", "Rectify", "No extra friction downhill"),
            ("offset", "Offset", "Flat ground at mid range, less friction downhill"),
            ("absolute", "Absolute", "Friction of the steepness, uphill or down"),
        ),
        "rectify",
    )
    scale_mode: choice(
        "Scale",
        "How slope becomes perceived friction",
        (
            ("auto", "Automatic", "The steepest slope of the whole bake becomes friction 100"),
            ("manual", "Manual", "Use the factor f0 below"),
        ),
        "auto",
    )
    scale: number(
        "f0", "Perceived friction for a slope of 1 along the movement ([S4] eq. 5)", 100.0, 0.0, 1e9, soft_max=1000.0
    )
    carrier: number(
        "Carrier",
        "Carrier frequency of the electrovibration voltage",
        60.0,
        1.0,
        20_000.0,
        soft_max=500.0,
        unit="FREQUENCY",
    )
    direction_window: number(
        "Direction Window",
        "Length of the moving average that gives the finger's direction",
        0.05,
        0.0,
        10.0,
        soft_max=0.5,
        unit="TIME_ABSOLUTE",
        precision=3,
        options=set(),
    )
    threshold: number(
        "Threshold",
        "Rectangle profile: part of the map's height above which friction is on",
        0.5,
        0.0,
        1.0,
        subtype="FACTOR",
    )

    pin_method: choice(
        "Method",
        "How pin forces are found from what the skin shall feel ([S1])",
        (
            (
                "DM2",
                "Deformation, Optimal (DM2)",
                "The pins' forces whose effect on the skin is nearest to the target's, within what a pin can do",
            ),
            ("DM1", "Deformation, Clamped (DM1)", "As DM0, then every force moved into its range: for comparison"),
            ("DM0", "Deformation, Free (DM0)", "Pins that could pull as well as push: for comparison"),
            (
                "FM2",
                "Force, Optimal (FM2)",
                "The pins' forces nearest to the target's forces, within what a pin can do",
            ),
            ("FM1", "Force, Clamped (FM1)", "As FM0, then every force moved into its range: the usual way"),
            ("FM0", "Force, Free (FM0)", "Pins that could pull as well as push: for comparison"),
        ),
        "DM2",
    )
    pin_nodes: choice(
        "Compare",
        "Where the skin's deformation is compared with the target's",
        (
            ("all", "All Tissue", "Every node of the mesh that can move, as in the paper"),
            ("surface", "Surface", "The surface of the skin"),
            ("receptor", "Receptor Depth", "0.3 to 2.0 mm below the pad, where receptors are"),
        ),
        "all",
    )
    pin_bounded: BoolProperty(
        name="Force Limit",
        description="Solve within the force that a pin can give; without it as the paper does, and "
        "what is too much is cut off afterwards",
        default=True,
        options=set(),
        update=touched,
        override=OVERRIDE,
    )
    pin_lead: BoolProperty(
        name="Lead by Delay",
        description="Let the track run ahead by the device's control delay, so that pins press when the touch is seen",
        default=True,
        options=set(),
        update=touched,
        override=OVERRIDE,
    )
    pin_fade_in: number(
        "Fade In",
        "Time in which the pins' forces come up at the start of the track",
        0.1,
        0.0,
        60.0,
        soft_max=2.0,
        unit="TIME_ABSOLUTE",
        precision=3,
        options=set(),
    )
    pin_fade_out: number(
        "Fade Out",
        "Time in which the pins' forces go down at the end of the track",
        0.1,
        0.0,
        60.0,
        soft_max=2.0,
        unit="TIME_ABSOLUTE",
        precision=3,
        options=set(),
    )

    table: StringProperty(
        name="Table",
        description="A collected look-up table of this platform (.npz); empty: one is swept for this "
        "finger's skin and kept",
        subtype="FILE_PATH",
        options=BLEND_RELATIVE,
        update=touched,
        override=OVERRIDE,
    )
    table_rows: IntProperty(
        name="Configurations",
        description="How many configurations of the platform are swept for its table: more are "
        "finer and take longer, some 2000 a second",
        default=3375,
        min=8,
        max=2_000_000,
        soft_min=512,
        soft_max=30_000,
        options=set(),
        update=touched,
        override=OVERRIDE,
    )

    thimble_method: choice(
        "Method",
        "How the disc's pose is found from what the skin shall feel ([S0])",
        (
            (
                "stress",
                "Stress, Direct",
                "The pose whose stress in the skin is nearest to the target's; the contact is "
                "solved for every pose that is tried",
            ),
            (
                "network",
                "Stress, Network",
                "The same with a small network in place of the contact; needs an adaptation to this finger",
            ),
            (
                "ridge",
                "Stress, Polynomial",
                "The same with a quadratic polynomial (ridge); needs an adaptation to this finger",
            ),
            ("force", "Force Only", "Only the total force is compared: the paper's first rival, for comparison"),
            (
                "geometry",
                "Geometry Only",
                "The disc's plane is laid on the contact: the paper's second rival, for comparison",
            ),
        ),
        "stress",
    )
    thimble_surrogate: StringProperty(
        name="Surrogate",
        description="File of an adaptation (.npz, with its .onnx beside it); empty: the one that "
        "Adapt to This Finger made",
        subtype="FILE_PATH",
        options=BLEND_RELATIVE,
        update=touched,
        override=OVERRIDE,
    )
    thimble_hover_mm: millimetres(
        "Hover", "Distance between disc and skin while nothing is touched", 0.4, 0.01, 5.0, soft_max=2.0, options=set()
    )
    thimble_calibrated: BoolProperty(
        name="Calibrated",
        description="Mount the device as it sits on this person: the servo angles below are those "
        "at which the disc is first felt",
        default=False,
        options=set(),
        update=touched,
        override=OVERRIDE,
    )
    thimble_felt_1: _felt(1)
    thimble_felt_2: _felt(2)
    thimble_felt_3: _felt(3)

"""What a device is told on a finger, besides its preset: the parameters of a `DeviceUse`.

Which kinds of device read which of them says `devices/kinds.py`.
"""

from __future__ import annotations

from .parameter import SWITCH, TEXT, Parameter, Table, table


def _effect(name: str, label: str, text: str, source: str) -> Parameter:
    return Parameter(name=f"use_{name}", unit=SWITCH, label=label, text=text, source=source, default=True, keyed=True)


def _fade(name: str, label: str, text: str) -> Parameter:
    return Parameter(
        name=name, unit="s", label=label, text=text, default=0.1, low=0.0, high=60.0, soft=(None, 2.0), digits=3
    )


def _first_contact(servo: int) -> Parameter:
    return Parameter(
        name=f"thimble_felt_{servo}",
        unit="rad",
        label=f"Servo {servo}",
        text="Angle of this servo from neutral at which the person first feels the disc",
        default=0.0,
        low=-3.15,
        high=3.15,
        soft=(-0.698, 0.698),
        note="must lie within the servo's range, which the preset says",
    )


_TACTOR = table(
    _effect("transient", "Contact Transient", "Render the vibration of making contact", "[S3] eq. 1"),
    _effect("texture", "Texture", "Render the texture of what the finger slides over", "[S3] eq. 2 and 3"),
    _effect("weight", "Weight", "Render weight and inertia of a held object", "[S3] eq. 4"),
    _effect("content", "Content", "Render what moves inside a held object", "[S3] eq. 5"),
    _effect("pattern", "Pattern", "Render the finger's own pattern, a cue for direction", "[S3] eq. 7 and 8"),
    Parameter(
        name="projection",
        unit=TEXT,
        label="Projection",
        text="How a displacement in space becomes one in the tactor's plane",
        source="[S3] eq. 6",
        default="magnitude",
        choices=(
            ("magnitude", "Keep Magnitude", "The length is min(1, |P inv(T) d|), the direction that of P inv(T) d"),
            ("printed", "As Printed", "The formula as the paper prints it, which weakens tilted vectors twice"),
        ),
    ),
    Parameter(
        name="transient_axis",
        unit=TEXT,
        label="Transient Axis",
        text="Where the part of an impact that points into the pad goes, which a 2D tactor cannot show",
        default="tilted",
        choices=(
            ("tilted", "Turned to the Pad", "Turn the normal part to the pad axis that the device preset declares"),
            ("printed", "As Printed", "Drop it, as the printed formula does"),
        ),
    ),
    Parameter(
        name="weight_sign",
        unit=TEXT,
        label="Inertia Sign",
        text="Sign of the acceleration term of weight",
        source="[S3] eq. 4",
        default="paper",
        choices=(
            ("paper", "As in the Paper", "The tactor moves with the acceleration"),
            ("inertia", "Inertia", "The tactor drags behind the acceleration, as a real mass would"),
        ),
    ),
    Parameter(
        name="auto_range",
        unit=SWITCH,
        label="Auto Range",
        text="Scale weights so that the scene's heaviest just uses the whole range and "
        "lighter ones stay apart; without it strong accelerations saturate",
        default=False,
    ),
)

_FRICTION_SCREEN = table(
    Parameter(
        name="relief",
        unit=TEXT,
        label="Relief",
        text="Where the slope under the finger is read",
        source="[S4]",
        default="map",
        choices=(
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
    ),
    Parameter(
        name="relief_formula",
        unit=TEXT,
        label="Formula",
        text="How the normal of a mesh becomes friction",
        source="[S4] eq. 6",
        default="slope",
        choices=(
            ("slope", "Equal to the Map", "-f0 n_xy . v / n_z, the slope of the surface: what a map of it would give"),
            (
                "printed",
                "As Printed",
                "f0 n . [v, 0], the formula as the paper prints it: its sign is opposite, downhill "
                "resists, and steep slopes are compressed",
            ),
        ),
    ),
    Parameter(
        name="profile",
        unit=TEXT,
        label="Profile",
        text="What of the relief becomes friction",
        source="[S4]",
        default="slope",
        choices=(
            ("slope", "Slope", "Friction follows the slope along the movement: the gradient method"),
            ("height", "Height", "Friction follows the height under the finger"),
            ("rectangle", "Rectangle", "Full friction wherever the height is above the threshold"),
        ),
    ),
    Parameter(
        name="downhill",
        unit=TEXT,
        label="Downhill",
        text="What to do where the slope along the movement is negative: friction cannot be",
        default="rectify",
        choices=(
            ("rectify", "Rectify", "No extra friction downhill"),
            ("offset", "Offset", "Flat ground at mid range, less friction downhill"),
            ("absolute", "Absolute", "Friction of the steepness, uphill or down"),
        ),
    ),
    Parameter(
        name="scale_mode",
        unit=TEXT,
        label="Scale",
        text="How slope becomes perceived friction",
        default="auto",
        choices=(
            ("auto", "Automatic", "The steepest slope of the whole bake becomes friction 100"),
            ("manual", "Manual", "Use the factor f0 below"),
        ),
    ),
    Parameter(
        name="scale",
        unit="1",
        label="f0",
        text="Perceived friction for a slope of 1 along the movement",
        source="[S4] eq. 5",
        default=100.0,
        absent=0.0,
        low=0.0,
        high=1e9,
        soft=(None, 1000.0),
        keyed=True,
        note="scale_mode 'manual' asks for one above 0",
    ),
    Parameter(
        name="carrier",
        unit="Hz",
        label="Carrier",
        text="Carrier frequency of the electrovibration voltage",
        default=60.0,
        absent=None,
        low=1.0,
        high=20_000.0,
        soft=(None, 500.0),
        keyed=True,
        note="the rest of the preset's channel 'carrier' where nobody says; outside the preset's range is reported",
    ),
    Parameter(
        name="direction_window",
        unit="s",
        label="Direction Window",
        text="Length of the moving average that gives the finger's direction",
        default=0.05,
        absent=0.02,
        low=0.0,
        high=10.0,
        soft=(None, 0.5),
        digits=3,
        note="scripts sample paths that are exact; what people animate is smoothed longer",
    ),
    Parameter(
        name="threshold",
        unit="1",
        label="Threshold",
        text="Rectangle profile: part of the map's height above which friction is on",
        default=0.5,
        low=0.0,
        high=1.0,
        keyed=True,
    ),
)

_PINS = table(
    Parameter(
        name="pin_method",
        unit=TEXT,
        label="Method",
        text="How pin forces are found from what the skin shall feel",
        source="[S1]",
        default="DM2",
        choices=(
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
    ),
    Parameter(
        name="pin_nodes",
        unit=TEXT,
        label="Compare",
        text="Where the skin's deformation is compared with the target's",
        default="all",
        choices=(
            ("all", "All Tissue", "Every node of the mesh that can move, as in the paper"),
            ("surface", "Surface", "The surface of the skin"),
            ("receptor", "Receptor Depth", "0.3 to 2.0 mm below the pad, where receptors are"),
        ),
    ),
    Parameter(
        name="pin_bounded",
        unit=SWITCH,
        label="Force Limit",
        text="Solve within the force that a pin can give; without it as the paper does, and "
        "what is too much is cut off afterwards",
        default=True,
    ),
    Parameter(
        name="pin_lead",
        unit=SWITCH,
        label="Lead by Delay",
        text="Let the track run ahead by the device's control delay, so that pins press when the touch is seen",
        default=True,
    ),
    _fade("pin_fade_in", "Fade In", "Time in which the pins' forces come up at the start of the track"),
    _fade("pin_fade_out", "Fade Out", "Time in which the pins' forces go down at the end of the track"),
)

_PLATFORM = table(
    Parameter(
        name="table",
        unit=TEXT,
        label="Table",
        text="A collected look-up table of this platform (.npz); empty: one is swept for this finger's skin and kept",
        default="",
        file=True,
    ),
    Parameter(
        name="table_rows",
        unit="1",
        label="Configurations",
        text="How many configurations of the platform are swept for its table: more are "
        "finer and take longer, some 2000 a second",
        default=3375,
        low=8,
        high=2_000_000,
        whole=True,
        soft=(512, 30_000),
    ),
)

_THIMBLE = table(
    Parameter(
        name="thimble_method",
        unit=TEXT,
        label="Method",
        text="How the disc's pose is found from what the skin shall feel",
        source="[S0]",
        default="stress",
        choices=(
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
    ),
    Parameter(
        name="thimble_surrogate",
        unit=TEXT,
        label="Surrogate",
        text="File of an adaptation (.npz, with its .onnx beside it); empty: the one that Adapt to This Finger made",
        default="",
        file=True,
    ),
    Parameter(
        name="thimble_hover",
        unit="m",
        label="Hover",
        text="Distance between disc and skin while nothing is touched",
        default=0.4e-3,
        low=0.01e-3,
        high=5e-3,
        saved="thimble_hover_mm",
        shown="mm",
        soft=(None, 2e-3),
        digits=3,
        note="more would be out of reach of most mechanisms",
    ),
    Parameter(
        name="thimble_calibrated",
        unit=SWITCH,
        label="Calibrated",
        text="Mount the device as it sits on this person: the servo angles below are those "
        "at which the disc is first felt",
        default=False,
    ),
    _first_contact(1),
    _first_contact(2),
    _first_contact(3),
)

DEVICE: Table = {**_TACTOR, **_FRICTION_SCREEN, **_PINS, **_PLATFORM, **_THIMBLE}

"""Settings of a device on a finger: the parameters of a `DeviceUse`.

The preset of the device has parameters of its own. `devices/kinds.py` states which settings each kind of device uses.
"""

from __future__ import annotations

from .parameter import SWITCH, TEXT, Parameter, Table, table
from .skin_devices import PINS, PLATFORM, THIMBLE


def _effect(name: str, label: str, text: str, source: str) -> Parameter:
    return Parameter(name=name, unit=SWITCH, label=label, text=text, source=source, default=True, keyed=True)


_TACTOR = table(
    _effect("use_transient", "Contact Transient", "Render the vibration at first contact", "[S3] eq. 1"),
    _effect("use_texture", "Texture", "Render the texture of the surface under the finger", "[S3] eq. 2 and 3"),
    _effect("use_weight", "Weight", "Render weight and inertia of a held object", "[S3] eq. 4"),
    _effect("use_content", "Content", "Render the moving contents of a held object", "[S3] eq. 5"),
    _effect("use_pattern", "Pattern", "Render the finger's direction pattern", "[S3] eq. 7 and 8"),
    Parameter(
        name="projection",
        unit=TEXT,
        label="Projection",
        text="Projection of a displacement in space onto the tactor's plane",
        source="[S3] eq. 6",
        default="magnitude",
        choices=(
            ("magnitude", "Keep Magnitude", "The length is min(1, |P inv(T) d|), the direction that of P inv(T) d"),
            ("printed", "As Printed", "The formula as printed in the paper; it shortens tilted vectors twice"),
        ),
    ),
    Parameter(
        name="transient_axis",
        unit=TEXT,
        label="Transient Axis",
        text="Direction in which a 2D tactor renders the normal part of an impact",
        default="tilted",
        choices=(
            ("tilted", "Turned to the Pad", "Turn the normal part to the pad axis that the device preset declares"),
            ("printed", "As Printed", "Leave it out, as the printed formula does"),
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
        text="Scale weights so that the heaviest of the scene uses the whole range and lighter ones remain "
        "distinct. If off, strong accelerations saturate",
        default=False,
    ),
)

_FRICTION_SCREEN = table(
    Parameter(
        name="relief",
        unit=TEXT,
        label="Relief",
        text="Source of the slope under the finger",
        source="[S4]",
        default="map",
        choices=(
            (
                "map",
                "Screen's Map",
                "The relief of the touch screen: an image, or a mesh cast onto the screen once ([S4] eq. 3)",
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
        text="Formula that converts the normal of a mesh to friction",
        source="[S4] eq. 6",
        default="slope",
        choices=(
            ("slope", "Equal to the Map", "-f0 n_xy . v / n_z, the slope of the surface, as a map of it would give"),
            (
                "printed",
                "As Printed",
                "f0 n . [v, 0], the formula as printed in the paper: friction rises downhill, and steep slopes are "
                "compressed",
            ),
        ),
    ),
    Parameter(
        name="profile",
        unit=TEXT,
        label="Profile",
        text="Property of the relief that is rendered as friction",
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
        text="Treatment of a negative slope along the movement, because friction cannot be negative",
        default="rectify",
        choices=(
            ("rectify", "Rectify", "No extra friction downhill"),
            ("offset", "Offset", "Medium friction on flat ground, less downhill"),
            ("absolute", "Absolute", "Friction follows the absolute slope, uphill and downhill"),
        ),
    ),
    Parameter(
        name="scale_mode",
        unit=TEXT,
        label="Scale",
        text="Scale from slope to perceived friction",
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
        note="for scale_mode 'manual', it must be above 0",
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
        note="where a scene states none: the rest of the preset's channel 'carrier'; values outside the preset's "
        "range are reported",
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
        text="For the rectangle profile: share of the map's height above which friction is on",
        default=0.5,
        low=0.0,
        high=1.0,
        keyed=True,
    ),
)

DEVICE: Table = {**_TACTOR, **_FRICTION_SCREEN, **PINS, **PLATFORM, **THIMBLE}

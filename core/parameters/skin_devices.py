"""Settings of devices that follow a finger's whole skin.

These devices are pin arrays, platforms and thimbles. `device.DEVICE` includes the settings.
"""

from __future__ import annotations

from .parameter import SWITCH, TEXT, Parameter, table


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
        note="must be within the servo's range, which the preset states",
    )


PINS = table(
    Parameter(
        name="pin_method",
        unit=TEXT,
        label="Method",
        text="Method that finds pin forces for the target skin state",
        source="[S1]",
        default="DM2",
        choices=(
            (
                "DM2",
                "Deformation, Optimal (DM2)",
                "Pin forces whose deformation of the skin is nearest to the target, within the pins' limits",
            ),
            ("DM1", "Deformation, Clamped (DM1)", "As DM0; then each force is clipped to its range. For comparison"),
            ("DM0", "Deformation, Free (DM0)", "As DM2, but pins can also pull. For comparison"),
            (
                "FM2",
                "Force, Optimal (FM2)",
                "Pin forces nearest to the contact forces of the target, within the pins' limits",
            ),
            ("FM1", "Force, Clamped (FM1)", "As FM0; then each force is clipped to its range. The most common method"),
            ("FM0", "Force, Free (FM0)", "As FM2, but pins can also pull. For comparison"),
        ),
    ),
    Parameter(
        name="pin_nodes",
        unit=TEXT,
        label="Compare",
        text="Nodes at which the skin's deformation is compared with the target",
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
        text="Solve within the force limits of the pins. If off, forces are clipped to the limits afterwards, as "
        "in the paper",
        default=True,
    ),
    Parameter(
        name="pin_lead",
        unit=SWITCH,
        label="Lead by Delay",
        text="Advance the track by the device's control delay, so that pins press at the time of the visible touch",
        default=True,
    ),
    _fade("pin_fade_in", "Fade In", "Time in which the pin forces rise at the start of the track"),
    _fade("pin_fade_out", "Fade Out", "Time in which the pin forces fall at the end of the track"),
)

_METHOD_TEXTS = (
    (
        "stress",
        "Stress, Direct",
        "The pose whose stress in the skin is nearest to the target's. Contact is solved at every pose of the search",
    ),
    (
        "network",
        "Stress, Network",
        "The same with a small neural network in place of contact. Needs an adaptation to this finger",
    ),
    (
        "ridge",
        "Stress, Polynomial",
        "The same with a quadratic polynomial (ridge regression). Needs an adaptation to this finger",
    ),
    ("force", "Force Only", "Only the total force is matched: the paper's first method for comparison"),
    ("geometry", "Geometry Only", "The disc is laid on the plane of contact: the paper's second method for comparison"),
)

PLATFORM = table(
    Parameter(
        name="platform_method",
        unit=TEXT,
        label="Method",
        text="Method that finds the motors' commands for the target skin state. For six legs with one motor each, "
        "the pose can be searched as for a thimble",
        source="[S2] III; [S0] 5",
        default="lookup",
        choices=(
            ("lookup", "Look-Up Table", "The readings of a virtual sensor are looked up in a table of this platform"),
            *_METHOD_TEXTS,
        ),
    ),
    Parameter(
        name="table",
        unit=TEXT,
        label="Table",
        text="File of a collected look-up table of this platform (.npz). If empty, a table is simulated for this "
        "finger's skin and stored",
        default="",
        file=True,
    ),
    Parameter(
        name="table_rows",
        unit="1",
        label="Configurations",
        text="Number of simulated configurations in the look-up table. More make it finer and take longer: "
        "about 2000 are simulated in a second",
        default=3375,
        low=8,
        high=2_000_000,
        whole=True,
        soft=(512, 30_000),
    ),
)

THIMBLE = table(
    Parameter(
        name="thimble_method",
        unit=TEXT,
        label="Method",
        text="Method that finds the disc's pose for the target skin state",
        source="[S0]",
        default="stress",
        choices=_METHOD_TEXTS,
    ),
    Parameter(
        name="thimble_surrogate",
        unit=TEXT,
        label="Surrogate",
        text="File of an adaptation (.npz, with its .onnx beside it). If empty, the one made by Adapt to This Finger",
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
        window_unit="mm",
        soft=(None, 2e-3),
        digits=3,
        note="more would be out of reach of most mechanisms",
    ),
    Parameter(
        name="thimble_calibrated",
        unit=SWITCH,
        label="Calibrated",
        text="Find how the device sits on this person from the servo angles below, at which the person first feels the "
        "disc",
        default=False,
    ),
    _first_contact(1),
    _first_contact(2),
    _first_contact(3),
)

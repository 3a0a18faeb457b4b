"""Kinds of device, with all data needed before a mechanism is loaded.

There is one entry for each kind. An entry names the file that checks a preset and the file that renders a track. It has
the parameters of a preset, its channels, and whether a finger is inside the device. `core/README.md`, *A new device*,
lists all other places to change.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from ..parameters.material import FRICTION
from ..parameters.parameter import NAMES, TEXT, Parameter, Table, table

Drawn = Literal["", "tactor", "screen", "coil", "pins", "thimble", "platform"]


@dataclass(frozen=True, kw_only=True)
class Kind:
    """One kind of device.

    Attributes:
        mechanism: file and function in `devices/` that read a preset and raise an error for an invalid one.
        renderer: file in `matching/` whose function `render` makes the track.
        parameters: parameters of a preset.
        settings: names of the rows of `parameters/device.py` that the renderer reads.
        channels: names and units of the channels that the renderer can fill; empty if a preset may name any channels.
        count: number of channels of a preset, or the names of parameters whose product is this number; 0 for any
            number.
        worn: whether a finger is inside the device and must be released. A preset then states a safe pose.
        follows_skin: whether `render` uses the contact of the finger's whole skin, besides that of its pad.
        platform: whether the device is a platform whose motors have ranges, may be coupled, and are commanded by a
            look-up table.
        drawn: form in which Blender shows the device; empty for its name and values alone.
        sine: channels of amplitude and frequency of a sinusoid that drives the device; empty if there is none.
        wave: channel that is a voltage over time; '' if there is none.
    """

    mechanism: str
    renderer: str
    parameters: Table
    settings: tuple[str, ...]
    channels: Mapping[str, str] = field(default_factory=dict)
    count: int | tuple[str, ...] = 0
    worn: bool = True
    follows_skin: bool = False
    platform: bool = False
    drawn: Drawn = ""
    sine: tuple[str, ...] = ()
    wave: str = ""


def _size(name: str, unit: str) -> Parameter:
    return Parameter(name=name, unit=unit, required=True, above=0.0)


def _count(name: str) -> Parameter:
    return Parameter(name=name, unit="1", required=True, low=1.0, whole=True)


def _needed(name: str, unit: str, size: int | None = None) -> Parameter:
    return Parameter(name=name, unit=unit, required=True, size=size)


def _told(name: str, unit: str) -> Parameter:
    """Return a parameter that no mechanism needs, but people and senders do."""
    return Parameter(name=name, unit=unit, low=0.0)


_RANGE_DISC = (
    Parameter(name="range_disc", unit=NAMES),
    Parameter(name="range_disc_radius", unit="", above=0.0),  # in the unit of the channels that share it
)
_PLATFORM = (
    *_RANGE_DISC,
    _size("platform_radius", "m"),
    _size("base_radius", "m"),
    _size("disc_radius", "m"),
    _size("rest_distance", "m"),
    _size("base_height", "m"),
    Parameter(name="friction", unit="1", low=0.0, default=0.4, source="chosen: as of the six interactions' surface"),
    Parameter(name="knee_error", unit="1", above=0.0),
    _needed("sweep_press", "m", 2),
    _needed("sweep_tilt", "rad"),
    Parameter(name="coupling", unit="1", size=-1),
    Parameter(name="coupling_offset", unit="1", size=0),
    Parameter(name="coupling_low", unit="1", size=0),
    Parameter(name="coupling_high", unit="1", size=0),
    Parameter(name="coupling_unit", unit=TEXT),
)

KINDS: Mapping[str, Kind] = {
    "shear_tactor": Kind(
        mechanism="shear_tactor.ShearTactor.from_spec",
        renderer="shear_tactor",
        drawn="tactor",
        channels={"tactor_x": "m", "tactor_y": "m", "pulley_1": "rad", "pulley_2": "rad"},
        settings=(
            *(f"use_{effect}" for effect in ("transient", "texture", "weight", "content", "pattern")),
            *("auto_range", "projection", "transient_axis", "weight_sign"),
        ),
        parameters=table(
            *_RANGE_DISC,
            _size("link_length", "m"),
            _size("range", "m"),
            _size("max_speed", "m/s"),
            _size("torque_limit", "N*m"),
            _needed("axis_direction", "rad"),
            _needed("tap_axis", "1", 2),
            _told("force_reference", "N"),
            _told("force_anywhere", "N"),
            _told("pulley_diameter", "m"),
            _told("motor_pulley_diameter", "m"),
            _told("reduction", "1"),
            _told("hole_diameter", "m"),
            _told("cap_diameter", "m"),
            _told("cap_mass", "kg"),
            _told("device_mass", "kg"),
            _told("skin_stiffness_low", "N/m"),
            _told("skin_stiffness_high", "N/m"),
        ),
    ),
    "friction_screen": Kind(
        mechanism="friction_screen.FrictionScreen.of",
        renderer="friction_screen",
        drawn="screen",
        sine=("amplitude", "carrier"),
        worn=False,
        settings=(
            *("relief", "relief_formula", "profile", "downhill", "direction_window", "threshold"),
            *("scale_mode", "scale", "carrier"),
        ),
        parameters=table(
            *_RANGE_DISC,
            Parameter(name="law_slope", unit="1", above=0.0, default=1.24, source="[S4] eq. 1"),
            Parameter(name="law_intercept", unit="1", default=-1.05, source="[S4] eq. 1"),
            Parameter(name="law_base", unit="1", above=1.0, default=10.0),
            Parameter(name="span_factor", unit="1", low=1.0, default=3.5),
            Parameter(name="span_high", unit="V", above=0.0),
            Parameter(name="carrier_low", unit="Hz", above=0.0, default=60.0),
            Parameter(name="carrier_high", unit="Hz", above=0.0, default=200.0),
        ),
    ),
    "voice_coil": Kind(
        mechanism="voice_coil.VoiceCoil.of",
        renderer="voice_coil",
        drawn="coil",
        channels={"displacement": "m", "voltage": "V"},
        wave="voltage",
        settings=("use_transient", "use_texture"),
        parameters=table(
            *_RANGE_DISC,
            _size("range", "m"),
            Parameter(name="response_frequency", unit="Hz", required=True, size=0, above=0.0),
            Parameter(name="response_gain", unit="m/s^2/V", required=True, size=0, above=0.0),
            _told("device_mass", "kg"),
        ),
    ),
    "pin_array": Kind(
        mechanism="pin_array.layout",
        renderer="pins",
        drawn="pins",
        count=("rows", "columns"),
        follows_skin=True,
        settings=("pin_method", "pin_nodes", "pin_bounded", "pin_lead", "pin_fade_in", "pin_fade_out"),
        parameters=table(
            *_RANGE_DISC,
            _count("rows"),
            _count("columns"),
            _size("pitch", "m"),
            _size("pin_radius", "m"),
            _size("cylinder_radius", "m"),
            _size("stroke", "m"),
            _size("force_limit", "N"),
            _size("spread", "m"),
            Parameter(name="standoff", unit="m", default=0.0),
            Parameter(name="forward", unit="m", default=0.0),
            Parameter(name="mount_pitch", unit="rad", default=0.0),
            Parameter(name="delay", unit="s", low=0.0, default=0.0),
        ),
    ),
    "thimble": Kind(
        mechanism="thimble.mechanism",
        renderer="thimble",
        drawn="thimble",
        channels={**{f"servo_{servo}": "rad" for servo in (1, 2, 3)}, "pitch": "rad", "roll": "rad", "distance": "m"},
        follows_skin=True,
        settings=(
            *("thimble_method", "thimble_surrogate", "thimble_hover", "thimble_calibrated"),
            *("thimble_felt_1", "thimble_felt_2", "thimble_felt_3"),
        ),
        parameters=table(
            *_RANGE_DISC,
            _size("platform_radius", "m"),
            _size("base_radius", "m"),
            _size("crank", "m"),
            _size("rod", "m"),
            _size("disc_radius", "m"),
            _size("reference_distance", "m"),
            _size("servo_range", "rad"),
            _size("servo_speed", "rad/s"),
            Parameter(name="mount_position", unit="m", size=3),
            Parameter(
                name="knee",
                unit=TEXT,
                default="outwards",
                choices=(
                    ("outwards", "Outwards", "The knees point away from the finger"),
                    ("inwards", "Inwards", "The knees point to the finger"),
                ),
            ),
            Parameter(name="skin_friction", unit="1", low=0.0, default=FRICTION),
            Parameter(name="pulse_neutral", unit="s", above=0.0, default=1.5e-3),
            Parameter(name="pulse_gain", unit="s", default=1e-3 / (math.pi / 2)),
        ),
    ),
    "cable_platform": Kind(
        mechanism="cable_platform.mechanism",
        renderer="lookup",
        count=3,
        follows_skin=True,
        platform=True,
        drawn="platform",
        settings=("table", "table_rows"),
        parameters=table(
            *_PLATFORM,
            _needed("joint_angles", "rad", 3),
            _size("pulley_radius", "m"),
            _size("spring_stiffness", "N/m"),
            _size("spring_bending", "N/m"),
            _size("spring_preload", "N"),
            _size("cable_stiffness", "N/m"),
            _size("tension_limit", "N"),
            _count("sweep_levels"),
        ),
    ),
    "hexapod": Kind(
        mechanism="hexapod.mechanism",
        renderer="lookup",
        count=6,
        follows_skin=True,
        platform=True,
        drawn="platform",
        settings=("platform_method", "table", "table_rows", "thimble_surrogate", "thimble_hover"),
        parameters=table(
            *_PLATFORM,
            _needed("platform_angles", "rad", 6),
            _needed("base_angles", "rad", 6),
            _needed("sweep_shift", "m"),
            _needed("sweep_yaw", "rad"),
            _count("sweep_rows"),
        ),
    ),
}

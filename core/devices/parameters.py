"""What a preset may set of each kind of device, in which unit, and what it must set; one table a kind.

A preset that passes here and at its kind's own reading can be rendered: what is malformed is said where presets are
listed, not in the middle of a bake.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import DermisError
from ..units import UNITS
from .safe_state import safe_state
from .spec import KINDS, DeviceSpec

SWITCH, TEXT, NAMES = "true or false", "a text", "a list of texts"
# What may be stated of single channels, as 'bandwidth.motor_1': judged before a track leaves.
OF_CHANNELS = ("acceleration", "bandwidth", "resolution")
LARGEST = 1e9  # in SI: beyond every length, force, stiffness or rate of a device


@dataclass(frozen=True)
class Parameter:
    """One parameter of a kind.

    Attributes:
        unit: the SI unit that its own converts to; or `SWITCH`, `TEXT`, `NAMES`.
        required: a preset of the kind must have it.
        size: how many numbers: None for one alone, n for a list of n, 0 for a list of any length, -1 for a table.
        above: every number must be above this one. least: or at least this one. whole: no fractions.
        choices: of a text.
    """

    unit: str
    required: bool = False
    size: int | None = None
    above: float | None = None
    least: float | None = None
    whole: bool = False
    choices: tuple[str, ...] = ()


def _needed(unit: str, size: int | None = None) -> Parameter:
    return Parameter(unit, required=True, size=size)


def _size(unit: str) -> Parameter:
    return Parameter(unit, required=True, above=0.0)


def _count() -> Parameter:
    return Parameter("1", required=True, least=1.0, whole=True)


def _told(unit: str) -> Parameter:
    """A figure of the device that no mechanism needs, but people and senders want."""
    return Parameter(unit, least=0.0)


_ANY = {"range_disc": Parameter(NAMES), "range_disc_radius": Parameter("", above=0.0)}
_PLATFORM = {
    "platform_radius": _size("m"),
    "base_radius": _size("m"),
    "disc_radius": _size("m"),
    "rest_distance": _size("m"),
    "base_height": _size("m"),
    "friction": _told("1"),
    "knee_error": Parameter("1", above=0.0),
    "sweep_press": _needed("m", 2),
    "sweep_tilt": _needed("rad"),
    "coupling": Parameter("1", size=-1),
    "coupling_offset": Parameter("1", size=0),
    "coupling_low": Parameter("1", size=0),
    "coupling_high": Parameter("1", size=0),
    "coupling_unit": Parameter(TEXT),
}

PARAMETERS: Mapping[str, Mapping[str, Parameter]] = {
    "shear_tactor": {
        **_ANY,
        "link_length": _size("m"),
        "range": _size("m"),
        "max_speed": _size("m/s"),
        "torque_limit": _size("N*m"),
        "axis_direction": _needed("rad"),
        "tap_axis": _needed("1", 2),
        "force_reference": _told("N"),
        "force_anywhere": _told("N"),
        "pulley_diameter": _told("m"),
        "motor_pulley_diameter": _told("m"),
        "reduction": _told("1"),
        "hole_diameter": _told("m"),
        "cap_diameter": _told("m"),
        "cap_mass": _told("kg"),
        "device_mass": _told("kg"),
        "skin_stiffness_low": _told("N/m"),
        "skin_stiffness_high": _told("N/m"),
    },
    "friction_screen": {
        **_ANY,
        "law_slope": Parameter("1", above=0.0),
        "law_intercept": Parameter("1"),
        "law_base": Parameter("1", above=1.0),
        "span_factor": Parameter("1", least=1.0),
        "span_high": Parameter("V", above=0.0),
        "carrier_low": Parameter("Hz", above=0.0),
        "carrier_high": Parameter("Hz", above=0.0),
    },
    "pin_array": {
        **_ANY,
        "rows": _count(),
        "columns": _count(),
        "pitch": _size("m"),
        "pin_radius": _size("m"),
        "cylinder_radius": _size("m"),
        "stroke": _size("m"),
        "force_limit": _size("N"),
        "spread": _size("m"),
        "standoff": Parameter("m"),
        "forward": Parameter("m"),
        "mount_pitch": Parameter("rad"),
        "delay": Parameter("s", least=0.0),
    },
    "thimble": {
        **_ANY,
        "platform_radius": _size("m"),
        "base_radius": _size("m"),
        "crank": _size("m"),
        "rod": _size("m"),
        "disc_radius": _size("m"),
        "reference_distance": _size("m"),
        "servo_range": _size("rad"),
        "servo_speed": _size("rad/s"),
        "mount_position": Parameter("m", size=3),
        "knee": Parameter(TEXT, choices=("outwards", "inwards")),
        "skin_friction": Parameter("1", least=0.0),
        "pulse_neutral": Parameter("s", above=0.0),
        "pulse_gain": Parameter("s"),
    },
    "cable_platform": {
        **_ANY,
        **_PLATFORM,
        "joint_angles": _needed("rad", 3),
        "pulley_radius": _size("m"),
        "spring_stiffness": _size("N/m"),
        "spring_bending": _size("N/m"),
        "spring_preload": _size("N"),
        "cable_stiffness": _size("N/m"),
        "tension_limit": _size("N"),
        "sweep_levels": _count(),
    },
    "hexapod": {
        **_ANY,
        **_PLATFORM,
        "platform_angles": _needed("rad", 6),
        "base_angles": _needed("rad", 6),
        "sweep_shift": _needed("m"),
        "sweep_yaw": _needed("rad"),
        "sweep_rows": _count(),
    },
}


# The channels that a kind can fill, with their units, where it knows them by name.
CHANNELS: Mapping[str, Mapping[str, str]] = {
    "shear_tactor": {"tactor_x": "m", "tactor_y": "m", "pulley_1": "rad", "pulley_2": "rad"},
    "thimble": {"servo_1": "rad", "servo_2": "rad", "servo_3": "rad", "pitch": "rad", "roll": "rad", "distance": "m"},
}
MOTORS = {"cable_platform": 3, "hexapod": 6}


def check_device(spec: DeviceSpec) -> None:
    """Refuse a device preset that its kind cannot be made from.

    Raises:
        DermisError: an unknown kind or parameter, one that is missing, of another form, unit or sign, or channels, a
            safe state or quantities that the kind's own reading refuses.
    """
    where = f"device preset '{spec.key}'"
    if spec.kind not in KINDS:
        raise DermisError("unknown kind of device", where=where, value=spec.kind, limit=", ".join(KINDS))
    table = PARAMETERS[spec.kind]
    for name, parameter in table.items():
        if parameter.required and name not in spec.parameters:
            raise DermisError(f"'{name}' is missing", where=where, remedy=f"A {spec.kind} needs it")
    fields = spec.source.get("parameters", {})
    for name, value in spec.parameters.items():
        unit = fields[name]["unit"] if isinstance(fields[name], Mapping) else "1"
        found = table.get(name) or _of_channel(spec, name)
        if found is None:
            raise DermisError(
                "unknown parameter",
                where=where,
                value=name,
                limit=", ".join(table),
                remedy="What is only for people belongs into 'description'",
            )
        if name == "range_disc_radius":
            continue  # in the unit of the channels that share it, and checked with them
        check_value(name, value, unit, found, where)
    _check_channels(spec, where)
    safe_state(spec)
    try:
        _read(spec)
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise DermisError("its quantities fit no mechanism", where=where, value=str(error)) from error


def _check_channels(spec: DeviceSpec, where: str) -> None:
    """Refuse channels that the kind has no values for, or more or fewer of them than it has motors or pins."""
    known = CHANNELS.get(spec.kind, {})
    for channel in spec.channels if known else ():
        if channel.name not in known:
            raise DermisError(
                "no such channel of this kind of device", where=where, value=channel.name, limit=", ".join(known)
            )
        if channel.unit != known[channel.name]:
            raise DermisError(
                "a channel of another unit",
                where=f"{where}, channel '{channel.name}'",
                value=channel.unit,
                limit=known[channel.name],
            )
    wanted = None
    if spec.kind == "pin_array":
        wanted = int(spec.parameters["rows"]) * int(spec.parameters["columns"])
    elif spec.kind in MOTORS and "coupling" not in spec.parameters:
        wanted = MOTORS[spec.kind]
    if wanted is not None and len(spec.channels) != wanted:
        raise DermisError(
            "the channels are not as many as the device's pins or motors",
            where=where,
            value=len(spec.channels),
            limit=str(wanted),
        )
    for channel in spec.channels if spec.kind in MOTORS else ():
        if channel.low is None or channel.high is None or not channel.high > channel.low:
            raise DermisError(
                "a motor needs a range", where=f"{where}, channel '{channel.name}'", remedy="Give it 'low' and 'high'"
            )


def check_value(name: str, value: Any, unit: str, wanted: Parameter, where: str) -> None:
    """Refuse a value, in SI, that a parameter cannot have.

    Args:
        unit: the one it was written in.

    Raises:
        DermisError: another form, unit, number of numbers or sign.
    """
    place = f"{where}, {name}"
    if wanted.unit in (SWITCH, TEXT, NAMES):
        form = {SWITCH: bool, TEXT: str, NAMES: list}[wanted.unit]
        if not isinstance(value, form) or (wanted.choices and value not in wanted.choices):
            raise DermisError(
                "another kind of value", where=place, value=value, limit=", ".join(wanted.choices) or wanted.unit
            )
        return
    numbers = _numbers(value, wanted.size)
    if numbers is None:
        raise DermisError("another kind of value", where=place, value=value, limit=_form(wanted))
    if wanted.unit and UNITS[unit][0] != wanted.unit:
        raise DermisError(
            "a unit of another kind", where=place, value=unit, limit=f"one that converts to {wanted.unit}"
        )
    for number in numbers:
        if not math.isfinite(number) or abs(number) > LARGEST:
            raise DermisError("larger than any device", where=place, value=number, limit=f"{LARGEST:g} in SI")
        if wanted.above is not None and not number > wanted.above:
            above = "zero" if wanted.above == 0 else f"{wanted.above:g}"
            raise DermisError(f"'{name}' must be above {above}", where=where, value=number, limit=f"> {wanted.above:g}")
        if wanted.least is not None and not number >= wanted.least:
            raise DermisError(f"'{name}' is too small", where=where, value=number, limit=f">= {wanted.least:g}")
        if wanted.whole and not float(number).is_integer():
            raise DermisError(f"'{name}' must be a whole number", where=where, value=number)


def _numbers(value: Any, size: int | None) -> list[float] | None:
    """Return a value's numbers; None where it is not of the size wanted."""
    if size is None:
        return [value] if _number(value) else None
    if not isinstance(value, list) or (size > 0 and len(value) != size):
        return None
    if size >= 0:
        return value if all(map(_number, value)) else None
    rows = all(isinstance(row, list) and len(row) == len(value[0]) and all(map(_number, row)) for row in value)
    return [number for row in value for number in row] if rows else None


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _form(wanted: Parameter) -> str:
    many = {None: "one number", 0: "a list of numbers", -1: "rows of numbers"}.get(wanted.size)
    many = many or f"a list of {wanted.size} numbers"
    return f"{many} in {wanted.unit}" if wanted.unit not in ("", "1") else many


def _of_channel(spec: DeviceSpec, name: str) -> Parameter | None:
    """Return what may be stated of a channel; its unit is the channel's, or left out."""
    group, _, channel = name.partition(".")
    if group not in OF_CHANNELS or channel not in {c.name for c in spec.channels}:
        return None
    return Parameter("", above=0.0)


def _read(spec: DeviceSpec) -> None:
    """Let the kind's own file read the preset; it is loaded only now."""
    from .coupling import coupling_of

    if spec.kind == "shear_tactor":
        from .shear_tactor import ShearTactor

        ShearTactor.from_spec(spec)
    elif spec.kind == "friction_screen":
        from .friction_screen import FrictionScreen

        FrictionScreen.of(spec)
    elif spec.kind == "pin_array":
        from . import pin_array

        pin_array.layout(spec)
    elif spec.kind == "thimble":
        from . import thimble

        thimble.mechanism(spec)
    elif spec.kind == "cable_platform":
        from . import cable_platform

        cable_platform.mechanism(spec)
        coupling_of(spec)
    elif spec.kind == "hexapod":
        from . import hexapod

        hexapod.mechanism(spec)
        coupling_of(spec)

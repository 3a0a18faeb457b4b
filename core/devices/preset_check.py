"""Check of device presets: their fields, parameters and channels.

A device can be rendered if its preset passes. Invalid presets are reported when presets are listed, and not in the
middle of a bake.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..errors import DermisError
from ..parameters.parameter import Parameter
from .coupling import coupling_of
from .kinds import Kind
from .mechanism import kind_of, mechanism_of
from .safe_state import safe_state
from .spec import DeviceSpec

# Parameters of single channels, such as 'bandwidth.motor_1'. Tracks are checked against them before they are sent.
OF_CHANNELS = ("acceleration", "bandwidth", "resolution")
FIELDS = "schema name kind rate channels parameters safe wire description sources display settings".split()
CHANNEL_FIELDS = "name unit actuator low high slew rest repeat description source".split()


def check_device(spec: DeviceSpec) -> None:
    """Refuse an invalid device preset.

    Raises:
        DermisError: the kind, a field or a parameter is unknown, a required parameter is missing, a parameter has a
            wrong form, unit or sign, or the channels, the safe state or the mechanism are invalid.
    """
    where = f"device preset '{spec.key}'"
    kind = kind_of(spec)
    _check_fields(spec.source, FIELDS, where)
    for entry in spec.source["channels"]:
        _check_fields(entry, CHANNEL_FIELDS, f"{where}, channel '{entry['name']}'")
    table = kind.parameters
    for name, row in table.items():
        if row.required:
            spec.value(name)
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
                remedy="Put remarks for people into 'description'",
            )
        if name == "range_disc_radius":
            continue  # it has the unit of its two channels, and was checked with them
        found.check(value, where, unit)
    _check_channels(spec, kind, where)
    safe_state(spec)
    try:
        mechanism_of(spec)
        if kind.platform:
            coupling_of(spec)
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise DermisError("its dimensions fit no mechanism", where=where, value=str(error)) from error


def _check_fields(given: Mapping[str, Any], known: Sequence[str], where: str) -> None:
    """Refuse unknown fields.

    With a misspelt 'safe', for example, a device would have no safe state.
    """
    unknown = sorted(set(given) - set(known))
    if unknown:
        raise DermisError("unknown field", where=where, value=", ".join(unknown), limit=", ".join(known))


def _check_channels(spec: DeviceSpec, kind: Kind, where: str) -> None:
    """Refuse channels that do not fit the kind of device.

    Their names and units must be those of the kind, their number must be that of its motors or pins, and the motors of
    a platform need a range.
    """
    for channel in spec.channels if kind.channels else ():
        if channel.name not in kind.channels:
            raise DermisError(
                "no such channel of this kind of device",
                where=where,
                value=channel.name,
                limit=", ".join(kind.channels),
            )
        if channel.unit != kind.channels[channel.name]:
            raise DermisError(
                "a channel of another unit",
                where=f"{where}, channel '{channel.name}'",
                value=channel.unit,
                limit=kind.channels[channel.name],
            )
    count = kind.count if isinstance(kind.count, int) else math.prod(int(spec.parameters[name]) for name in kind.count)
    if count and "coupling" not in spec.parameters and len(spec.channels) != count:
        raise DermisError(
            "the number of channels differs from that of the pins or motors",
            where=where,
            value=len(spec.channels),
            limit=str(count),
        )
    for channel in spec.channels if kind.platform else ():
        if channel.low is None or channel.high is None or not channel.high > channel.low:
            raise DermisError(
                "a motor needs a range", where=f"{where}, channel '{channel.name}'", remedy="Give it 'low' and 'high'"
            )


def _of_channel(spec: DeviceSpec, name: str) -> Parameter | None:
    """Return the parameter of a single channel, such as 'bandwidth.motor_1'.

    It is None if the name is not that of such a parameter. Its unit is not checked.
    """
    group, _, channel = name.partition(".")
    if group not in OF_CHANNELS or channel not in {c.name for c in spec.channels}:
        return None
    return Parameter(name=name, unit="", above=0.0)

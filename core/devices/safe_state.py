"""Safe state of a device: values of channels, and how they are reached."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from ..errors import DermisError, Finding
from ..units import UNITS, quantity
from .spec import DeviceSpec, repeated_names

REACHES = ("at_once", "ramp", "release")


class SafeState(NamedTuple):
    """Safe state in a preset.

    Attributes:
        reach: how it is reached, one of `REACHES`.
        values: values by name of the channel [SI].
    """

    reach: str
    values: Mapping[str, float]


def safe_state(spec: DeviceSpec) -> SafeState:
    """Return the safe state of a device preset.

    The field `safe` is {"reach": "ramp", "values": {channel: quantity}}. Without it, the state is a ramp without
    values. The name of an entry for repeated channels, such as 'pin_{}', sets all of them.

    Raises:
        DermisError: a field or channel is unknown, 'reach' is none of `REACHES`, or a value is not one number within
            the channel's range.
    """
    where = f"device preset '{spec.key}', safe"
    field: Any = spec.source.get("safe", {})
    if not isinstance(field, Mapping) or not set(field) <= {"reach", "values", "source"}:
        raise DermisError("unknown fields", where=where, limit="reach, values, source")
    reach, given = field.get("reach", "ramp"), field.get("values", {})
    if reach not in REACHES:
        raise DermisError("unknown way to the safe state", where=where, value=reach, limit=", ".join(REACHES))
    if not isinstance(given, Mapping):
        raise DermisError("'values' must name channels", where=where, value=given)
    repeated = repeated_names(spec)
    return SafeState(
        reach,
        {
            name: _value(spec, name, entry, f"{where}, {name}")
            for key, entry in given.items()
            for name in repeated.get(key, (key,))
        },
    )


def bare_channels(spec: DeviceSpec) -> tuple[str, ...]:
    """Return the channels with an actuator that lack a safe value.

    It is () for a device that is not worn, which needs no safe values.
    """
    if not spec.worn:
        return ()
    values = safe_state(spec).values
    return tuple(c.name for c in spec.channels if c.actuator and c.name not in values)


def safe_findings(spec: DeviceSpec) -> tuple[Finding, ...]:
    """Return findings to show before commands are streamed to this device."""
    bare = bare_channels(spec)
    if not bare:
        return ()
    return (
        Finding(
            "warning",
            "no-safe-pose",
            "a worn device states no safe pose, so it will not be streamed to",
            where=f"device preset '{spec.key}'",
            value=f"none for {', '.join(bare[:6])}",
            remedy="Add 'safe' to the preset: a retracted pose, clear of your finger",
        ),
    )


def _value(spec: DeviceSpec, name: str, entry: Any, where: str) -> float:
    channel, value = spec.channel(name), quantity(entry, where=where)
    unit = entry["unit"] if isinstance(entry, Mapping) else channel.unit
    if isinstance(value, list) or UNITS[unit][0] != channel.unit:
        raise DermisError("not a value in the channel's unit", where=where, value=value)
    low = -float("inf") if channel.low is None else channel.low
    high = float("inf") if channel.high is None else channel.high
    if not low <= value <= high:
        raise DermisError("the safe value is outside the range", where=where, value=value, limit=f"{low:g} to {high:g}")
    return float(value)

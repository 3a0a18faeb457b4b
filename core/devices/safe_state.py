"""The safe state of a device, as its preset states it: values, and how they are reached."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from ..errors import DermisError, Finding
from ..units import UNITS, quantity
from .spec import DeviceSpec, repeated_names

REACHES = ("at_once", "ramp", "release")


class SafeState(NamedTuple):
    """The statement of a preset: how its safe state is reached, one of `REACHES`, and values by channel [SI]."""

    reach: str
    values: Mapping[str, float]


def safe_state(spec: DeviceSpec) -> SafeState:
    """Read `safe` of a device preset, {"reach": "ramp", "values": {channel: quantity}}; without it a ramp to nothing.

    The name of channels that are one entry, such as 'pin_{}', stands for all of them.

    Raises:
        DermisError: unknown fields or channels, another way, or a value that is not one within the channel's range.
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
    """Return the channels with an actuator for which a worn device states no safe value; () where it need not."""
    if not spec.worn:
        return ()
    values = safe_state(spec).values
    return tuple(c.name for c in spec.channels if c.actuator and c.name not in values)


def safe_findings(spec: DeviceSpec) -> tuple[Finding, ...]:
    """Return findings for a person, before this device is meant to be streamed to."""
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
        raise DermisError("not one value in the channel's unit", where=where, value=value)
    low = -float("inf") if channel.low is None else channel.low
    high = float("inf") if channel.high is None else channel.high
    if not low <= value <= high:
        raise DermisError("the safe value is outside the range", where=where, value=value, limit=f"{low:g} to {high:g}")
    return float(value)

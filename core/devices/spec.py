"""DeviceSpec: what a device preset says, in SI, and the channels that a command track for it has."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ..errors import DermisError
from ..units import quantity

DEVICE_SCHEMA = "dermis-device 1"


@dataclass(frozen=True)
class Channel:
    """One named command of a device.

    Attributes:
        name: unique within the device, such as 'pulley_1'.
        unit: SI unit of the values.
        low, high: allowed range [unit]; None where there is no limit.
        slew: largest change a second [unit/s]; None where there is no limit.
        rest: the value at which the device is at rest and safe.
        actuator: which physical actuator it drives (two channels of one track may not share one);
            '' for a channel that only informs, such as a tactor position.
    """

    name: str
    unit: str
    low: float | None = None
    high: float | None = None
    slew: float | None = None
    rest: float = 0.0
    actuator: str = ""


@dataclass(frozen=True)
class DeviceSpec:
    """A device preset, read.

    Attributes:
        key: the preset's file stem. name: for people. kind: which mechanism file drives it.
        rate: command rate [Hz].
        channels: in the order of the track's columns.
        parameters: the mechanism's quantities in SI and its plain settings.
        wire: bits a second the link carries (0: unknown), bits a sample costs besides.
        source: the preset as read, for its hash and its sources.
    """

    key: str
    name: str
    kind: str
    rate: float
    channels: tuple[Channel, ...]
    parameters: Mapping[str, Any] = field(default_factory=dict)
    wire: Mapping[str, float] = field(default_factory=dict)
    source: Mapping[str, Any] = field(default_factory=dict)

    @property
    def hash(self) -> str:
        """First 16 hex digits of the SHA-256 of the preset."""
        text = json.dumps(self.source, sort_keys=True, ensure_ascii=False)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def channel(self, name: str) -> Channel:
        """Return a channel by name."""
        for channel in self.channels:
            if channel.name == name:
                return channel
        raise DermisError("no such channel", where=self.name, value=name, limit=", ".join(c.name for c in self.channels))


def from_preset(key: str, preset: Mapping[str, Any]) -> DeviceSpec:
    """Read a device preset.

    Quantities are `{"value", "unit", "source"}`; strings, booleans and lists of strings pass as they are.

    Raises:
        DermisError: another schema, a missing field, an unknown unit, two channels of one name.
    """
    where = f"device preset '{key}'"
    if preset.get("schema") != DEVICE_SCHEMA:
        raise DermisError("unknown schema", where=where, value=preset.get("schema"), limit=DEVICE_SCHEMA)
    for name in ("name", "kind", "rate", "channels"):
        if name not in preset:
            raise DermisError(f"'{name}' is missing", where=where)
    channels = tuple(_channel(entry, where) for entry in preset["channels"])
    names = [c.name for c in channels]
    if len(set(names)) != len(names):
        raise DermisError("two channels have one name", where=where, value=", ".join(names))
    return DeviceSpec(
        key=key,
        name=str(preset["name"]),
        kind=str(preset["kind"]),
        rate=positive(quantity(preset["rate"], where=f"{where}, rate"), f"{where}, rate"),
        channels=channels,
        parameters={k: _parameter(v, f"{where}, {k}") for k, v in preset.get("parameters", {}).items()},
        wire={k: quantity(v, where=f"{where}, wire {k}") for k, v in preset.get("wire", {}).items()},
        source=preset,
    )


def positive(value: float, where: str) -> float:
    """Return a value that must be above zero."""
    if not value > 0:
        raise DermisError("must be above zero", where=where, value=value, limit="> 0")
    return value


def _parameter(value: Any, where: str) -> Any:
    if isinstance(value, str | bool) or (isinstance(value, list) and all(isinstance(v, str) for v in value)):
        return value
    return quantity(value, where=where)


def _channel(entry: Mapping[str, Any], where: str) -> Channel:
    for name in ("name", "unit"):
        if name not in entry:
            raise DermisError(f"a channel has no '{name}'", where=where, value=dict(entry))
    place = f"{where}, channel '{entry['name']}'"
    limits = {k: None if entry.get(k) is None else quantity(entry[k], where=place) for k in ("low", "high", "slew")}
    return Channel(
        name=str(entry["name"]),
        unit=str(entry["unit"]),
        rest=quantity(entry.get("rest", 0.0), where=place),
        actuator=str(entry.get("actuator", "")),
        **limits,
    )

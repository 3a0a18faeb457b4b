"""DeviceSpec: a device preset in SI units, with the channels of a track."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ..errors import DermisError
from ..parameters.stream import STREAM
from ..units import UNITS, quantity, setting
from .kinds import KINDS

DEVICE_SCHEMA = "dermis-device 1"
MAX_REPEAT = 4096  # largest number of channels of one entry
NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*")  # names of channels, which are written to file headers unchanged
CHANNEL = ("name", "unit", "actuator", "low", "high", "slew", "rest", "repeat", "description", "source")
WIRE = ("bandwidth", "bits_per_sample", "bits_per_channel")


@dataclass(frozen=True)
class Channel:
    """One named command of a device.

    Attributes:
        name: name, unique within the device, such as 'pulley_1'.
        unit: SI unit of the values.
        low, high: allowed range [unit]; None for no limit.
        slew: slew limit, the largest change in a second [unit/s]; None for no limit.
        rest: value at which the device is at rest [unit]; the safe pose is stated separately.
        actuator: physical actuator that the channel drives; no two channels of a track can drive the same actuator. ''
            for a channel that drives nothing, such as the position of a tactor.
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
    """Device preset in SI units.

    Attributes:
        key: stem of the preset's file name.
        name: name for people.
        kind: kind of device, see `kinds.KINDS`.
        rate: command rate [Hz].
        channels: channels in the order of the track's columns.
        parameters: quantities of the mechanism in SI units, and its other settings. `range_disc` (a list of two names)
            and `range_disc_radius` (in the channels' unit) give two channels a common round range.
        link_budget: `bandwidth` of the link [bit/s], 0 or absent if it is not known; `bits_per_sample`, the cost of
            every sample for address, check and time; and `bits_per_channel`, the cost of each channel with an actuator.
            The group is named 'wire' in files.
        source: the preset as read, for its hash and its sources.
        stated_hash: hash that a track file states if the preset itself is not available; '' otherwise.

    >>> from dermis import Library
    >>> spec = Library().device("haptip")
    >>> spec.channel("tactor_x").low, spec.channel("tactor_x").unit
    (-0.002, 'm')
    """

    key: str
    name: str
    kind: str
    rate: float
    channels: tuple[Channel, ...]
    parameters: Mapping[str, Any] = field(default_factory=dict)
    link_budget: Mapping[str, float] = field(default_factory=dict)
    source: Mapping[str, Any] = field(default_factory=dict)
    stated_hash: str = ""

    def __repr__(self) -> str:
        return f"DeviceSpec({self.key}, {self.kind}, {len(self.channels)} channels at {self.rate:g} Hz)"

    @property
    def worn(self) -> bool:
        """Whether a finger is inside the device.

        The preset must then state a safe pose.
        """
        return self.kind in KINDS and KINDS[self.kind].worn

    @property
    def follows_skin(self) -> bool:
        """Whether the track is made from the contact of the finger's whole skin."""
        return self.kind in KINDS and KINDS[self.kind].follows_skin

    def value(self, name: str) -> Any:
        """Return a parameter of the device in SI units.

        If the preset does not state the parameter, its default is returned.

        Raises:
            DermisError: the parameter is required and missing, has a wrong type, or is out of range.
        """
        row, where = KINDS[self.kind].parameters[name], f"device preset '{self.key}'"
        if row.required and name not in self.parameters:
            raise DermisError(f"'{name}' is missing", where=where, remedy=f"A {self.kind} needs it")
        return row.of(self.parameters, where)

    @property
    def hash(self) -> str:
        """First 16 hex digits of the SHA-256 of the preset."""
        if self.stated_hash:
            return self.stated_hash
        text = json.dumps(self.source, sort_keys=True, ensure_ascii=False)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def channel(self, name: str) -> Channel:
        """Return a channel by name.

        Raises:
            DermisError: the device has no such channel.
        """
        for channel in self.channels:
            if channel.name == name:
                return channel
        raise DermisError(
            "no such channel", where=self.name, value=name, limit=", ".join(c.name for c in self.channels)
        )


def from_preset(key: str, preset: Mapping[str, Any]) -> DeviceSpec:
    """Read a device preset.

    Quantities are objects `{"value", "unit", "source"}`. Strings, booleans and lists of strings are kept unchanged.

    Args:
        key: stem of the preset's file name.
        preset: content of the file.

    Raises:
        DermisError: the schema or a unit is unknown; a field is missing or unknown; two channels have the same name; a
            low limit is above the high limit; a rest value is outside the limits; or the range disc is not valid, see
            `range_disc`.
    """
    where = f"device preset '{key}'"
    if not isinstance(preset, Mapping):
        raise DermisError("a preset is one JSON object", where=where, value=type(preset).__name__)
    if preset.get("schema") != DEVICE_SCHEMA:
        raise DermisError("unknown schema", where=where, value=preset.get("schema"), limit=DEVICE_SCHEMA)
    for name in ("name", "kind", "rate", "channels"):
        if name not in preset:
            raise DermisError(f"'{name}' is missing", where=where)
    for name in ("name", "kind"):
        if not isinstance(preset[name], str):
            raise DermisError(f"'{name}' is not a text", where=where, value=preset[name])
    entries = preset["channels"]
    if not isinstance(entries, list) or not entries or not all(isinstance(e, Mapping) for e in entries):
        raise DermisError("'channels' must be a list of objects, at least one", where=where, value=entries)
    channels = tuple(_channel(one, where) for entry in entries for one in _repeated(entry, where))
    names = [c.name for c in channels]
    if len(set(names)) != len(names):
        raise DermisError("two channels have one name", where=where, value=", ".join(names))
    spec = DeviceSpec(
        key=key,
        name=preset["name"],
        kind=preset["kind"],
        rate=_rate(preset["rate"], f"{where}, rate"),
        channels=channels,
        parameters={k: setting(v, where=f"{where}, {k}") for k, v in _group(preset, "parameters", where).items()},
        link_budget=_link_budget(_group(preset, "wire", where), where),
        source=preset,
    )
    range_disc(spec)
    return spec


def _rate(entry: Any, where: str) -> float:
    """Return the command rate [Hz].

    It must not exceed the largest rate of a stream.
    """
    rate, most = positive(_number(entry, where), where), STREAM["rate"].high
    if most is not None and rate > most:
        raise DermisError("the rate is higher than Dermis can send", where=where, value=rate, limit=f"<= {most:g} Hz")
    return rate


def repeated_names(spec: DeviceSpec) -> dict[str, tuple[str, ...]]:
    """Return the names of repeated channels by the name of their entry.

    The key 'pin_{}', for example, has the value ('pin_001', 'pin_002', ...).
    """
    entries = [e for e in spec.source.get("channels", ()) if "repeat" in e]
    return {e["name"]: tuple(one["name"] for one in _repeated(e, spec.key)) for e in entries}


def positive(value: float, where: str) -> float:
    """Return a value, or raise an error if it is not above zero."""
    if not value > 0:
        raise DermisError("must be above zero", where=where, value=value, limit="> 0")
    return value


def range_disc(spec: DeviceSpec) -> tuple[int, int, float] | None:
    """Return the common round range of two channels; None if there is none.

    Returns:
        Columns of the two channels in a track, and radius of the range in their unit.

    Raises:
        DermisError: the range disc does not name two channels of the device with the same unit, or its radius is not
            above zero.
    """
    names, radius = spec.parameters.get("range_disc"), spec.parameters.get("range_disc_radius")
    if names is None and radius is None:
        return None
    where = f"device preset '{spec.key}', range_disc"
    own = [c.name for c in spec.channels]
    if not isinstance(names, list) or len(names) != 2 or names[0] == names[1] or not all(n in own for n in names):
        raise DermisError("must name two channels", where=where, value=names, limit=", ".join(own))
    if spec.channel(names[0]).unit != spec.channel(names[1]).unit:
        raise DermisError("the two channels have different units", where=where, value=names)
    if not isinstance(radius, int | float) or isinstance(radius, bool):
        raise DermisError("needs 'range_disc_radius', one number", where=where, value=radius)
    return own.index(names[0]), own.index(names[1]), positive(float(radius), f"{where}_radius")


def _group(preset: Mapping[str, Any], name: str, where: str) -> Mapping[str, Any]:
    group = preset.get(name, {})
    if not isinstance(group, Mapping):
        raise DermisError(f"'{name}' must be an object", where=where, value=group)
    return group


def _number(field: Any, where: str) -> float:
    value = quantity(field, where=where)
    if isinstance(value, list):
        raise DermisError("needs one number, not a list", where=where, value=value)
    return float(value)


def _link_budget(entries: Mapping[str, Any], where: str) -> dict[str, float]:
    budget = {}
    for name, entry in entries.items():
        place = f"{where}, wire {name}"
        if name not in WIRE:
            raise DermisError("unknown field", where=place, limit=", ".join(WIRE))
        budget[name] = _number(entry, place)
        if budget[name] < 0:
            raise DermisError("must not be below zero", where=place, value=budget[name], limit=">= 0")
    if budget.get("bandwidth") and not (budget.get("bits_per_sample") or budget.get("bits_per_channel")):
        raise DermisError(
            "a bandwidth needs 'bits_per_sample' or 'bits_per_channel'",
            where=f"{where}, wire",
            limit=", ".join(WIRE[1:]),
        )
    return budget


def _repeated(entry: Mapping[str, Any], where: str) -> list[Mapping[str, Any]]:
    """Return the n entries for an entry with "repeat": n.

    In their names and actuators, {} is replaced by 1 to n, with leading zeros.
    """
    if "repeat" not in entry:
        return [entry]
    count, name = entry["repeat"], str(entry.get("name", ""))
    if not isinstance(count, int) or isinstance(count, bool) or not 1 <= count <= MAX_REPEAT:
        raise DermisError("'repeat' must be a whole number", where=where, value=count, limit=f"1 to {MAX_REPEAT}")
    if name.count("{}") != 1:
        raise DermisError("a repeated channel's name needs {} for its number", where=where, value=name)
    numbers = [f"{i:0{len(str(count))}d}" for i in range(1, count + 1)]
    rest = {k: v for k, v in entry.items() if k not in ("repeat", "name", "actuator")}
    actuator = str(entry.get("actuator", ""))
    return [{**rest, "name": name.replace("{}", n), "actuator": actuator.replace("{}", n)} for n in numbers]


def _channel(entry: Mapping[str, Any], where: str) -> Channel:
    for name in ("name", "unit"):
        if name not in entry:
            raise DermisError(f"a channel has no '{name}'", where=where, value=dict(entry))
        if not isinstance(entry[name], str):
            raise DermisError(f"a channel's '{name}' is not a text", where=where, value=entry[name])
    place = f"{where}, channel '{entry['name']}'"
    if not NAME.fullmatch(entry["name"]):
        raise DermisError(
            "a channel's name has a character that is not allowed",
            where=place,
            value=entry["name"],
            limit="letters, digits, '_', '.', '-', first no digit",
        )
    if entry["unit"] not in UNITS or UNITS[entry["unit"]][0] != entry["unit"]:
        units = ", ".join(dict.fromkeys(si for si, _ in UNITS.values()))
        raise DermisError("a channel's unit must be SI", where=place, value=entry["unit"], limit=units)
    unknown = sorted(set(entry) - set(CHANNEL))
    if unknown:  # without this error, a misspelt limit would have no effect
        raise DermisError("unknown field", where=place, value=", ".join(unknown), limit=", ".join(CHANNEL))
    given = {k: entry[k] for k in ("low", "high", "slew", "rest") if entry.get(k) is not None}
    limits = {k: _in_unit(field, entry["unit"], f"{place}, {k}") for k, field in given.items()}
    low, high = limits.get("low", -math.inf), limits.get("high", math.inf)
    if low > high:
        raise DermisError("low is above high", where=place, value=low, limit=f"<= {high}")
    if "slew" in limits:
        positive(limits["slew"], f"{place}, slew")
    rest = limits.get("rest", 0.0)
    if not low <= rest <= high:
        raise DermisError("rest is outside the range", where=place, value=rest, limit=f"{low} to {high}")
    return Channel(entry["name"], entry["unit"], actuator=str(entry.get("actuator", "")), **limits)


def _in_unit(field: Any, unit: str, where: str) -> float:
    """Return a limit in the channel's unit, a slew limit in unit per second.

    A plain number is already in this unit.
    """
    value = _number(field, where)
    wanted = f"{unit}/s" if where.endswith(", slew") else unit
    if isinstance(field, Mapping) and UNITS[field["unit"]][0] != wanted:
        raise DermisError(
            "a unit of the wrong kind", where=where, value=field["unit"], limit=f"one that converts to {wanted}"
        )
    return value

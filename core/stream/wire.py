"""The part of a device that goes over the wire: its channels with an actuator, and the state that is safe."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calibration import Calibration
from ..devices.spec import DeviceSpec, range_disc
from ..errors import DermisError
from ..units import UNITS, quantity
from .packets import FULL, Reach

Array = NDArray[np.float64]

REACH = {"at_once": Reach.AT_ONCE, "ramp": Reach.RAMP, "release": Reach.RELEASE}


@dataclass(frozen=True)
class Wire:
    """What a sender needs to know of a device; every array has one entry for each channel on the wire.

    Attributes:
        spec: the device. columns: of its tracks. names, units: of the channels.
        low, high: range that counts stand for [unit]; -inf and inf where there is none.
        slew: largest change a second, inf where there is no limit. rest: the neutral pose.
        safe: values of the safe state. reach: how it is reached.
        zero, gain: of the calibration. least, most: what may be driven: the tighter ones of preset and calibration.
        disc: two entries that share a round range, and its radius.
    """

    spec: DeviceSpec
    columns: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    low: Array
    high: Array
    slew: Array
    rest: Array
    safe: Array
    reach: Reach
    zero: Array
    gain: Array
    least: Array
    most: Array
    disc: tuple[int, int, float] | None

    @classmethod
    def of(cls, spec: DeviceSpec, calibration: Calibration | None = None) -> Wire:
        """Read a device preset and its calibration.

        The safe state is the preset's, in the device's own terms: zero and gain do not move it. Limits that do not
        contain it are refused, since one of the two would have to be broken.

        Raises:
            DermisError: no channel drives an actuator, a safe state that is none, a calibration that does not fit.
        """
        columns = tuple(i for i, c in enumerate(spec.channels) if c.actuator)
        if not columns:
            raise DermisError("no channel drives an actuator, so there is nothing to stream", where=spec.name,
                              remedy="Give channels an 'actuator' in the device preset")  # fmt: skip
        if len(columns) > 255:
            raise DermisError("more channels than a packet can hold", where=spec.name, value=len(columns), limit="255")
        twice = [spec.channels[i].actuator for i in columns]
        if len(set(twice)) != len(twice):
            raise DermisError("two channels drive one actuator", where=spec.name, value=", ".join(twice))
        channels = [spec.channels[i] for i in columns]
        zero, gain, least, most = ((calibration or Calibration.of(spec)).for_spec(spec)[k][list(columns)]
                                   for k in range(4))  # fmt: skip
        reach, safe = _safe(spec)
        disc = range_disc(spec)
        if disc is not None:
            disc = (columns.index(disc[0]), columns.index(disc[1]), disc[2]) if {*disc[:2]} <= {*columns} else None

        def pick(name: str, missing: float) -> Array:
            return np.array([missing if getattr(c, name) is None else getattr(c, name) for c in channels])

        values = np.array([safe.get(c.name, c.rest) for c in channels])
        _check_safe(spec, [c.name for c in channels], values, least, most)
        return cls(
            spec, columns, tuple(c.name for c in channels), tuple(c.unit for c in channels), pick("low", -np.inf),
            pick("high", np.inf), pick("slew", np.inf), pick("rest", 0.0),
            values, reach, zero, gain, least, most, disc,
        )  # fmt: skip

    @property
    def count(self) -> int:
        """Number of channels on the wire."""
        return len(self.columns)

    @property
    def hash(self) -> bytes:
        """First 8 bytes of the preset's hash."""
        try:
            return bytes.fromhex(self.spec.hash)[:8].ljust(8, b"\0")
        except ValueError:
            return self.spec.hash.encode()[:8].ljust(8, b"\0")

    def need_ranges(self, protocol: str) -> None:
        """Refuse channels without a range, for protocols that send counts.

        Raises:
            DermisError: a channel has no low or no high.
        """
        bare = [n for n, lo, hi in zip(self.names, self.low, self.high, strict=True) if not 0 < hi - lo < np.inf]
        if bare:
            raise DermisError(f"{protocol} sends counts, and a channel has no range for them to stand for",
                              where=self.spec.name, value=", ".join(bare),
                              remedy="Give it 'low' and 'high' in the device preset")  # fmt: skip

    def counts(self, values: Array, full: int = FULL) -> NDArray[np.uint16]:
        """Return values [units] as counts from 0 to `full` over each channel's range; the caller has limited them."""
        part = (values - self.low) / (self.high - self.low)
        return np.rint(np.minimum(np.maximum(part, 0.0), 1.0) * full).astype(np.uint16)

    def values(self, counts: NDArray[np.uint16], full: int = FULL) -> Array:
        """Return counts as values [units]."""
        return self.low + (self.high - self.low) * (counts / full)

    def slew_counts(self, full: int = FULL) -> NDArray[np.uint16]:
        """Return the largest change in counts a millisecond, at least 1 and at most 65535."""
        part = self.slew / (self.high - self.low) * full / 1000.0
        return np.clip(np.floor(part), 1, 65535).astype(np.uint16)


def _check_safe(spec: DeviceSpec, names: list[str], safe: Array, least: Array, most: Array) -> None:
    """Refuse limits that leave the safe state outside."""
    slack = 1e-9 * np.maximum(np.abs(safe), 1e-3)  # what a rounding of units does
    outside = np.flatnonzero((safe < least - slack) | (safe > most + slack))
    if outside.size:
        k = int(outside[0])
        raise DermisError("the safe state lies outside the calibrated limits", where=f"'{spec.key}', {names[k]}",
                          value=f"{safe[k]:g}", limit=f"{least[k]:g} to {most[k]:g}",
                          remedy="Widen the limits, or state in a device preset of your own what is safe")  # fmt: skip


def _safe(spec: DeviceSpec) -> tuple[Reach, dict[str, float]]:
    """Read `safe` of a device preset: {"reach": "ramp", "values": {channel: quantity}}; without it, ramp to rest."""
    where = f"device preset '{spec.key}', safe"
    field: Any = spec.source.get("safe", {"reach": "ramp"})
    if not isinstance(field, Mapping) or not set(field) <= {"reach", "values", "source"}:
        raise DermisError("unknown fields", where=where, limit="reach, values, source")
    reach = field.get("reach", "ramp")
    if not isinstance(reach, str) or reach not in REACH:
        raise DermisError("unknown way to the safe state", where=where, value=reach, limit=", ".join(REACH))
    given = field.get("values", {})
    if not isinstance(given, Mapping):
        raise DermisError("'values' must name channels", where=where, value=given)
    values = {}
    for name, entry in given.items():
        channel = spec.channel(name)
        value = quantity(entry, where=f"{where}, {name}")
        unit = entry["unit"] if isinstance(entry, Mapping) else channel.unit
        if isinstance(value, list) or UNITS[unit][0] != channel.unit:
            raise DermisError("not one value in the channel's unit", where=f"{where}, {name}", value=value)
        low = -np.inf if channel.low is None else channel.low
        high = np.inf if channel.high is None else channel.high
        if not low <= value <= high:
            raise DermisError("the safe value is outside the range", where=f"{where}, {name}", value=value)
        values[name] = float(value)
    return REACH[reach], values

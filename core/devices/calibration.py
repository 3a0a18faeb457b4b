"""How one built device differs from its preset: zero, gain, limits, curve and frequency response of each actuator.

    driven = inverse curve of (zero + gain * commanded), then held within low and high

A calibration belongs to one built device; presets belong to everyone. So it is a file of its own, which says whose it
is: by the name that a person gave the device, and by its serial number where it has one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError, Finding
from ..files import read_text, write_bytes
from ..foreign import json_of
from .frequency_response import BEYOND, FrequencyResponse
from .response import Response
from .spec import DeviceSpec

SCHEMA = "dermis-calibration 4"
# The first knew neither name nor serial, the first two no curves, all three no frequency response.
_OLDER = ("dermis-calibration 1", "dermis-calibration 2", "dermis-calibration 3")
_OWNER = ("name", "serial")
_LONGEST = 100  # of a name or serial [characters]
_NUMBERS = ("zero", "gain", "low", "high")


@dataclass(frozen=True)
class Entry:
    """One actuator.

    Attributes:
        zero: driven value for a command of 0 [unit of the channel].
        gain: driven change for a commanded change [1]; negative where it is mounted the other way round.
        low, high: limits of driven and reached values [unit]; None: the preset's own limits.
        response: curve from driven to reached values, where that was measured.
        frequency: how it answers vibration, where that was measured.
    """

    zero: float = 0.0
    gain: float = 1.0
    low: float | None = None
    high: float | None = None
    response: Response | None = None
    frequency: FrequencyResponse | None = None


@dataclass(frozen=True)
class Calibration:
    """All actuators of one device.

    Attributes:
        device: the preset's key.
        spec_hash: hash of the preset that the calibration was made with.
        entries: by channel name; a channel that has none is driven as commanded.
        name: name of the built device, chosen by a person.
        serial: serial number from its answer, or the number of its USB port; '' where it has none.
    """

    device: str
    spec_hash: str = ""
    entries: Mapping[str, Entry] = field(default_factory=dict)
    name: str = ""
    serial: str = ""

    @classmethod
    def of(cls, spec: DeviceSpec) -> Calibration:
        """Return the calibration that changes nothing."""
        return cls(spec.key, spec.hash, {})

    def with_entry(self, channel: str, **parts: Any) -> Calibration:
        """Return a calibration with some parts of a channel's `Entry` replaced.

        Raises:
            DermisError: a number that is not finite, a gain of zero, or low above high.
        """
        entry = replace(self.entries.get(channel, Entry()), **parts)
        _check(entry, f"calibration, {channel}")
        return replace(self, entries={**self.entries, channel: entry})

    def without_curves(self) -> Calibration:
        """Return the calibration without measured curves: zero and gain alone tell the driven value."""
        bare = {name: replace(entry, response=None, frequency=None) for name, entry in self.entries.items()}
        return replace(self, entries=bare)

    def owned_by(self, name: str, serial: str = "") -> Calibration:
        """Return the calibration as that of one built device.

        Raises:
            DermisError: a name or serial that is too long, or has characters that cannot be seen.
        """
        for what, text in (("name", name), ("serial", serial)):
            _check_text(text, f"calibration, {what}")
        return replace(self, name=name, serial=serial)

    def for_spec(self, spec: DeviceSpec) -> tuple[NDArray[np.float64], ...]:
        """Return zero, gain, low and high for every channel of a device, each of shape (channels,).

        The limits are the tighter ones of preset and calibration.

        Raises:
            DermisError: made for another device, a channel that it does not have, or limits that leave nothing.
        """
        where = f"calibration of '{self.device}'"
        if self.device != spec.key:
            raise DermisError("made for another device", where=where, value=spec.key, limit=self.device)
        unknown = sorted(set(self.entries) - {c.name for c in spec.channels})
        if unknown:
            raise DermisError("the device has no such channel", where=where, value=", ".join(unknown))
        rows = []
        for channel in spec.channels:
            entry = self.entries.get(channel.name, Entry())
            lows = [v for v in (channel.low, entry.low) if v is not None]
            highs = [v for v in (channel.high, entry.high) if v is not None]
            low, high = max(lows, default=-math.inf), min(highs, default=math.inf)
            if low > high:
                raise DermisError(
                    "the limits of preset and calibration do not overlap",
                    where=f"{where}, {channel.name}",
                    value=f"{low:g} to {high:g}",
                )
            rows.append((entry.zero, entry.gain, low, high))
        table = np.array(rows, dtype=np.float64)
        return tuple(table.T.copy())

    def findings(self, spec: DeviceSpec, today: date) -> tuple[Finding, ...]:
        """Return findings for a person, before it is used with a device on a day."""
        found = [*self._changed_preset(spec)]
        for name, entry in self.entries.items():
            where = f"calibration of '{self.name or self.device}', {name}"
            found += [old for own in (entry.response, entry.frequency) if own for old in _outdated(own, where, today)]
            if entry.frequency is not None:
                first, last = entry.frequency.span
                hertz, gain = entry.frequency.peak
                found.append(
                    Finding(
                        "info",
                        "frequency-response",
                        "tracks are played through the inverse of its frequency response, live movement is not",
                        where=where,
                        value=f"{first:g} to {last:g} Hz, {gain:.3g} times at {hertz:g} Hz",
                        limit=f"a track has at most {100 * BEYOND:g} % of its movement beyond {last:g} Hz",
                    )
                )
        return tuple(found)

    def _changed_preset(self, spec: DeviceSpec) -> tuple[Finding, ...]:
        if self.spec_hash and self.spec_hash != spec.hash:
            return (
                Finding(
                    "warning",
                    "calibration-of-another-preset",
                    "the preset has changed since the calibration",
                    where=f"calibration of '{self.device}'",
                    value=spec.hash,
                    limit=self.spec_hash,
                    remedy="Look at each actuator again",
                ),
            )
        return ()

    def dumps(self) -> str:
        """Return the calibration as JSON; equal ones give equal text."""
        plain = {
            "schema": SCHEMA,
            "name": self.name,
            "serial": self.serial,
            "device": self.device,
            "spec_hash": self.spec_hash,
            "actuators": {name: _plain(self.entries[name]) for name in sorted(self.entries)},
        }
        return json.dumps(plain, indent=1, allow_nan=False, ensure_ascii=False) + "\n"

    def save(self, path: Path) -> None:
        """Write the file, whole or not at all.

        Raises:
            DermisError: the file cannot be written.
        """
        write_bytes(Path(path), self.dumps().encode("utf-8"))

    @classmethod
    def load(cls, path: Path) -> Calibration:
        """Read a calibration that `save` wrote.

        Raises:
            DermisError: missing, damaged, or of another version.
        """
        return cls.loads(read_text(path), where=str(path))

    @classmethod
    def loads(cls, text: str, *, where: str = "calibration") -> Calibration:
        """Read a calibration from JSON text, of this version or one before.

        Raises:
            DermisError: not one of these versions, or a number or text that cannot be.
        """
        plain = json_of(text, where)
        if not isinstance(plain, dict) or plain.get("schema") not in (SCHEMA, *_OLDER):
            found = plain.get("schema") if isinstance(plain, dict) else type(plain).__name__
            raise DermisError("not a calibration of this version", where=where, value=str(found)[:80], limit=SCHEMA)
        owner = _OWNER if plain["schema"] != _OLDER[0] else ()
        measured = ("response", "frequency") if plain["schema"] == SCHEMA else ("response",)
        wanted = {*_NUMBERS, *(measured if plain["schema"] not in _OLDER[:2] else ())}
        if set(plain) != {"schema", "device", "spec_hash", "actuators", *owner}:
            raise DermisError("fields missing or unknown", where=where)
        for what in owner:
            _check_text(plain[what], f"{where}, {what}")
        device, spec_hash, actuators = plain["device"], plain["spec_hash"], plain["actuators"]
        if not isinstance(device, str) or not isinstance(spec_hash, str) or not isinstance(actuators, dict):
            raise DermisError("a field of another kind", where=where)
        entries = {}
        for name, fields in actuators.items():
            place = f"{where}, {name}"
            if not isinstance(fields, dict) or set(fields) != wanted:
                raise DermisError("fields missing or unknown", where=place, limit=", ".join(sorted(wanted)))
            try:
                curve = Response.of(fields["response"]) if fields.get("response") is not None else None
                vibration = FrequencyResponse.of(fields["frequency"]) if fields.get("frequency") is not None else None
            except DermisError as error:
                raise error.changed(where=f"{place}: {error.where}") from error
            entries[name] = Entry(**{**fields, "response": curve, "frequency": vibration})
            _check(entries[name], place)
        return cls(device, spec_hash, entries, **{what: plain[what] for what in owner})


def _plain(entry: Entry) -> dict[str, Any]:
    numbers = {name: getattr(entry, name) for name in _NUMBERS}
    measured = {"response": entry.response, "frequency": entry.frequency}
    return {**numbers, **{name: None if own is None else own.plain() for name, own in measured.items()}}


def _outdated(measured: Response | FrequencyResponse, where: str, today: date) -> list[Finding]:
    """Find a measurement that is older than it may be, or of a day to come."""
    age = measured.age(today)
    if age is None or (0 <= age and not 0 < measured.valid_days < age):
        return []
    return [
        Finding(
            "warning",
            "calibration-expired" if age >= 0 else "calibration-day-ahead",
            f"calibrated {age} days ago" if age >= 0 else "calibrated on a day to come",
            where=where,
            value=measured.measured_on,
            limit=f"{measured.valid_days} days" if age >= 0 else today.isoformat(),
            remedy="Measure it again" if age >= 0 else "Look at this computer's clock",
        )
    ]


def _check_text(text: object, where: str) -> None:
    if not isinstance(text, str) or len(text) > _LONGEST or not (text.isprintable() and text == text.strip()):
        raise DermisError(
            "not a text of one line",
            where=where,
            value=repr(text)[:80],
            limit=f"at most {_LONGEST} characters that can be seen",
        )


def _check(entry: Entry, where: str) -> None:
    for name in _NUMBERS:
        value = getattr(entry, name)
        if value is None and name in ("low", "high"):
            continue
        # bool is an int, and 10**400 is an int that is no float
        if type(value) not in (int, float) or not abs(value) < 1e12:
            raise DermisError(f"'{name}' is not a finite number", where=where, value=str(value)[:80])
    if entry.gain == 0:
        raise DermisError("a gain of zero does not move the actuator", where=where, value=0, limit="not 0")
    if entry.response is not None and entry.response.latency and entry.frequency is not None:
        raise DermisError(
            "the phase of the frequency response holds the latency already",
            where=where,
            value=f"latency {entry.response.latency:g} s",
            limit="0 s beside a frequency response",
            remedy="Set the curve's latency to 0",
        )
    if entry.low is not None and entry.high is not None and entry.low > entry.high:
        raise DermisError("low is above high", where=where, value=entry.low, limit=f"<= {entry.high}")

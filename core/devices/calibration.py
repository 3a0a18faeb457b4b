"""Calibration: zero, gain, limits and responses of one built device.

    driven = inverse curve of (zero + gain * commanded), then held within low and high

A preset describes all devices of one design; a calibration describes one built device. It is a file of its own, with
the name that a person gave the device, and with the device's serial number if it has one.
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
# Version 1 has neither name nor serial number. Versions 1 and 2 have no curves, versions 1 to 3 no frequency response.
_OLDER = ("dermis-calibration 1", "dermis-calibration 2", "dermis-calibration 3")
_OWNER = ("name", "serial")
_LONGEST = 100  # [characters] longest name and serial number
_NUMBERS = ("zero", "gain", "low", "high")


@dataclass(frozen=True)
class Entry:
    """Calibration of one actuator.

    Attributes:
        zero: value for a command of 0 [unit of the channel].
        gain: change of the value for a change of the command [1]; negative if the actuator is mounted the other way
            round.
        low, high: limits of driven and reached values [unit]; None for the preset's limits.
        response: measured curve from driven to reached values; None if it was not measured.
        frequency: measured frequency response; None if it was not measured.
    """

    zero: float = 0.0
    gain: float = 1.0
    low: float | None = None
    high: float | None = None
    response: Response | None = None
    frequency: FrequencyResponse | None = None


@dataclass(frozen=True)
class Calibration:
    """Calibration of all actuators of one device.

    Attributes:
        device: key of the preset.
        spec_hash: hash of the preset with which the calibration was made.
        entries: entries by channel name; a channel without an entry is driven as commanded.
        name: name of the built device, chosen by a person.
        serial: serial number that the device reports, or the number of its USB port; '' if it has none.
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
            DermisError: a number is not finite, the gain is zero, low is above high, or a curve with a latency is
                beside a frequency response.
        """
        entry = replace(self.entries.get(channel, Entry()), **parts)
        _check(entry, f"calibration, {channel}")
        return replace(self, entries={**self.entries, channel: entry})

    def without_curves(self) -> Calibration:
        """Return the calibration without measured curves and frequency responses."""
        bare = {name: replace(entry, response=None, frequency=None) for name, entry in self.entries.items()}
        return replace(self, entries=bare)

    def owned_by(self, name: str, serial: str = "") -> Calibration:
        """Return the calibration as that of one built device.

        Raises:
            DermisError: a name or serial number is too long, is not printable, or begins or ends with a space.
        """
        for what, text in (("name", name), ("serial", serial)):
            _check_text(text, f"calibration, {what}")
        return replace(self, name=name, serial=serial)

    def for_spec(self, spec: DeviceSpec) -> tuple[NDArray[np.float64], ...]:
        """Return zero, gain, low and high of all channels, (channels,) each.

        A limit is the narrower one of preset and calibration; infinite if neither has one.

        Raises:
            DermisError: the calibration is of another device, names a channel that the device does not have, or its
                limits do not overlap those of the preset.
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
        """Return findings to show before the calibration is used.

        Args:
            spec: preset of the device.
            today: the present day, for the age of measurements.
        """
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
                    remedy="Check each actuator again",
                ),
            )
        return ()

    def dumps(self) -> str:
        """Return the calibration as JSON text; equal calibrations give equal text."""
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
        """Write the calibration to a file, whole or not at all.

        Raises:
            DermisError: the file cannot be written.
        """
        write_bytes(Path(path), self.dumps().encode("utf-8"))

    @classmethod
    def load(cls, path: Path) -> Calibration:
        """Read a calibration that `save` wrote.

        Raises:
            DermisError: the file is missing, damaged, or of another version.
        """
        return cls.loads(read_text(path), where=str(path))

    @classmethod
    def loads(cls, text: str, *, where: str = "calibration") -> Calibration:
        """Read a calibration from JSON text of this version or an older one.

        Args:
            text: the text.
            where: source that errors name.

        Raises:
            DermisError: the text is of another version, or a field is missing, unknown or invalid.
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
            raise DermisError("a field has the wrong type", where=where)
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
    """Return a finding if a measurement has expired or is dated in the future."""
    age = measured.age(today)
    if age is None or (0 <= age and not 0 < measured.valid_days < age):
        return []
    return [
        Finding(
            "warning",
            "calibration-expired" if age >= 0 else "calibration-day-ahead",
            f"calibrated {age} days ago" if age >= 0 else "the day of calibration is in the future",
            where=where,
            value=measured.measured_on,
            limit=f"{measured.valid_days} days" if age >= 0 else today.isoformat(),
            remedy="Measure it again" if age >= 0 else "Check this computer's clock",
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
        # bool is a subclass of int, and 10**400 is an int that no float can hold
        if type(value) not in (int, float) or not abs(value) < 1e12:
            raise DermisError(f"'{name}' is not a finite number", where=where, value=str(value)[:80])
    if entry.gain == 0:
        raise DermisError("a gain of zero does not move the actuator", where=where, value=0, limit="not 0")
    if entry.response is not None and entry.response.latency and entry.frequency is not None:
        raise DermisError(
            "the phase of the frequency response already contains the latency",
            where=where,
            value=f"latency {entry.response.latency:g} s",
            limit="0 s beside a frequency response",
            remedy="Set the curve's latency to 0",
        )
    if entry.low is not None and entry.high is not None and entry.low > entry.high:
        raise DermisError("low is above high", where=where, value=entry.low, limit=f"<= {entry.high}")

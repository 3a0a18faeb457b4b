"""What one built device differs by from its preset: zero, gain and limits of each actuator, in a file of their own.

    driven = zero + gain * commanded, then held within low and high

A calibration belongs to one built device; presets belong to everyone. So it is a file of its own, which says whose it
is: by the name that a person gave the device, and by its serial number where it has one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError, Finding
from ..files import read_text, write_bytes
from ..foreign import json_of
from .spec import DeviceSpec

SCHEMA = "dermis-calibration 2"
_OLDER = "dermis-calibration 1"  # knew neither name nor serial
_OWNER = ("name", "serial")
_LONGEST = 100  # of a name or serial [characters]
_NUMBERS = ("zero", "gain", "low", "high")


@dataclass(frozen=True)
class Entry:
    """One actuator.

    Attributes:
        zero: what is driven for a command of 0 [unit of the channel].
        gain: driven change for a commanded change [1]; negative where it is mounted the other way round.
        low, high: what may be driven [unit]; None: the preset's own limits.
    """

    zero: float = 0.0
    gain: float = 1.0
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class Calibration:
    """All actuators of one device.

    Attributes:
        device: the preset's key. spec_hash: of the preset that it was made with.
        entries: by channel name; a channel that has none is driven as commanded.
        name: of the built device, as a person gave it. serial: what it answers with, or the number of its USB port;
            '' where it has none.
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

    def with_entry(self, channel: str, **numbers: float | None) -> Calibration:
        """Return a calibration with some numbers of a channel replaced.

        Raises:
            DermisError: a number that is not finite, a gain of zero, or low above high.
        """
        entry = Entry(**{**asdict(self.entries.get(channel, Entry())), **numbers})
        _check(entry, f"calibration, {channel}")
        return replace(self, entries={**self.entries, channel: entry})

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
                    "the limits of preset and calibration leave nothing",
                    where=f"{where}, {channel.name}",
                    value=f"{low:g} to {high:g}",
                )
            rows.append((entry.zero, entry.gain, low, high))
        table = np.array(rows, dtype=np.float64)
        return tuple(table.T.copy())

    def findings(self, spec: DeviceSpec) -> tuple[Finding, ...]:
        """Return what a person should know before it is used with a device."""
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
            "actuators": {name: asdict(self.entries[name]) for name in sorted(self.entries)},
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
        """Read what `save` wrote.

        Raises:
            DermisError: missing, damaged, or of another version.
        """
        return cls.loads(read_text(path), where=str(path))

    @classmethod
    def loads(cls, text: str, *, where: str = "calibration") -> Calibration:
        """Read a calibration from JSON text, of this version or the one before.

        Raises:
            DermisError: not one of these versions, or a number or text that cannot be.
        """
        plain = json_of(text, where)
        if not isinstance(plain, dict) or plain.get("schema") not in (SCHEMA, _OLDER):
            found = plain.get("schema") if isinstance(plain, dict) else type(plain).__name__
            raise DermisError("not a calibration of this version", where=where, value=str(found)[:80], limit=SCHEMA)
        owner = _OWNER if plain["schema"] == SCHEMA else ()
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
            if not isinstance(fields, dict) or set(fields) != set(_NUMBERS):
                raise DermisError("fields missing or unknown", where=place, limit=", ".join(_NUMBERS))
            entries[name] = Entry(**fields)
            _check(entries[name], place)
        return cls(device, spec_hash, entries, **{what: plain[what] for what in owner})


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
        raise DermisError("a gain of zero moves nothing", where=where, value=0, limit="not 0")
    if entry.low is not None and entry.high is not None and entry.low > entry.high:
        raise DermisError("low is above high", where=where, value=entry.low, limit=f"<= {entry.high}")

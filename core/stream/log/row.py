"""The rows and the header of a log.

A row is one sample of one device, with all channels of its command.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import DermisError

SCHEMA = "dermis-stream-log 2"
FIRST_SCHEMA = "dermis-stream-log 1"  # the first version, without measurements beside the pose
BLOCKS = ("commanded", "limited", "sent", "reported")  # fields with one value for each channel
Rows = NDArray[np.void]


class Phase(IntEnum):
    """The part of the stream that a sample belongs to."""

    LIVE = 0  # a sample of the source: track, preview, hand or finger
    RAMP = 1  # a step of a ramp to the safe state, commanded by the sender
    SAFE = 2  # the safe state itself, or the message that makes the device go there


class Fate(IntEnum):
    """The outcome of a sample."""

    SENT = 0
    LATE = 1  # sent after its time
    DROPPED = 2  # not sent: the link had no room, or the stream ended before


# Fields before the values of a row, in the ring and in files: 48 bytes without gaps.
HEAD: tuple[tuple[str, str], ...] = (
    ("number", "<u8"),  # number of the sample, from 0; a lost row leaves a gap
    ("time", "<f8"),  # [s] time at which the sample was sent or dropped
    ("play", "<f8"),  # [s] play-out time; NaN: at once
    ("track", "<f8"),  # [s] time within the track; NaN: the sample belongs to no track
    ("heard", "<f8"),  # [s] time at which the device reported the pose; NaN: it has reported none
    ("skipped", "<u4"),  # number of samples that were left out just before this one
    ("phase", "u1"),
    ("fate", "u1"),
    ("", "V2"),
)


def file_rows(channels: int, sensed: int = 0) -> np.dtype[np.void]:
    """Return the layout of rows in files and datagrams.

    Values are float32, little-endian, without gaps.

    Args:
        channels: number of channels. sensed: number of quantities that the device measures beside its pose; the field
            'sensed' has the shape (sensed, channels).
    """
    return _layout("<f4", BLOCKS, channels, sensed)


def ring_rows(channels: int, sensed: int = 0) -> np.dtype[np.void]:
    """Return the layout of rows in the ring, with values as float64.

    The field 'sent' is missing; the writing process computes it. See `file_rows`.
    """
    return _layout("<f8", tuple(name for name in BLOCKS if name != "sent"), channels, sensed)


def _layout(number: str, blocks: tuple[str, ...], channels: int, sensed: int) -> np.dtype[np.void]:
    head = [(name or "unused", kind) for name, kind in HEAD]
    values = [(name, number, (channels,)) for name in blocks]
    return np.dtype([*head, *values, ("sensed", number, (sensed, channels))])


def values_of(rows: Rows) -> NDArray[np.floating]:
    """Return all values of rows of a file, shape (rows, columns).

    The columns are in the order of `LogHeader.columns`.
    """
    blocks = [*(rows[name] for name in BLOCKS), *np.moveaxis(rows["sensed"], 1, 0)]
    return np.concatenate(blocks, axis=1)


@dataclass(frozen=True)
class Channel:
    """Name and unit of a channel, or of a quantity that a device measures."""

    name: str
    unit: str


@dataclass(frozen=True)
class LogHeader:
    """The header of every file of a log.

    Attributes:
        log: identifier of the log, the same in all its files. file: number of this file, from 1.
        removed: number of older files of this log that were removed before this file began.
        started: wall-clock time of the rows' time 0, UTC, as ISO 8601. started_unix: the same [s since 1970].
        clock: stream clock of this computer at the rows' time 0 [s].
        device, name, preset: key, name and hash of the device preset. protocol, url: protocol and URL of the link.
        rate: planned command rate [Hz]. channels: channels in the order of the values.
        zero, gain: zero and gain of the calibration when the log began, one value for each channel. Before limits,
            limited = zero + gain * commanded. A measured curve of the calibration is inverted after that.
        program: name of the program that wrote the log.
        sensed: quantities that the device measures beside its pose, in the order of the values.
    """

    log: str
    started: str
    started_unix: float
    clock: float
    device: str
    name: str
    preset: str
    protocol: str
    url: str
    rate: float
    channels: tuple[Channel, ...]
    zero: tuple[float, ...]
    gain: tuple[float, ...]
    program: str
    file: int = 1
    removed: int = 0
    sensed: tuple[Channel, ...] = ()

    def plain(self) -> dict[str, Any]:
        """Return the header as JSON values."""
        return {"schema": SCHEMA, **asdict(self)}

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of values, with units.

        Examples are 'commanded.pulley_1[rad]' and 'temperature.pulley_1[degC]'.
        """
        values = [f"{block}.{c.name}[{c.unit}]" for block in BLOCKS for c in self.channels]
        return (*values, *(f"{q.name}.{c.name}[{q.unit}]" for q in self.sensed for c in self.channels))


def header_of(plain: Mapping[str, Any], where: str) -> LogHeader:
    """Read a header from JSON values.

    Raises:
        DermisError: another schema, or a field that is missing, unknown or of a wrong type.
    """
    if plain.get("schema") not in (SCHEMA, FIRST_SCHEMA):
        limit = f"{SCHEMA} or {FIRST_SCHEMA}"
        raise DermisError(
            "not a log of this version", where=where, value=plain.get("schema"), limit=limit, remedy="Update Dermis"
        )
    given = {name: value for name, value in plain.items() if name != "schema"}
    names = {field.name for field in fields(LogHeader)} - ({"sensed"} if plain["schema"] == FIRST_SCHEMA else set())
    if set(given) != names:
        raise DermisError("fields of the header are missing or unknown", where=where, value=sorted(set(given) ^ names))
    given.setdefault("sensed", [])
    channels = given["channels"]
    if not isinstance(channels, list) or not 0 < len(channels) < 256:
        raise DermisError("no list of 1 to 255 channels", where=where)
    sensed = given["sensed"]
    if not isinstance(sensed, list) or len(sensed) > 16:
        raise DermisError("no list of at most 16 measured quantities", where=where)
    if not all(isinstance(c, dict) and set(c) == {"name", "unit"} and _texts(c.values()) for c in channels + sensed):
        raise DermisError("a channel or a measured quantity is not a name and a unit", where=where)
    for name in ("zero", "gain"):
        if not isinstance(given[name], list) or len(given[name]) != len(channels) or not _numbers(given[name]):
            raise DermisError("one number per channel is needed", where=f"{where}, {name}")
    texts = ("log", "started", "device", "name", "preset", "protocol", "url", "program")
    if not _texts(given[name] for name in texts) or not _numbers(given[n] for n in ("started_unix", "clock", "rate")):
        raise DermisError("a field of the header has the wrong type", where=where)
    if type(given["file"]) is not int or type(given["removed"]) is not int:
        raise DermisError("a field of the header has the wrong type", where=where)
    numbers = {name: tuple(map(float, given[name])) for name in ("zero", "gain")}
    lists = {name: tuple(Channel(c["name"], c["unit"]) for c in given[name]) for name in ("channels", "sensed")}
    return LogHeader(**{**given, **numbers, **lists})


def _texts(values: Any) -> bool:
    return all(isinstance(value, str) for value in values)


def _numbers(values: Any) -> bool:
    return all(isinstance(v, int | float) and not isinstance(v, bool) and abs(v) < 1e300 for v in values)

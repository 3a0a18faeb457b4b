"""Command tracks as compact binary, version 1: 4 bytes per value.

A file is little-endian and has a check sum:

    8 bytes   magic 89 44 52 4D 54 0D 0A 01 (0x89 "DRMT" CR LF, version 1); a copy in text mode would change it
    u32       length of the header [bytes]
    header    UTF-8 JSON: schema, device, channels, times, meta, limited, `low` and `high` (one number per channel)
    f64[n]    times [s], only if they are no regular grid
    u32[c][n] values, channel by channel: value = low + (high - low) * number / (2^32 - 1)
    u32       CRC-32 (that of zlib) of all bytes before it

`low` and `high` are the smallest and the largest value of the track in a channel. The steps between them are equal, so
the error of any value is at most (high - low) / 2^33. No device can resolve steps as small as that. For values
near zero, CSV with its nine digits is more accurate: in a channel from -1 to 1, 1.25e-11 is read back as about 1e-10,
and 0 as a number of that size. JSON keeps every digit.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import DermisError
from ..files import read_bytes, write_bytes
from ..foreign import json_of
from .command_track import CommandTrack
from .track_header import check_finite, check_schema, grid_of, header_of, text_of, track_of

SCHEMA = "dermis-track-binary 1"
MAGIC = b"\x89DRMT\r\n\x01"
STEPS = 2**32 - 1  # largest number that stands for a value
LARGEST = 1e150  # bound of values, so that the difference of two values is finite


def write(track: CommandTrack, path: Path) -> None:
    """Write a track as compact binary in one atomic step.

    Raises:
        DermisError: see `dumps`; or the file cannot be written.
    """
    write_bytes(Path(path), dumps(track))


def dumps(track: CommandTrack) -> bytes:
    """Return a track as bytes; equal tracks give equal bytes.

    Raises:
        DermisError: a time or a value is not finite, an absolute value is 1e150 or more, the times do not rise, or the
            header cannot hold an entry.
    """
    check_finite(track)
    if track.values.size and np.abs(track.values).max() >= LARGEST:
        raise DermisError(
            "a value too large for this format",
            where=f"track of '{track.spec.key}'",
            value=float(np.abs(track.values).max()),
            limit=f"< {LARGEST:g}",
        )
    empty = len(track.times) == 0
    low = np.zeros(len(track.channels)) if empty else track.values.min(axis=0)
    high = np.zeros(len(track.channels)) if empty else track.values.max(axis=0)
    span = np.where(high > low, high - low, 1.0)
    numbers = np.rint((track.values - low) / span * STEPS).astype("<u4")
    header = header_of(track, SCHEMA) | {"low": low.tolist(), "high": high.tolist()}
    text = text_of(header).encode("utf-8")
    times = b"" if "first" in header["times"] else track.times.astype("<f8").tobytes()
    body = MAGIC + struct.pack("<I", len(text)) + text + times + numbers.T.tobytes()
    return body + struct.pack("<I", zlib.crc32(body))


def read(path: Path) -> CommandTrack:
    """Read a track from a binary file.

    Raises:
        DermisError: the file cannot be read, is no binary track of this version, or is damaged.
    """
    return loads(read_bytes(Path(path)), where=str(path))


def loads(data: bytes, *, where: str = "track") -> CommandTrack:
    """Read a track from bytes.

    Raises:
        DermisError: the bytes are no binary track of this version, or are damaged.
    """
    if not data.startswith(MAGIC[:-1]):
        raise DermisError("not a binary track", where=where, value=data[:8].hex(" "), limit=MAGIC.hex(" "))
    if data[7:8] not in (MAGIC[7:], b""):
        raise DermisError(
            "written by a newer version of Dermis",
            where=where,
            value=data[7],
            limit=str(MAGIC[7]),
            remedy="Update Dermis",
        )
    if len(data) < 16 or struct.unpack("<I", data[-4:])[0] != zlib.crc32(data[:-4]):
        raise DermisError(
            "the file is damaged or cut short: its check sum is wrong", where=where, remedy="Copy or export it again"
        )
    size = struct.unpack_from("<I", data, 8)[0]
    header = check_schema(json_of(data[12 : 12 + size], f"{where}, header"), SCHEMA, ("low", "high"), where)
    number, times = grid_of(header, where)
    channels = len(header["channels"]) if isinstance(header["channels"], list) else 0
    low, high = (_numbers(header[k], channels, f"{where}, {k}") for k in ("low", "high"))
    body = data[12 + size : -4]
    if len(body) != number * (4 * channels + (8 if times is None else 0)):
        raise DermisError("the number of samples is not the one stated", where=where, value=len(body))
    if times is None:
        times = np.frombuffer(body, "<f8", number).astype(np.float64)
        body = body[8 * number :]
        if not np.isfinite(times).all():
            raise DermisError("a time is not a finite number", where=where)
    numbers = np.frombuffer(body, "<u4").reshape(channels, number).T
    values = low + (high - low) * (numbers.astype(np.float64) / STEPS)
    return track_of(header, times, np.ascontiguousarray(values), where)


def _numbers(value: Any, count: int, where: str) -> np.ndarray:
    good = isinstance(value, list) and len(value) == count
    if not good or not all(type(v) in (int, float) and abs(v) < LARGEST for v in value):
        raise DermisError("needs one finite number per channel", where=where, value=str(value)[:80])
    return np.array([float(v) for v in value])

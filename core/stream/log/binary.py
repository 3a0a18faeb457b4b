"""The binary log format, version 2: blocks of rows with checksums.

A file whose writing was interrupted is readable up to its last whole block. All numbers are little-endian:

    8 bytes   magic 89 44 52 4D 4C 0D 0A 02 (0x89 "DRML" CR LF, version 2)
    u32       length of the header
    header    UTF-8 JSON
    u32       CRC-32 (zlib's) of everything before it
    blocks    u32 number of rows n, u32 CRC-32 of n and the rows, n rows
    end       u32 FF FF FF FF, u32 length, u32 CRC-32 of both and the text, UTF-8 JSON; only in a complete file

A row: number u64, time f64, play f64, track f64, heard f64, skipped u32, phase u8, fate u8, 2 bytes of 0, then f32
commanded, limited, sent and reported, each for all channels, and each quantity of the header's `sensed` for all
channels. Version 1 has no `sensed`, and is read, too.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import DermisError
from ...files import read_bytes
from ...foreign import MAX_SETTINGS, json_of
from .row import Fate, LogHeader, Phase, Rows, file_rows, header_of

MAGIC = b"\x89DRML\r\n\x02"
READ = MAGIC[7:], b"\x01"  # versions that are read
END = 0xFFFFFFFF  # takes the place of a number of rows before the end
_PAIR = struct.Struct("<II")


class BinaryForm:
    """The binary format of log files."""

    def head(self, header: LogHeader) -> bytes:
        """Return the header of a file."""
        text = json.dumps(header.plain()).encode()
        data = MAGIC + struct.pack("<I", len(text)) + text
        return data + struct.pack("<I", zlib.crc32(data))

    def rows(self, rows: Rows) -> bytes:
        """Return one block; b'' without rows."""
        count, data = struct.pack("<I", len(rows)), rows.tobytes()
        return count + struct.pack("<I", zlib.crc32(data, zlib.crc32(count))) + data if len(rows) else b""

    def end(self, summary: Mapping[str, Any]) -> bytes:
        """Return the footer of a complete file."""
        text = json.dumps(dict(summary)).encode()
        start = _PAIR.pack(END, len(text))
        return start + struct.pack("<I", zlib.crc32(text, zlib.crc32(start))) + text


@dataclass(frozen=True)
class LogFile:
    """One file of a log.

    Attributes:
        header: metadata of the stream. rows: rows in the layout `row.file_rows`.
        end: summary at the end of the file; None if the file is incomplete, or still grows.
        unread: number of bytes after the last whole block.
    """

    header: LogHeader
    rows: Rows
    end: Mapping[str, Any] | None
    unread: int

    @property
    def lost(self) -> int:
        """Number of rows lost because the ring was full.

        It is 0 if the file has no summary.
        """
        said = (self.end or {}).get("lost", 0)
        return said if type(said) is int else 0


def read(path: Path) -> LogFile:
    """Read a binary log, up to its last whole block.

    Raises:
        DermisError: the file is no binary log of this version, or its header is damaged.
    """
    return loads(read_bytes(Path(path)), where=str(path))


def loads(data: bytes, *, where: str = "log") -> LogFile:
    """Read a binary log from bytes; see `read`.

    Raises:
        DermisError: the data are no binary log of this version, or the header is damaged.
    """
    if not data.startswith(MAGIC[:-1]):
        raise DermisError("not a binary log", where=where, value=data[:8].hex(" "), limit=MAGIC.hex(" "))
    if data[7:8] not in READ:
        raise DermisError(
            "written by another version of Dermis", where=where, value=data[7:8].hex(), limit="01, 02", remedy="Update"
        )
    size = int.from_bytes(data[8:12], "little")
    at = 12 + size + 4
    if (
        len(data) < at
        or size > MAX_SETTINGS
        or int.from_bytes(data[at - 4 : at], "little") != zlib.crc32(data[: at - 4])
    ):
        raise DermisError("the header of the log is damaged or cut short", where=where, remedy="Copy the file again")
    plain = json_of(data[12 : 12 + size], f"{where}, header")
    if not isinstance(plain, dict):
        raise DermisError("the header of the log is not a JSON object", where=where)
    header = header_of(plain, f"{where}, header")
    layout = file_rows(len(header.channels), len(header.sensed))
    parts, end = [], None
    while at + _PAIR.size <= len(data):
        count, check = _PAIR.unpack_from(data, at)
        if count == END:
            found = _end(data, at, where)
            if found is not None:
                end, at = found
            break
        stop = at + _PAIR.size + count * layout.itemsize
        if not count or stop > len(data):
            break
        block = data[at + _PAIR.size : stop]
        if zlib.crc32(block, zlib.crc32(data[at : at + 4])) != check:
            break
        parts.append(np.frombuffer(block, layout))
        at = stop
    rows = np.concatenate(parts) if parts else np.zeros(0, layout)
    if (rows["phase"] > max(Phase)).any() or (rows["fate"] > max(Fate)).any():
        raise DermisError("a row of a kind that this version does not know", where=where, remedy="Update Dermis")
    return LogFile(header, rows, end, len(data) - at)


def _end(data: bytes, at: int, where: str) -> tuple[Mapping[str, Any], int] | None:
    """Return the summary at offset `at`, and the offset after it [bytes].

    None: the summary is cut or damaged.
    """
    _, size = _PAIR.unpack_from(data, at)
    text = data[at + 12 : at + 12 + size]
    check = int.from_bytes(data[at + 8 : at + 12], "little")
    if len(text) != size or size > MAX_SETTINGS or zlib.crc32(text, zlib.crc32(data[at : at + 8])) != check:
        return None
    plain = json_of(text, f"{where}, end")
    return (plain, at + 12 + size) if isinstance(plain, dict) else None

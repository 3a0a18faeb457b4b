"""Shared memory of two processes, and a record in it.

The memory is a mapped file. One process writes the record and the other reads it.
"""

from __future__ import annotations

import mmap
import os
import struct
import tempfile
import zlib
from pathlib import Path

from ..errors import DermisError

_SLOT = struct.Struct("<QII")  # number, length, CRC-32 of number and record


def create(prefix: str, size: int) -> tuple[Path, int]:
    """Create a file of zeros that only this user may read.

    The file is in memory if the system has /dev/shm. All its pages are allocated before it is mapped, because a page
    that cannot be allocated later would crash the process.

    Returns:
        Path and open descriptor of the file.

    Raises:
        DermisError: there is not enough room.
    """
    shared = Path("/dev/shm")
    folder = str(shared) if shared.is_dir() and os.access(shared, os.W_OK) else None
    descriptor, name = tempfile.mkstemp(prefix=prefix, dir=folder)
    try:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(descriptor, 0, size)
        else:
            left = size
            while left:
                left -= os.write(descriptor, bytes(min(left, 1 << 20)))
    except OSError as error:
        os.close(descriptor)
        os.unlink(name)
        raise DermisError("no room for shared memory", where=name, value=f"{size} bytes, {error.strerror}") from error
    return Path(name), descriptor


def mapped(descriptor: int, size: int) -> mmap.mmap:
    """Map an open file into memory, and close its descriptor."""
    try:
        return mmap.mmap(descriptor, size)
    finally:
        os.close(descriptor)


class MappedRecord:
    """A record in a mapped file, without locks.

    It is written into two slots in turn, each with a number and a CRC-32. The newest complete slot is valid, so neither
    side waits and a reader never gets an incomplete record.

    Args:
        memory: the mapped file.
        offset, size: offset and size of the first of the two slots [bytes].
    """

    def __init__(self, memory: mmap.mmap, offset: int, size: int) -> None:
        self._memory, self._offset, self._size = memory, offset, size
        self._number = max((self._slot(k)[0] for k in (0, 1)), default=0)

    def put(self, data: bytes) -> None:
        """Write a new record.

        Raises:
            DermisError: the record is too long.
        """
        if len(data) > self._size - _SLOT.size:
            raise DermisError(
                "a record is too long for the shared state", value=len(data), limit=str(self._size - _SLOT.size)
            )
        self._number += 1
        at = self._offset + (self._number & 1) * self._size
        self._memory[at + _SLOT.size : at + _SLOT.size + len(data)] = data
        crc = zlib.crc32(data, self._number & 0xFFFFFFFF)
        self._memory[at : at + _SLOT.size] = _SLOT.pack(self._number, len(data), crc)

    def number(self) -> int:
        """Return the number of the newest record, which may still be incomplete."""
        numbers = [struct.unpack_from("<Q", self._memory, self._offset + k * self._size)[0] for k in (0, 1)]
        return int(max(numbers))

    def get(self) -> tuple[int, bytes] | None:
        """Return number and data of the newest complete record.

        The result is None before the first record.
        """
        found = max((self._slot(k) for k in (0, 1)), key=lambda s: s[0])
        return found if found[0] else None

    def _slot(self, k: int) -> tuple[int, bytes]:
        at = self._offset + k * self._size
        number, length, crc = _SLOT.unpack_from(self._memory, at)
        if not number or length > self._size - _SLOT.size:
            return 0, b""
        data = self._memory[at + _SLOT.size : at + _SLOT.size + length]
        return (number, data) if zlib.crc32(data, number & 0xFFFFFFFF) == crc else (0, b"")

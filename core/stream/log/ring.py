"""A ring buffer of rows between the sender and the writing process.

It is memory that both processes map. The sender adds rows without waiting and without allocating memory. If the ring is
full, new rows are lost and counted.
"""

from __future__ import annotations

import contextlib
import json
import mmap
import os
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...arrays import Array
from ...errors import DermisError
from ...work.mapped import MappedRecord, create, mapped
from .row import Rows, ring_rows

MAGIC = b"DERMIS-RING 2\0\0\0"
SECONDS = 10.0  # [s] time of the rows that fit: the writing process may pause for so long, as for a slow disk
LEAST = 1024  # [rows] smallest capacity
STATUS_BYTES = 1 << 14  # [bytes] size of one of the two records of the status
MOST_AT_ONCE = 4096  # [rows] largest number taken out at once
_SHAPE = struct.Struct("<IHHI")  # rows, channels, measured quantities, bytes of the setup
_WORDS = 32  # [bytes] offset of the counters, of 8 aligned bytes each, so that no reader sees a half-written one
_HEAD, _TAIL, _LOST = 0, 1, 2  # rows put in, rows taken out, rows lost
_ROW = struct.Struct("<Q4dIBBxx")  # the fields of `row.HEAD`
_START = 64  # [bytes] offset of the status


class Ring:
    """Rows between one process that adds them and one that takes them out.

    Attributes:
        path: path of the mapped file. channels, sensed: number of channels, and of measured quantities, in a row.
        capacity: number of rows that fit. setup: configuration of the writer, as JSON values.
    """

    def __init__(self, path: Path, memory: mmap.mmap, capacity: int, channels: int, sensed: int, setup: int) -> None:
        self.path, self.channels, self.sensed, self.capacity = path, channels, sensed, capacity
        self._memory = memory
        self._words = memoryview(memory)[_WORDS : _WORDS + 24].cast("Q")
        self._status = MappedRecord(memory, _START, STATUS_BYTES)
        at = _START + 2 * STATUS_BYTES
        self.setup: dict[str, Any] = json.loads(memory[at : at + setup] or b"{}")
        self._start, layout = _rows_at(setup), ring_rows(channels, sensed)
        self._width = layout.itemsize
        self._rows: Rows = np.frombuffer(memory, layout, capacity, self._start)
        self._commanded, self._limited, self._reported, self._sensed = (
            self._rows[name] for name in ("commanded", "limited", "reported", "sensed")
        )
        self._unknown = np.full(channels, np.nan)
        self._number = self._seen = 0

    @classmethod
    def create(cls, channels: int, capacity: int, setup: Mapping[str, Any], *, sensed: int = 0) -> Ring:
        """Make a ring.

        Args:
            channels: number of channels in a row. capacity: number of rows that fit. setup: configuration of the
                writer, as JSON values. sensed: number of quantities that the device measures beside its pose.

        Raises:
            DermisError: there is no memory for the ring.
        """
        text = json.dumps(setup).encode()
        size = _rows_at(len(text)) + capacity * ring_rows(channels, sensed).itemsize
        path, descriptor = create("dermis-ring-", size)
        os.lseek(descriptor, 0, os.SEEK_SET)
        os.write(descriptor, MAGIC + _SHAPE.pack(capacity, channels, sensed, len(text)))
        memory = mapped(descriptor, size)
        at = _START + 2 * STATUS_BYTES
        memory[at : at + len(text)] = text
        return cls(path, memory, capacity, channels, sensed, len(text))

    @classmethod
    def open(cls, path: Path) -> Ring:
        """Open the ring of another process.

        Raises:
            DermisError: the file cannot be opened, or is not a ring of this version.
        """
        try:
            descriptor = os.open(path, os.O_RDWR | getattr(os, "O_BINARY", 0))
        except OSError as error:
            raise DermisError("the ring cannot be opened", where=str(path), value=error.strerror) from error
        size, start = os.fstat(descriptor).st_size, os.read(descriptor, len(MAGIC) + _SHAPE.size)
        if not start.startswith(MAGIC) or len(start) < len(MAGIC) + _SHAPE.size:
            os.close(descriptor)
            raise DermisError("not a ring of this version", where=str(path))
        capacity, channels, sensed, setup = _SHAPE.unpack_from(start, len(MAGIC))
        if size != _rows_at(setup) + capacity * ring_rows(channels, sensed).itemsize:
            os.close(descriptor)
            raise DermisError("the ring has another size than it states", where=str(path), value=size)
        return cls(path, mapped(descriptor, size), capacity, channels, sensed, setup)

    def put(
        self,
        time: float,
        play: float,
        track: float,
        heard: float,
        skipped: int,
        phase: int,
        fate: int,
        commanded: Array,
        limited: Array,
        reported: Array | None,
        sensed: Sequence[Array] = (),
    ) -> None:
        """Add a row within a few microseconds.

        If the ring is full, the row is lost and counted. See `row.HEAD` for the numbers.

        Args:
            commanded, limited, reported: values [units], shape (channels,); `reported` is None for an unknown pose.
            sensed: one array of shape (channels,) for each measured quantity; empty before the first measurement.
        """
        words = self._words
        number, self._number = self._number, self._number + 1
        head = words[_HEAD]
        if head - words[_TAIL] >= self.capacity:
            words[_LOST] += 1
            return
        k = head % self.capacity
        at = self._start + k * self._width
        _ROW.pack_into(self._memory, at, number, time, play, track, heard, skipped, phase, fate)
        self._commanded[k] = commanded
        self._limited[k] = limited
        self._reported[k] = self._unknown if reported is None else reported
        if self.sensed:
            self._sensed[k] = sensed or self._unknown
        words[_HEAD] = head + 1  # written last, so that no incomplete row is taken out

    def take(self, *, last: bool = False) -> Rows:
        """Take rows out in their order, at most `MOST_AT_ONCE`.

        Only rows that were in the ring at the previous call are taken. They are complete even on a processor that
        reorders its stores.

        Args:
            last: the sender adds no more rows, so rows that were added since the previous call may be taken, too.
        """
        words, head = self._words, self._words[_HEAD]
        upto, self._seen = (head if last else self._seen), head
        tail = words[_TAIL]
        first = tail % self.capacity
        count = max(min(upto - tail, MOST_AT_ONCE, self.capacity - first), 0)
        rows = self._rows[first : first + count].copy()
        words[_TAIL] = tail + count
        return rows

    @property
    def lost(self) -> int:
        """Number of rows lost because the ring was full."""
        return int(self._words[_LOST])

    @property
    def waiting(self) -> int:
        """Number of rows that have not been taken out yet."""
        return int(self._words[_HEAD] - self._words[_TAIL])

    def write_status(self, status: Mapping[str, Any]) -> None:
        """Publish the status of the writing process."""
        self._status.put(json.dumps(status).encode())

    @property
    def status_number(self) -> int:
        """Number of the newest status."""
        return self._status.number()

    def read_status(self) -> dict[str, Any]:
        """Return the status of the writing process; empty before the first one."""
        found = self._status.get()
        return dict(json.loads(found[1])) if found else {}

    def close(self) -> None:
        """Release the memory; the file stays until `remove`. Safe to call twice."""
        if self._memory.closed:
            return
        self._words.release()
        del self._rows, self._commanded, self._limited, self._reported, self._sensed
        self._memory.close()

    def remove(self) -> None:
        """Remove the file; a process that has mapped it can still use it.

        Safe to call twice, and from both processes.
        """
        with contextlib.suppress(PermissionError):  # Windows: the other process still has it open
            self.path.unlink(missing_ok=True)


def _rows_at(setup: int) -> int:
    """Return the offset of the first row, which is a multiple of 64."""
    return (_START + 2 * STATUS_BYTES + setup + 63) // 64 * 64

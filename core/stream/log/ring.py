"""Ring: rows on their way from the sender to the process that writes them, in memory that both map.

The sender puts rows in without waiting and without asking for memory. A ring that is full loses rows, and counts them.
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
SECONDS = 10.0  # of rows that fit: how long whoever writes may stand still, for a slow disk or a busy machine [s]
LEAST = 1024  # rows
STATUS_BYTES = 1 << 14
MOST_AT_ONCE = 4096  # rows
_SHAPE = struct.Struct("<IHHI")  # rows, channels, measured quantities, bytes of the setup
_WORDS = 32  # offset of the words that change: 8 bytes each, so that no reader sees half of one
_HEAD, _TAIL, _LOST = 0, 1, 2  # rows put in, rows taken out, rows lost
_ROW = struct.Struct("<Q4dIBBxx")
_START = 64


class Ring:
    """Rows between one process that puts them in and one that takes them out.

    Attributes:
        path: of the mapped file. channels, sensed: of a row. capacity: rows. setup: configuration of the writer,
            plain JSON.
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
        """Make a ring. `sensed`: quantities that the device measures beside its pose.

        Raises:
            DermisError: there is no room for it.
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
        """Open another process's ring.

        Raises:
            DermisError: it is none.
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
        """Put a row in; in a full ring it is lost, and counted. Costs a few microseconds.

        `sensed`: an array a quantity, each with a value a channel; none of them where nothing was measured yet.
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
        words[_HEAD] = head + 1  # last, so that nobody takes a row that is not whole

    def take(self, *, last: bool = False) -> Rows:
        """Take rows out, in their order; some of them, where there are many.

        Only rows that were there at the call before are taken, so that on processors that reorder their stores they
        are whole too.

        Args:
            last: nobody puts in more: all that is there is taken.
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
        """Rows that found no room."""
        return int(self._words[_LOST])

    @property
    def waiting(self) -> int:
        """Rows that nobody has taken out yet."""
        return int(self._words[_HEAD] - self._words[_TAIL])

    def write_status(self, status: Mapping[str, Any]) -> None:
        """Tell how the writing stands."""
        self._status.put(json.dumps(status).encode())

    @property
    def status_number(self) -> int:
        """Number of the newest status."""
        return self._status.number()

    def read_status(self) -> dict[str, Any]:
        """Return how the writing stands; empty before the first status."""
        found = self._status.get()
        return dict(json.loads(found[1])) if found else {}

    def close(self) -> None:
        """Let go of the memory; the file stays until `remove`. Safe to call twice."""
        if self._memory.closed:
            return
        self._words.release()
        del self._rows, self._commanded, self._limited, self._reported, self._sensed
        self._memory.close()

    def remove(self) -> None:
        """Remove the file; who has it mapped keeps it. Safe to call twice, and by both sides."""
        with contextlib.suppress(PermissionError):  # Windows: the other side still has it
            self.path.unlink(missing_ok=True)


def _rows_at(setup: int) -> int:
    """Return the offset of the first row, which is a multiple of 64."""
    return (_START + 2 * STATUS_BYTES + setup + 63) // 64 * 64

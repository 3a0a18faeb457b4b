"""State shared by Blender and the sender, in a small mapped file.

Each side writes its latest records there. Nobody ever waits and nothing queues up: a record replaces the one before.
Every record lies in one of two slots with a number and a CRC-32. The newest whole one counts, so a reader never sees
half a record.
"""

from __future__ import annotations

import contextlib
import json
import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import clock
from ..errors import DermisError
from ..work.mapped import MappedRecord, create, mapped

MAGIC = b"DERMIS-SHARED 3\0"
_HEARTBEAT = struct.Struct("<IBddH")  # stops, flags, time [s], when it was given [s], how many values
HEARTBEAT_BYTES, REQUEST_BYTES, STATUS_BYTES = 4096, 1 << 20, 1 << 16
MAX_VALUES = 255
PLAYING, HAS_TIME = 1, 2


@dataclass(frozen=True)
class Heartbeat:
    """Blender's sign of life, with the state that it shows.

    Attributes:
        number: rises with every heartbeat. stops: rises with every stop. playing: playback runs.
        time: track time on the screen [s], or None. at: when the heartbeat was written [s], None for just now.
        values: values of the wire's channels to follow; may be empty.
    """

    number: int
    stops: int
    playing: bool
    time: float | None
    values: tuple[float, ...]
    at: float | None = None


class SharedState:
    """One side's view of the shared state.

    Blender makes it by `create`, and the sender by `open`.
    """

    SIZE = len(MAGIC) + 2 * (HEARTBEAT_BYTES + REQUEST_BYTES + STATUS_BYTES)

    def __init__(self, path: Path, descriptor: int) -> None:
        self.path = path
        self._memory = mapped(descriptor, self.SIZE)
        at = len(MAGIC)
        self._heartbeat = MappedRecord(self._memory, at, HEARTBEAT_BYTES)
        self._request = MappedRecord(self._memory, at + 2 * HEARTBEAT_BYTES, REQUEST_BYTES)
        self._status = MappedRecord(self._memory, at + 2 * (HEARTBEAT_BYTES + REQUEST_BYTES), STATUS_BYTES)

    @classmethod
    def create(cls) -> SharedState:
        """Make a state that only this user may read.

        It lies in memory if the system has a place for that.

        Raises:
            DermisError: there is no room.
        """
        path, descriptor = create("dermis-shared-", cls.SIZE)
        os.lseek(descriptor, 0, os.SEEK_SET)
        os.write(descriptor, MAGIC)
        return cls(path, descriptor)

    @classmethod
    def open(cls, path: Path) -> SharedState:
        """Open another process's state.

        Raises:
            DermisError: the file cannot be opened, or is no shared state of this version.
        """
        try:
            descriptor = os.open(path, os.O_RDWR | getattr(os, "O_BINARY", 0))
        except OSError as error:
            raise DermisError("the shared state cannot be opened", where=str(path), value=error.strerror) from error
        if os.fstat(descriptor).st_size != cls.SIZE or os.read(descriptor, len(MAGIC)) != MAGIC:
            os.close(descriptor)
            raise DermisError("not a shared state of this version", where=str(path))
        return cls(Path(path), descriptor)

    def write_heartbeat(self, stops: int, playing: bool, time: float | None, values: tuple[float, ...] = ()) -> None:
        """Write a sign of life."""
        flags = PLAYING * playing | HAS_TIME * (time is not None)
        head = _HEARTBEAT.pack(stops & 0xFFFFFFFF, flags, time or 0.0, clock.now(), len(values))
        self._heartbeat.put(head + struct.pack(f"<{len(values)}d", *values))

    @property
    def heartbeat_number(self) -> int:
        """Number of the newest heartbeat; it may be read every millisecond."""
        return self._heartbeat.number()

    def read_heartbeat(self) -> Heartbeat | None:
        """Return the newest whole heartbeat, or None before the first."""
        found = self._heartbeat.get()
        if found is None or len(found[1]) < _HEARTBEAT.size:
            return None
        stops, flags, time, at, count = _HEARTBEAT.unpack_from(found[1])
        values = struct.unpack_from(f"<{count}d", found[1], _HEARTBEAT.size)
        return Heartbeat(found[0], stops, bool(flags & PLAYING), time if flags & HAS_TIME else None, values, at)

    def write_request(self, request: dict[str, Any]) -> None:
        """Write a request to the sender."""
        self._request.put(json.dumps(request, allow_nan=False).encode())

    @property
    def request_number(self) -> int:
        """Number of the newest request."""
        return self._request.number()

    def read_request(self) -> dict[str, Any]:
        """Return the newest request, empty before the first."""
        found = self._request.get()
        return dict(json.loads(found[1])) if found else {}

    def write_status(self, status: dict[str, Any]) -> None:
        """Write the sender's status."""
        self._status.put(json.dumps(status).encode())

    @property
    def status_number(self) -> int:
        """Number of the newest status."""
        return self._status.number()

    def read_status(self) -> dict[str, Any]:
        """Return the newest status, empty before the first."""
        found = self._status.get()
        return dict(json.loads(found[1])) if found else {}

    def close(self) -> None:
        """Release the memory; the file stays until `remove`."""
        self._memory.close()

    def remove(self) -> None:
        """Close the state, and remove its file.

        It is safe to call twice, and on both sides. On Windows only the side that closes last can remove the file.
        """
        self.close()
        with contextlib.suppress(PermissionError):  # Windows
            self.path.unlink(missing_ok=True)

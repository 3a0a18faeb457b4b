"""A record of the messages on a link.

If the disk is full, the record ends, and the stream goes on.
"""

from __future__ import annotations

import contextlib
import os
import stat
import sys
from pathlib import Path
from typing import TextIO

from ... import clock
from ...errors import DermisError

_closed: dict[str, tuple[int, ...]] = {}  # path -> file signature of a record written by this process


class Record:
    """Lines with time [s], direction, and bytes in hexadecimal.

    They are written to a new file, or to standard error without a path. An existing file is never written to, except
    for a record of this process: a link that is opened again continues its record.

    Attributes:
        ended: why nothing is written any more, in words; '' without an error. missing: number of messages that are
            not in the record.

    Raises:
        DermisError: the file exists already, or cannot be written.
    """

    def __init__(self, path: str) -> None:
        self.ended, self.missing = "", 0
        self._path = path
        self._file: TextIO | None = _opened(path) if path else sys.stderr
        self._start = clock.now()

    def note(self, way: str, data: bytes) -> None:
        """Write one message; `way`: 'TX', 'RX', or '--' for one that was refused."""
        self.missing += bool(self.ended)
        if self._file is None or self.ended:
            return
        try:
            self._file.write(f"{clock.now() - self._start:012.6f} {way} {data.hex(' ')}\n")
        except (OSError, ValueError) as error:
            self.missing += 1
            self._end(error)

    def close(self) -> None:
        """Write the remaining lines and close the file; safe to call twice."""
        file, self._file = self._file, None
        if file is None or not self._path:
            return
        try:
            file.flush()
            _closed[os.path.realpath(self._path)] = _looks(os.fstat(file.fileno()))
            file.close()
        except (OSError, ValueError) as error:
            self._end(error)
            with contextlib.suppress(OSError, ValueError):
                file.close()

    def _end(self, error: Exception) -> None:
        """Print once that the record is incomplete, and end it."""
        if self.ended:
            return
        self.ended = f"the record {self._path or 'on standard error'} is not whole: {_reason(error)}"
        with contextlib.suppress(OSError, ValueError):
            print(f"{self.ended}; the link goes on without it", file=sys.stderr)
        file, self._file = self._file, None
        if self._path and file is not None:  # its buffered lines cannot be written either
            with contextlib.suppress(OSError, ValueError):
                file.close()


def _opened(path: str) -> TextIO:
    try:
        try:
            file = Path(path).open("x", encoding="ascii")
            if stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                return file
            file.close()  # the path is a device, which some systems open in mode 'x', too
            raise FileExistsError
        except FileExistsError as error:
            if _closed.pop(os.path.realpath(path), None) == _looks(os.lstat(path)):
                return Path(path).open("a", encoding="ascii")
            what = "would overwrite a file" if Path(path).is_file() else "is a regular file, and this is none"
            raise DermisError(f"a record {what}", where=path, remedy="Name a file that does not exist yet") from error
    except DermisError:
        raise
    except (OSError, ValueError) as error:
        raise DermisError(
            "the record cannot be written",
            where=path,
            value=_reason(error),
            remedy="Choose a folder that exists, is writable and has room",
        ) from error


def _looks(status: os.stat_result) -> tuple[int, ...]:
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)

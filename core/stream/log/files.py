"""The files of a log.

Rows that were written stay readable, however the writing ends.
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

from .row import LogHeader, Rows

SYNC = 5.0  # [s] time between two syncs to disk: at most this part of the log is lost by a power cut


class Form(Protocol):
    """The interface of a file format."""

    def head(self, header: LogHeader) -> bytes:
        """Return the header of a file."""

    def rows(self, rows: Rows) -> bytes:
        """Return the bytes of rows."""

    def end(self, summary: Mapping[str, Any]) -> bytes:
        """Return the footer of a complete file."""


class LogFiles:
    """The files of one log: NAME.csv, NAME.2.csv, NAME.3.csv ...

    A file has its header from the moment it appears under its name, and grows by whole rows. An existing file is never
    written to.

    Args:
        path: path of the first file. form: file format. header: header of the log.
        size: largest size of one file [bytes].
        total: largest size of all files [bytes]; the oldest files are deleted to keep to it.

    Attributes:
        path: path of the current file. written: number of bytes in all files so far, removed ones included.
        rows: number of rows in them. removed: paths of the files that were deleted to keep to `total`.

    Raises:
        OSError: the first file cannot be written.
    """

    def __init__(self, path: Path, form: Form, header: LogHeader, size: float, total: float) -> None:
        self._first, self._form, self._header = path, form, header
        self._size, self._total = size, total
        self._number = 0
        self._mine: list[tuple[Path, tuple[int, int], int]] = []  # finished files: path, identity, size
        self.removed: list[str] = []
        self.written = self.rows = 0
        self._synced = 0.0
        self._descriptor = -1
        self._begin()

    def take(self, rows: Rows, now: float) -> None:
        """Write rows.

        Raises:
            OSError: the rows cannot be written; the file then ends with the last complete write before them.
        """
        data = self._form.rows(rows)
        if len(rows) > 1 and len(data) > self._size - self._empty:
            self.take(rows[: len(rows) // 2], now)
            self.take(rows[len(rows) // 2 :], now)
            return
        if self._length > self._empty and self._length + len(data) > self._size:
            self._finish({"rows": self._rows, "continued": self._path_of(self._number + 1).name})
            self._begin()
        self._append(data)
        self._rows += len(rows)
        self.rows += len(rows)
        if now - self._synced >= SYNC:
            self._synced = now
            os.fsync(self._descriptor)
            self._check()

    def close(self, summary: Mapping[str, Any]) -> None:
        """Write the footer of the last file, and close it.

        Raises:
            OSError: the footer cannot be written.
        """
        self._finish({"rows": self._rows, **summary})

    def give_up(self) -> None:
        """Close the last file without a footer; it ends with a whole row."""
        if self._descriptor >= 0:
            with contextlib.suppress(OSError):
                os.close(self._descriptor)
        self._descriptor = -1

    @property
    def count(self) -> int:
        """Number of files so far, removed ones included."""
        return self._number

    def _path_of(self, number: int) -> Path:
        first = self._first
        return first if number == 1 else first.with_name(f"{first.stem}.{number}{first.suffix}")

    def _begin(self) -> None:
        self._make_room()
        self._number += 1
        self.path = self._path_of(self._number)
        header = replace(self._header, file=self._number, removed=len(self.removed))
        self._rows = self._length = 0
        self._descriptor = _published(self.path, self._form.head(header))
        self._empty = self._length = os.fstat(self._descriptor).st_size
        self.written += self._empty

    def _make_room(self) -> None:
        """Remove the oldest files until another file fits.

        Only files of this log are removed, and none that another file has replaced.
        """
        while self._mine and sum(size for _, _, size in self._mine) + self._size > self._total:
            path, identity, _ = self._mine.pop(0)
            with contextlib.suppress(OSError):
                status = os.lstat(path)
                if (status.st_dev, status.st_ino) == identity:
                    path.unlink()
                    self.removed.append(str(path))

    def _append(self, data: bytes) -> None:
        try:
            done = 0
            while done < len(data):
                done += os.write(self._descriptor, data[done:])
        except OSError:
            with contextlib.suppress(OSError):
                os.ftruncate(self._descriptor, self._length)
            raise
        self._length += len(data)
        self.written += len(data)

    def _check(self) -> None:
        """Check that no other program has changed the file.

        Raises:
            OSError: another program has removed or replaced the file, or changed its size.
        """
        mine = os.fstat(self._descriptor)
        try:
            there = os.stat(self.path)
        except FileNotFoundError:
            raise OSError(errno.EIO, "another program has removed the file; its rows are lost") from None
        if (there.st_dev, there.st_ino) != (mine.st_dev, mine.st_ino):
            raise OSError(errno.EIO, "another program has put another file in its place; its rows are lost")
        if mine.st_size != self._length:
            cut = f"it has {mine.st_size} bytes, and {self._length} were written"
            raise OSError(errno.EIO, f"another program has changed the file: {cut}")

    def _finish(self, summary: Mapping[str, Any]) -> None:
        self._append(self._form.end(summary))
        os.fsync(self._descriptor)
        self._check()
        status = os.fstat(self._descriptor)
        self._mine.append((self.path, (status.st_dev, status.st_ino), self._length))
        os.close(self._descriptor)
        self._descriptor = -1


def _published(path: Path, head: bytes) -> int:
    """Make a new file with its header; return a descriptor at its end.

    The file appears under its name only once the header is complete.

    Raises:
        OSError: the file exists already, or cannot be written.
    """
    part = path.with_name(f".{path.name[:100]}.{os.getpid()}.part")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    descriptor = os.open(part, flags, 0o666)
    try:
        try:
            done = 0
            while done < len(head):
                done += os.write(descriptor, head[done:])
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
        try:
            os.link(part, path)  # fails if the name is taken
        except FileExistsError:
            raise
        except (OSError, NotImplementedError, AttributeError):  # a file system without hard links
            if path.exists():
                raise FileExistsError(17, os.strerror(17), str(path)) from None
            os.rename(part, path)
    finally:
        with contextlib.suppress(OSError):
            part.unlink()
    return os.open(path, os.O_WRONLY | os.O_APPEND | getattr(os, "O_BINARY", 0))

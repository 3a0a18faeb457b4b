"""LogFiles: rows on disk, in files that follow one another; whatever ends the writing, written rows are readable."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

from .row import LogHeader, Rows

SYNC = 5.0  # a power cut takes no more than this much of the log [s]


class Form(Protocol):
    """How rows become bytes."""

    def head(self, header: LogHeader) -> bytes:
        """Return the header of a file."""

    def rows(self, rows: Rows) -> bytes:
        """Return rows."""

    def end(self, summary: Mapping[str, Any]) -> bytes:
        """Return the footer of a complete file."""


class LogFiles:
    """The files of one log: NAME.csv, NAME.2.csv, NAME.3.csv ...

    A file appears under its name with its header in it, and grows by whole rows. No file that is there is written to.

    Args:
        path: path of the first file.
        size: size of one file [bytes].
        total: size of all files [bytes]; the oldest are deleted before it is exceeded.

    Attributes:
        path: of the file that grows. written: bytes of all files so far. rows: in them. removed: paths of the files
            that were removed to stay within `total`.

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
            OSError: they cannot be written; the file ends with the last whole row before them.
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
        """End the last file.

        Raises:
            OSError: its end cannot be written.
        """
        self._finish({"rows": self._rows, **summary})

    def give_up(self) -> None:
        """Leave the last file as it is: it ends with a whole row."""
        if self._descriptor >= 0:
            with contextlib.suppress(OSError):
                os.close(self._descriptor)
        self._descriptor = -1

    @property
    def count(self) -> int:
        """Number of files so far."""
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
        """Remove the oldest files until another one fits, and only those that this log has written, as it left them."""
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
        """Look whether the file is still the one that was written.

        Raises:
            OSError: another program has removed, replaced or cut it.
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
    """Make a new file that has its header from its first moment on; return a descriptor at its end.

    Raises:
        OSError: it is there already, or cannot be written.
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
            os.link(part, path)  # fails where the name is taken
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

"""Whole files or none: a file appears under its name only when all of it is on the disk."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import DermisError


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """Give a temporary path beside `path`; what was written there takes the name when the block ends well.

    Folders are made as needed. After an exception nothing is left behind and an older file stays as it was.

    Raises:
        DermisError: the folder or file cannot be written.
    """
    path = Path(path)
    part = path.parent / f".{path.name[:100]}.{os.getpid()}-{os.urandom(4).hex()}.part"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        with part.open("rb+") as written:  # on the disk before it takes the name: a power cut leaves old or new, whole
            os.fsync(written.fileno())
        os.replace(part, path)
    except OSError as error:
        raise DermisError(
            "the file cannot be written", where=str(path), value=error.strerror or str(error),
            remedy="Choose a folder that exists, is writable and has room",
        ) from error  # fmt: skip
    finally:
        part.unlink(missing_ok=True) if part.parent.is_dir() else None


def write_bytes(path: Path, data: bytes) -> None:
    """Write a whole file or none.

    Raises:
        DermisError: the folder or file cannot be written.
    """
    with atomic(path) as part:
        part.write_bytes(data)


def read_bytes(path: Path) -> bytes:
    """Read a whole file.

    Raises:
        DermisError: it is missing or cannot be read.
    """
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise DermisError(
            "the file cannot be read", where=str(path), value=error.strerror or str(error),
            remedy="Check the path and that you may read it",
        ) from error  # fmt: skip

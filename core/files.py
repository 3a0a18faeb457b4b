"""Whole files or none: a file appears under its name only when all of it is on the disk."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import DermisError

_EPOCH = (1980, 1, 1, 0, 0, 0)  # the first date that a zip can hold: equal contents give equal bytes


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
        with suppress(OSError):
            part.unlink(missing_ok=True)


def check_folder(path: Path) -> Path:
    """Return a folder that must be there already.

    Raises:
        DermisError: it is not, or it is a file.
    """
    path = Path(path)
    if not path.is_dir():
        raise DermisError("not a folder" if path.exists() else "no such folder", where=str(path),
                          remedy="Check the path")  # fmt: skip
    return path


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


def write_npz(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays as an .npz whose bytes depend on nothing but the arrays; whole or not at all.

    Raises:
        DermisError: an array of Python objects, or the file cannot be written.
    """
    with atomic(path) as part, zipfile.ZipFile(part, "w", allowZip64=True) as archive:
        for name in arrays:
            put_array(archive, name, arrays[name])


def put_array(archive: zipfile.ZipFile, name: str, array: NDArray[Any]) -> None:
    """Add an array to a zip as NAME.npy, stored without compression and without a date.

    Raises:
        DermisError: it holds Python objects.
    """
    array = np.asarray(array)
    if array.dtype.hasobject:
        raise DermisError("an array of Python objects cannot be written", where=name, value=str(array.dtype))
    with archive.open(zipfile.ZipInfo(f"{name}.npy", _EPOCH), "w", force_zip64=True) as member:
        np.lib.format.write_array(member, np.asarray(array, order="C"), allow_pickle=False)


def put_text(archive: zipfile.ZipFile, name: str, text: str) -> None:
    """Add a text to a zip, stored without compression and without a date."""
    archive.writestr(zipfile.ZipInfo(name, _EPOCH), text.encode("utf-8"))

"""Whole files or none: a file appears under its name only when all of it is on the disk, and only files are read."""

from __future__ import annotations

import os
import stat
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from .errors import DermisError
from .foreign import MAX_BYTES, MAX_SETTINGS, MAX_TEXT, check_size, json_of, text_of

# A pipe without a writer, or a line without a carrier, would keep whoever opens it waiting.
_NO_WAITING = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0) | getattr(os, "O_BINARY", 0)
_WINDOWS = os.name == "nt"
# Characters of a whole path on Windows, unless somebody has allowed longer ones: Microsoft, "Maximum Path Length
# Limitation", 260 with the zero at its end.
MAX_PATH = 259
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the first date that a zip can hold: equal contents give equal bytes


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """Give a temporary path beside `path`; the file written there takes the name when the block ends well.

    Folders are made as needed. After an exception nothing is left behind and an older file stays as it was.

    Raises:
        DermisError: the folder or file cannot be written.
    """
    path = Path(path)
    shown = path.name.encode(errors="surrogateescape")[:100].decode(
        errors="ignore"
    )  # a file name has 255 bytes at most
    part = path.parent / f".{shown}.{os.getpid()}-{os.urandom(4).hex()}.part"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        with part.open("rb+") as written:  # on the disk before it takes the name: a power cut leaves old or new, whole
            os.fsync(written.fileno())
        os.replace(part, path)
    except OSError as error:
        raise _unwritable(error, path, part) from error
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def keep_apart(out: Path | None, *read: Path | None) -> None:
    """Refuse to write a file over one of those that are read for it.

    Raises:
        DermisError: `out` is one of them, by whatever name.
    """
    for path in read:
        if out is not None and path is not None:
            with suppress(OSError):
                if os.path.samefile(out, path):
                    raise DermisError(
                        "the result would overwrite its own source", where=str(out), remedy="Name another file to write"
                    )


def check_folder(path: Path) -> Path:
    """Return a folder that must be there already.

    Raises:
        DermisError: it is not, or it is a file.
    """
    path = Path(path)
    if not os.path.isdir(path):  # which has an answer for names that no system takes, too
        raise DermisError(
            "not a folder" if os.path.exists(path) else "no such folder", where=str(path), remedy="Check the path"
        )
    return path


def write_bytes(path: Path, data: bytes) -> None:
    """Write a whole file or none.

    Raises:
        DermisError: the folder or file cannot be written.
    """
    with atomic(path) as part:
        part.write_bytes(data)


@contextmanager
def opened(path: Path, *, most: int = MAX_BYTES, where: str = "") -> Iterator[tuple[IO[bytes], int]]:
    """Open a regular file for reading, and give its size [bytes] with it: devices, pipes and folders are no files.

    It is judged before it is opened, since opening a port alone may reset a board, and again once it is open.

    Raises:
        DermisError: missing, unreadable, not a regular file, or larger than `most`.
    """
    where = where or str(path)
    try:
        _check_regular(os.stat(path), where)
        descriptor = os.open(path, os.O_RDONLY | _NO_WAITING)
    except DermisError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a path that no system call takes
        raise _unreadable(error, where, path) from error
    with os.fdopen(descriptor, "rb") as file:
        status = os.fstat(descriptor)
        _check_regular(status, where)
        check_size(status.st_size, where, most)
        yield file, status.st_size


def _check_regular(status: os.stat_result, where: str) -> None:
    if not stat.S_ISREG(status.st_mode):
        kinds = ((stat.S_ISDIR, "a folder"), (stat.S_ISFIFO, "a pipe"), (stat.S_ISSOCK, "a socket"))
        kind = next((name for is_one, name in kinds if is_one(status.st_mode)), "a device")
        raise DermisError(
            "the file cannot be read", where=where, value=kind, limit="a regular file", remedy="Choose a file"
        )


def _unreadable(error: Exception, where: str, path: Path) -> DermisError:
    said = error.strerror if isinstance(error, OSError) and error.strerror else str(error) or type(error).__name__
    remedy = "Check the path and that you may read it" if str(path) in where else f"Check the path {path}"
    return _too_long(path, where) or DermisError("the file cannot be read", where=where, value=said, remedy=remedy)


def _too_long(path: Path, where: str) -> DermisError | None:
    """Return what Windows means where it says of a long path that there is no such folder; None elsewhere."""
    length = len(os.path.abspath(path))
    if not _WINDOWS or length <= MAX_PATH:
        return None
    return DermisError(
        "the path is too long for Windows",
        where=where,
        value=length,
        limit=f"{MAX_PATH} characters, with the name of the part that is written first",
        remedy="Choose a folder nearer to the drive, or a shorter name; or allow long paths in Windows",
    )


def read_bytes(path: Path, *, most: int = MAX_BYTES, where: str = "") -> bytes:
    """Read a whole file.

    Raises:
        DermisError: see `opened`.
    """
    with opened(path, most=most, where=where) as (file, size):
        try:
            return file.read(size)
        except (OSError, MemoryError) as error:
            raise _unreadable(error, where or str(path), path) from error


def read_text(path: Path, *, most: int = MAX_TEXT, encoding: str = "utf-8") -> str:
    """Read a text.

    Raises:
        DermisError: see `opened`; or not UTF-8.
    """
    return text_of(read_bytes(path, most=most), str(path), encoding)


def read_json(path: Path, *, most: int = MAX_SETTINGS) -> Any:
    """Read JSON; see `foreign.json_of`.

    Raises:
        DermisError: see `opened`; or not JSON as it is taken here.
    """
    return json_of(read_bytes(path, most=most), str(path), most)


def check_writable(path: Path, *, folder: bool = False) -> Path:
    """Return a path that can be written, before the work that is to be written there; nothing stays behind.

    Args:
        folder: it is to be a folder, not a file.

    Raises:
        DermisError: it cannot.
    """
    path = Path(path)
    home = path if folder else path.parent
    try:
        with suppress(FileNotFoundError):
            if stat.S_ISDIR(os.stat(path).st_mode) != folder:
                raise OSError(f"{'a file' if folder else 'a folder'} is in the way")
        while not home.exists():
            home = home.parent
        with tempfile.TemporaryFile(dir=home):
            pass
    except (OSError, ValueError) as error:
        raise _unwritable(error, path) from error
    return path


def _unwritable(error: OSError | ValueError, path: Path, part: Path | None = None) -> DermisError:
    said = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return _too_long(part or path, str(path)) or DermisError(
        "the file cannot be written",
        where=str(path),
        value=said,
        remedy="Choose a folder that exists, is writable and has room, or close the program that has the file open",
    )


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

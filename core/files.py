"""Atomic writing of files, and reading of regular files only.

A written file appears under its name only when all of it is on the disk.
"""

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

# Without these flags, opening a pipe that has no writer, or a serial line that has no carrier, would wait for ever.
_NO_WAITING = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0) | getattr(os, "O_BINARY", 0)
_WINDOWS = os.name == "nt"
# [characters] Longest absolute path on Windows, unless longer paths have been enabled: 260 with the terminating zero,
# by Microsoft's "Maximum Path Length Limitation".
MAX_PATH = 259
# Date of all members of a zip, the first that a zip can hold. The date is constant so that equal contents give equal
# bytes.
_EPOCH = (1980, 1, 1, 0, 0, 0)


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """Write a file atomically, by way of a temporary path for the block.

    The block writes the file to the temporary path, which is in the same folder. At its end, the file is renamed to
    `path`. Missing folders are made. If the block raises an exception, the temporary file is deleted, and an older file
    at `path` stays as it was.

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
        with part.open("rb+") as written:  # on the disk before the renaming, so a power cut leaves a whole file
            os.fsync(written.fileno())
        os.replace(part, path)
    except OSError as error:
        raise _unwritable(error, path, part) from error
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def keep_apart(out: Path | None, *read: Path | None) -> None:
    """Refuse to overwrite a file from which the result is made.

    Args:
        out: path to write; None for none.
        read: paths of the files that are read; None for none.

    Raises:
        DermisError: `out` is one of these files, possibly under another path.
    """
    for path in read:
        if out is not None and path is not None:
            with suppress(OSError):
                if os.path.samefile(out, path):
                    raise DermisError(
                        "the result would overwrite its own source", where=str(out), remedy="Name another file to write"
                    )


def check_folder(path: Path) -> Path:
    """Return the path of a folder after a check that the folder exists.

    Raises:
        DermisError: the folder does not exist, or the path is that of a file.
    """
    path = Path(path)
    if not os.path.isdir(path):  # `os.path.isdir` does not raise for names that no system allows
        raise DermisError(
            "not a folder" if os.path.exists(path) else "no such folder", where=str(path), remedy="Check the path"
        )
    return path


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file atomically, see `atomic`.

    Raises:
        DermisError: the folder or file cannot be written.
    """
    with atomic(path) as part:
        part.write_bytes(data)


@contextmanager
def opened(path: Path, *, most: int = MAX_BYTES, where: str = "") -> Iterator[tuple[IO[bytes], int]]:
    """Open a regular file for reading; yield it and its size [bytes].

    Devices, pipes and folders are refused. The path is checked before it is opened, because merely opening a port may
    reset a board. The open file is checked once more, because the path may have changed in between.

    Args:
        path: path of the file.
        most: largest size [bytes].
        where: name of the file in errors; '' for the path.

    Raises:
        DermisError: the file is missing, unreadable, not a regular file, or larger than `most`.
    """
    where = where or str(path)
    try:
        _check_regular(os.stat(path), where)
        descriptor = os.open(path, os.O_RDONLY | _NO_WAITING)
    except DermisError:
        raise
    except (OSError, ValueError) as error:  # ValueError: no system call accepts the path
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
    """Return the error for a path that is too long for Windows, or None.

    Windows itself reports for such a path only that there is no such folder.
    """
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
    """Return all bytes of a file; the arguments are those of `opened`.

    Raises:
        DermisError: see `opened`.
    """
    with opened(path, most=most, where=where) as (file, size):
        try:
            return file.read(size)
        except (OSError, MemoryError) as error:
            raise _unreadable(error, where or str(path), path) from error


def read_text(path: Path, *, most: int = MAX_TEXT, encoding: str = "utf-8") -> str:
    """Return the text of a file.

    Args:
        path: path of the file.
        most: largest size [bytes].
        encoding: 'utf-8', or 'utf-8-sig' to remove a byte order mark.

    Raises:
        DermisError: the file cannot be read (see `opened`), or is not UTF-8.
    """
    return text_of(read_bytes(path, most=most), str(path), encoding)


def read_json(path: Path, *, most: int = MAX_SETTINGS) -> Any:
    """Return the value of a JSON file, read by the rules of `foreign.json_of`.

    Args:
        path: path of the file.
        most: largest size [bytes].

    Raises:
        DermisError: the file cannot be read (see `opened`), or breaks a rule of `foreign.json_of`.
    """
    return json_of(read_bytes(path, most=most), str(path), most)


def check_writable(path: Path, *, folder: bool = False) -> Path:
    """Return a path after a check that it can be written.

    Called before long work, the check shows early that the result could not be written. It leaves no files behind.

    Args:
        path: path to write.
        folder: True if a folder is to be written there, False for a file.

    Raises:
        DermisError: the path cannot be written.
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
    """Write an .npz file atomically.

    Its bytes depend on nothing but the arrays and their names.

    Args:
        path: path of the file.
        arrays: arrays by name; the file has them in the same order.

    Raises:
        DermisError: an array holds Python objects, or the file cannot be written.
    """
    with atomic(path) as part, zipfile.ZipFile(part, "w", allowZip64=True) as archive:
        for name in arrays:
            put_array(archive, name, arrays[name])


def put_array(archive: zipfile.ZipFile, name: str, array: NDArray[Any]) -> None:
    """Add an array to a zip as NAME.npy.

    It is stored without compression and with a constant date.

    Raises:
        DermisError: the array holds Python objects.
    """
    array = np.asarray(array)
    if array.dtype.hasobject:
        raise DermisError("an array of Python objects cannot be written", where=name, value=str(array.dtype))
    with archive.open(zipfile.ZipInfo(f"{name}.npy", _EPOCH), "w", force_zip64=True) as member:
        np.lib.format.write_array(member, np.asarray(array, order="C"), allow_pickle=False)


def put_text(archive: zipfile.ZipFile, name: str, text: str) -> None:
    """Add a text to a zip, without compression and with a constant date."""
    archive.writestr(zipfile.ZipInfo(name, _EPOCH), text.encode("utf-8"))

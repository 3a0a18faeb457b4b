"""Readers of .npz and .npy files that check headers and unpickle nothing.

A header is checked before the array is read: the array must have exactly the size that the header declares.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from .errors import DermisError
from .files import opened
from .foreign import MAX_BYTES, check_size, damage_told, text_of

DTYPES = "biufcSU"  # kinds of numpy's types that are read: numbers and texts
EMPTY_SIDE = 1 << 24  # longest side of an array without elements, because other arrays may be made with this length
MAX_DIRECTORY = 1 << 24  # [bytes] longest table of contents, some 100,000 members; a long scene has some thousand
_METHODS = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}  # the methods of compression that numpy uses
_AT_ONCE = 1 << 20  # [bytes] length of the parts in which an array is read


class ArrayFile:
    """An open .npz file: a zip of .npy arrays and texts.

    Args:
        file: the file, open for reading.
        where: name of the file in errors.
        size: size of the file [bytes].
        kind: expected kind of file in errors, such as 'an archive of arrays'.
        trusted: True for a file that this product made and whose check sum was verified. Such a file may unpack to more
            than `EXPANDS` times its size.

    Raises:
        DermisError: the file is no zip, has too many members, or has two members of one name.
    """

    def __init__(self, file: IO[bytes], where: str, size: int, kind: str, *, trusted: bool = False) -> None:
        self.where, self._size, self._kind, self._trusted = where, size, kind, trusted
        self._budget = 0
        _check_directory(file, size, where)
        with damage_told(f"the file cannot be read: not {kind}, or cut short", where):
            self._zip = zipfile.ZipFile(file)
            self._members = {info.filename: info for info in self._zip.infolist()}
        if len(self._members) != len(self._zip.infolist()):
            raise DermisError("two members of the archive have one name", where=where)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the arrays in the file."""
        return tuple(name.removesuffix(".npy") for name in self._members if name.endswith(".npy"))

    def __contains__(self, member: str) -> bool:
        return member in self._members

    def array(self, name: str) -> NDArray[Any]:
        """Read one array.

        Raises:
            DermisError: the array is missing, damaged or too large, or holds neither numbers nor texts.
        """
        place = f"{self.where}, {name}"
        with self._open(f"{name}.npy", place) as (file, size):
            return _array(file, size, place)

    def arrays(self, names: Iterable[str]) -> dict[str, NDArray[Any]]:
        """Return several arrays by name, see `array`."""
        return {name: self.array(name) for name in names}

    def text(self, name: str, most: int) -> str:
        """Read a member that is UTF-8 text.

        Args:
            name: name of the member.
            most: largest size of the text [bytes].

        Raises:
            DermisError: the member is missing, damaged, larger than `most`, or not UTF-8.
        """
        place = f"{self.where}, {name}"
        with self._open(name, place) as (file, size):
            check_size(size, place, most)
            with damage_told("the archive is damaged", place):
                data = file.read(size)
            return text_of(data, place)

    @contextmanager
    def _open(self, name: str, place: str) -> Iterator[tuple[IO[bytes], int]]:
        info = self._members.get(name)
        if info is None:
            there = ", ".join(self._members)[:200]
            raise DermisError(f"not {self._kind}, or damaged: a part is missing", where=place, limit=there)
        if info.compress_type not in _METHODS or info.flag_bits & 0x61:  # encrypted or patched
            raise DermisError(
                "packed by a method that is not supported",
                where=place,
                value=f"method {info.compress_type}, flags {info.flag_bits:#x}",
                limit="stored or deflated",
                remedy="Write it with numpy.savez",
            )
        self._budget += info.file_size  # summed over all reads, because members may overlap
        check_size(self._budget, place, packed=None if self._trusted else self._size)
        with damage_told("the archive is damaged", place):
            file = self._zip.open(info)
        with file:
            yield file, info.file_size


@contextmanager
def opened_npz(
    path: Path, where: str = "", kind: str = "an archive of arrays", *, trusted: bool = False
) -> Iterator[ArrayFile]:
    """Open an .npz file for reading; yield an `ArrayFile`.

    See `ArrayFile` for the arguments; `where` is the path if it is ''.

    Raises:
        DermisError: the file is missing, not a regular file, or not an archive.
    """
    with opened(path, where=where) as (file, size):
        yield ArrayFile(file, where or str(path), size, kind, trusted=trusted)


def read_npz(path: Path, where: str = "", kind: str = "an archive of arrays") -> dict[str, NDArray[Any]]:
    """Return all arrays of an .npz file by name.

    Raises:
        DermisError: see `opened_npz` and `ArrayFile.array`.
    """
    with opened_npz(path, where, kind) as archive:
        return archive.arrays(archive.names)


def array_of(data: bytes, where: str) -> NDArray[Any]:
    """Return the array in the bytes of a .npy file.

    Args:
        data: all bytes of the file.
        where: name of the file in errors.

    Raises:
        DermisError: the data are damaged, differ in size from the header, or hold neither numbers nor texts.
    """
    return _array(io.BytesIO(data), len(data), where)


def _array(file: IO[bytes], size: int, where: str) -> NDArray[Any]:
    with damage_told("the array cannot be read", where, remedy="Write it with numpy.save or numpy.savez"):
        version = np.lib.format.read_magic(file)
        if version not in ((1, 0), (2, 0)):
            raise ValueError(f"version {version} of the format")
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, turned, kind = header(file)
        body = size - file.tell()
    count = math.prod(shape)
    if kind.hasobject or kind.kind not in DTYPES or kind.itemsize == 0:
        raise DermisError(
            "the array cannot be read: it holds neither numbers nor texts",
            where=where,
            value=str(kind)[:80],
            remedy="Write it without objects: Dermis does not unpickle",
        )
    if any(n < 0 for n in shape) or len(shape) > 8 or count * kind.itemsize != body:
        raise DermisError(
            "the array cannot be read: it has another size than it declares",
            where=where,
            value=f"{body} bytes",
            limit=f"{str(shape)[:60]} of {kind}",
        )
    if not count and max(shape) > EMPTY_SIDE:
        raise DermisError(
            "the array cannot be read: it has no elements, but a side that is too long",
            where=where,
            value=str(shape)[:60],
            limit=f"{EMPTY_SIDE}",
        )
    check_size(body, where, MAX_BYTES)
    with damage_told("the array is damaged", where):
        flat = np.empty(count, kind)
        raw = flat.view(np.uint8) if count else np.empty(0, np.uint8)
        for at in range(0, body, _AT_ONCE):
            part = file.read(min(_AT_ONCE, body - at))
            raw[at : at + len(part)] = np.frombuffer(part, np.uint8)
            if len(part) < min(_AT_ONCE, body - at):
                raise EOFError("cut short")
        return flat.reshape(shape[::-1]).T if turned else flat.reshape(shape)


def _check_directory(file: IO[bytes], size: int, where: str) -> None:
    """Refuse an archive with a table of contents beyond `MAX_DIRECTORY`.

    The check comes before `zipfile` reads the table, because `zipfile` builds an object for each member.
    """
    file.seek(max(size - 65_557, 0))  # the end record (22 bytes) and the longest comment after it (65,535 bytes)
    tail = file.read(65_557)
    end = len(tail) - 22 if tail[-22:-18] == b"PK\5\6" else tail.rfind(b"PK\5\6")
    if end < 0:
        return  # not a zip: `zipfile` raises the error
    lengths = [int.from_bytes(tail[end + 12 : end + 16], "little")]
    lengths = [n for n in lengths if n != 0xFFFFFFFF]
    if tail[max(end - 76, 0) : end - 72] == b"PK\6\6":  # the end record of a ZIP64 file
        lengths.append(int.from_bytes(tail[end - 36 : end - 28], "little"))
    if max(lengths, default=0) > MAX_DIRECTORY:
        raise DermisError(
            "the archive has too many members",
            where=where,
            value=f"{max(lengths)} bytes of names",
            limit=f"{MAX_DIRECTORY} bytes",
        )

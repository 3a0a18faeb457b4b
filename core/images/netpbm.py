"""PGM and PPM images (plain and raw, 8 and 16 bit) and PFM images."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError
from .raster import Raster, checked_size, grey_of

_FIELD = re.compile(rb"(?:\s|#[^\n]*\n)*+([^\s#]\S*)")  # a field of the header, after white space and comments
_SPACE = re.compile(rb"\s")
_AT_ONCE = 1 << 20  # [bytes] text of plain numbers that is split at a time
_NEXT = re.compile(rb"\s*+(P[1-7fF]\s|\Z)")  # allowed after the last pixel: another image, or the end of the file


def decode(data: bytes, where: str) -> Raster:
    """Read a P2, P3, P5, P6, Pf or PF image.

    As the formats define, 16-bit pixels are big-endian, and floating-point pixels have either byte order.

    Raises:
        DermisError: the header is malformed, pixels are missing, a pixel exceeds the declared maximum, or other data
            than white space or another image follow the last pixel.
    """
    kind = data[:2].decode()
    fields, start = _header(data, where)
    columns, rows = (_whole(f, where) for f in fields[:2])
    checked_size(columns, rows, where)
    channels = 3 if kind in ("P3", "P6", "PF") else 1
    count = rows * columns * channels
    if kind in ("Pf", "PF"):
        pixels = _floats(data, start, fields[2], count, where).reshape(rows, columns, channels)
        grey, findings = grey_of(pixels, where)
        # Only PFM stores the bottom row first. This is also the order of `Raster`, so the rows are not flipped.
        return Raster(grey, np.zeros(grey.shape, bool), 0, findings)
    most = _whole(fields[2], where)
    if not 1 <= most <= 65535:
        raise DermisError("the largest value is out of range", where=where, value=most, limit="1 to 65535")
    numbers = _plain(data, start, count, where) if kind in ("P2", "P3") else _raw(data, start, most, count, where)
    if int(numbers.max()) > most:
        raise DermisError(
            "a pixel is brighter than the declared maximum", where=where, value=int(numbers.max()), limit=f"{most}"
        )
    grey, findings = grey_of(numbers.reshape(rows, columns, channels), where, most)
    return Raster(np.ascontiguousarray(grey[::-1]), np.zeros(grey.shape, bool), most + 1, findings)


def _header(data: bytes, where: str) -> tuple[list[bytes], int]:
    """Return the three fields after the format, and the start of the pixels.

    One byte of white space separates the last field from the pixels.
    """
    fields: list[bytes] = []
    at = 2
    for _ in range(3):
        field = _FIELD.match(data, at)
        if field is None:
            raise DermisError("the image header is cut short", where=where)
        fields.append(field[1])
        at = field.end()
    return fields, at + 1


def _whole(text: bytes, where: str) -> int:
    if not text.isdigit() or len(text) > 9:
        raise DermisError(
            "the image header is malformed", where=where, value=text[:20].decode("latin-1"), limit="a whole number"
        )
    return int(text)


def _missing(where: str, found: int, wanted: int) -> DermisError:
    return DermisError("the image is cut short", where=where, value=f"{found} values", limit=f"{wanted} values")


def _check_end(data: bytes, end: int, where: str) -> None:
    """Refuse data after the last pixel that are no white space and no image.

    With such data, the pixels are not those that the header declares.
    """
    if not _NEXT.match(data, end):
        raise _left_over(where, f"{len(data) - end} bytes")


def _left_over(where: str, found: str) -> DermisError:
    return DermisError(
        "there is data after the last pixel, so the pixels do not match the header",
        where=where,
        value=found,
        limit="nothing, white space, or another image",
        remedy="Save the image again",
    )


def _plain(data: bytes, start: int, count: int, where: str) -> NDArray[np.uint32]:
    if len(data) - start < 2 * count - 1:  # each number needs at least one digit, and a space before the next
        raise _missing(where, max(len(data) - start + 1, 0) // 2, count)
    body = re.sub(rb"#[^\n]*", b" ", data[start:])
    numbers, done, at = np.empty(count, np.uint32), 0, 0
    while done < count and at < len(body):
        space = _SPACE.search(body, at + _AT_ONCE)
        end = space.start() if space else len(body)
        words = body[at:end].split()
        if len(words) > count - done and not _NEXT.match(words[count - done] + b" "):
            raise _left_over(where, f"{len(words) - count + done} numbers and more")
        words = words[: count - done]
        numbers[done : done + len(words)] = [_whole(word, where) for word in words]
        done, at = done + len(words), end
    if done < count:
        raise _missing(where, done, count)
    return numbers


def _raw(data: bytes, start: int, most: int, count: int, where: str) -> NDArray[Any]:
    kind = np.dtype(">u2") if most > 255 else np.dtype("u1")
    found = max(len(data) - start, 0) // kind.itemsize
    if found < count:
        raise _missing(where, found, count)
    _check_end(data, start + count * kind.itemsize, where)
    return np.frombuffer(data, kind, count, start)


def _floats(data: bytes, start: int, scale: bytes, count: int, where: str) -> NDArray[np.float32]:
    try:
        factor = float(scale)
    except ValueError:
        factor = 0.0
    if factor == 0.0 or not np.isfinite(factor):
        raise DermisError(
            "the PFM scale is malformed",
            where=where,
            value=scale[:20].decode("latin-1"),
            limit="a number, below zero for little-endian",
        )
    kind = np.dtype("<f4") if factor < 0 else np.dtype(">f4")
    found = max(len(data) - start, 0) // 4
    if found < count:
        raise _missing(where, found, count)
    _check_end(data, start + count * 4, where)
    # The magnitude of the scale is a hint for display, which is usually 1. It is ignored: heights are taken as stored.
    return np.frombuffer(data, kind, count, start).astype(np.float32)

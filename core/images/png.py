"""PNG by zlib and numpy: 1 to 16 bit, grey, RGB, palette, alpha and every row filter."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError
from ..foreign import check_size
from .raster import Raster, checked_size, grey_of

SIGNATURE = b"\x89PNG\r\n\x1a\n"
GREY, RGB, PALETTE, GREY_ALPHA, RGB_ALPHA = 0, 2, 3, 4, 6
_CHANNELS = {GREY: 1, RGB: 3, PALETTE: 1, GREY_ALPHA: 2, RGB_ALPHA: 4}
_DEPTHS = {GREY: (1, 2, 4, 8, 16), RGB: (8, 16), PALETTE: (1, 2, 4, 8), GREY_ALPHA: (8, 16), RGB_ALPHA: (8, 16)}
_SUB, _UP, _AVERAGE, _PAETH = 1, 2, 3, 4


@dataclass(frozen=True)
class _Header:
    columns: int
    rows: int
    depth: int
    colour: int

    @property
    def channels(self) -> int:
        return _CHANNELS[self.colour]

    @property
    def row_bytes(self) -> int:
        return (self.columns * self.channels * self.depth + 7) // 8

    @property
    def pixel_bytes(self) -> int:
        return max(1, self.channels * self.depth // 8)


def decode(data: bytes, where: str) -> Raster:
    """Read a PNG; alpha 0 and a declared transparent colour are holes.

    Raises:
        DermisError: damaged, cut short, interlaced, or with fields that the format does not allow.
    """
    header, chunks = _chunks(data, where)
    samples = _samples(header, _filtered(header, chunks.get(b"IDAT", b""), where), where)
    pixels: NDArray[Any]
    if header.colour == PALETTE:
        pixels, holes = _painted(samples[..., 0], chunks, where)
        largest = 255
    else:
        pixels, holes = samples, _transparent(header, samples, chunks.get(b"tRNS"))
        largest = (1 << header.depth) - 1
        if header.colour in (GREY_ALPHA, RGB_ALPHA):
            pixels = samples[..., :-1]
    grey, findings = grey_of(pixels, where, largest)
    return Raster(np.ascontiguousarray(grey[::-1]), np.ascontiguousarray(holes[::-1]), largest + 1, findings)


def _chunks(data: bytes, where: str) -> tuple[_Header, dict[bytes, bytes]]:
    at, parts = len(SIGNATURE), {}
    header: _Header | None = None
    pieces: list[bytes] = []
    while True:
        if at + 12 > len(data):
            raise _damaged(where, "cut short")
        (length,) = struct.unpack_from(">I", data, at)
        name, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        end = at + 8 + length
        if end + 4 > len(data):
            raise _damaged(where, "cut short")
        if zlib.crc32(data[at + 4 : end]) != struct.unpack_from(">I", data, end)[0]:
            raise _damaged(where, f"checksum of {name.decode('latin-1')}")
        if header is None:
            if name != b"IHDR" or length != 13:
                raise _damaged(where, "no header")
            header = _header(body, where)
        elif name == b"IDAT":
            pieces.append(body)
        elif name in (b"PLTE", b"tRNS"):
            parts[name] = body
        elif name == b"IEND":
            break
        elif not name[0] & 0x20 and name != b"IDAT":
            raise _damaged(where, f"unknown critical part {name.decode('latin-1')}")
        at = end + 4
    parts[b"IDAT"] = b"".join(pieces)
    checked_size(header.columns, header.rows, where, packed=len(parts[b"IDAT"]))
    return header, parts


def _header(body: bytes, where: str) -> _Header:
    columns, rows, depth, colour, compression, filtering, interlace = struct.unpack(">IIBBBBB", body)
    checked_size(columns, rows, where)
    if colour not in _DEPTHS or depth not in _DEPTHS[colour] or compression or filtering or interlace > 1:
        raise _damaged(where, f"colour type {colour} with {depth} bit")
    if interlace:
        raise DermisError(
            "interlaced PNGs are not read here", where=where, value="Adam7", remedy="Save it without interlacing"
        )
    return _Header(columns, rows, depth, colour)


def _damaged(where: str, detail: str) -> DermisError:
    return DermisError("the PNG is damaged", where=where, value=detail, remedy="Save the image again")


def _filtered(header: _Header, packed: bytes, where: str) -> NDArray[np.uint8]:
    """Unpack the pixel data: one filter byte and the filtered bytes a row, shape (rows, 1 + row bytes)."""
    wanted = header.rows * (1 + header.row_bytes)
    check_size(wanted, where, packed=len(packed))
    unpacker = zlib.decompressobj()
    try:
        # The limit keeps a hostile file from filling the memory.
        raw = unpacker.decompress(packed, wanted)
    except zlib.error as error:
        raise _damaged(where, str(error)) from error
    if len(raw) < wanted:
        raise _damaged(where, "pixels missing")
    return np.frombuffer(raw, np.uint8).reshape(header.rows, 1 + header.row_bytes)


def _samples(header: _Header, filtered: NDArray[np.uint8], where: str) -> NDArray[Any]:
    """Undo the row filters and split bytes into samples, 8 or 16 bits wide, shape (rows, columns, channels)."""
    kinds, coded = filtered[:, 0], filtered[:, 1:]
    if kinds.max() > _PAETH:
        raise _damaged(where, f"row filter {int(kinds.max())}")
    step = header.pixel_bytes
    coded = coded.reshape(header.rows, -1, step)
    plain = _unfilter_rows(kinds, coded) if (kinds < _AVERAGE).all() else _unfilter_diagonals(kinds, coded)
    flat = plain.reshape(header.rows, -1)
    if header.depth == 16:
        flat = flat.view(">u2")
    elif header.depth < 8:
        shifts = np.arange(8 - header.depth, -1, -header.depth)
        within = (np.arange(256)[:, None] >> shifts & (1 << header.depth) - 1).astype(np.uint8)  # of each byte
        flat = within[flat].reshape(header.rows, -1)[:, : header.columns]
    return flat.reshape(header.rows, header.columns, header.channels)


def _unfilter_rows(kinds: NDArray[np.uint8], coded: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Undo filters None, Sub and Up: a running sum along the row, or the row above."""
    plain = np.empty(coded.shape, np.uint8)
    above = np.zeros(coded.shape[1:], np.uint8)
    for row, kind in enumerate(kinds):
        if kind == _SUB:
            np.cumsum(coded[row], axis=0, dtype=np.uint8, out=plain[row])
        elif kind == _UP:
            np.add(coded[row], above, out=plain[row])
        else:
            plain[row] = coded[row]
        above = plain[row]
    return plain


def _unfilter_diagonals(kinds: NDArray[np.uint8], coded: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Undo all five filters, one anti-diagonal at a time.

    A pixel needs its neighbours left, above and above left, so all pixels of an anti-diagonal are independent:
    rows + columns steps of numpy in place of rows * columns steps of Python.
    """
    rows, columns, step = coded.shape
    width = columns + 1
    plain = np.zeros(((rows + 1) * width, step), np.int16)
    source = coded.reshape(rows * columns, step).astype(np.int16)
    kind = kinds.astype(np.int16)[:, None]
    for t in range(rows + columns - 1):
        first, last = max(0, t - columns + 1), min(rows - 1, t)
        count = last - first + 1
        at = (first + 1) * width + t - first + 1
        left, up, corner = (_diagonal(plain, at - back, width - 1, count) for back in (1, width, width + 1))
        row_kind = kind[first : last + 1]
        # Paeth: whichever neighbour is nearest to left + up - corner, ties in that order.
        to_left, to_up, to_corner = np.abs(up - corner), np.abs(left - corner), np.abs(left + up - 2 * corner)
        paeth = np.where((to_left <= to_up) & (to_left <= to_corner), left, np.where(to_up <= to_corner, up, corner))
        predicted = np.where(row_kind == _PAETH, paeth, 0)
        predicted += np.where(row_kind == _AVERAGE, (left + up) >> 1, 0)
        predicted += np.where(row_kind == _SUB, left, 0)
        predicted += np.where(row_kind == _UP, up, 0)
        predicted += _diagonal(source, first * columns + t - first, columns - 1, count)
        _diagonal(plain, at, width - 1, count)[:] = predicted & 255
    return plain.reshape(rows + 1, width, step)[1:, 1:].astype(np.uint8)


def _diagonal(cells: NDArray[np.int16], at: int, stride: int, count: int) -> NDArray[np.int16]:
    """Return a view of `count` rows of `cells`, `stride` apart."""
    if count == 1:
        return cells[at : at + 1]
    return cells[at : at + (count - 1) * stride + 1 : stride]


def _transparent(header: _Header, samples: NDArray[Any], declared: bytes | None) -> NDArray[np.bool_]:
    if header.colour in (GREY_ALPHA, RGB_ALPHA):
        return np.asarray(samples[..., -1] == 0)
    if declared is not None and len(declared) == 2 * header.channels:
        colour = np.frombuffer(declared, ">u2")
        return np.asarray((samples == colour).all(axis=2))
    return np.zeros(samples.shape[:2], bool)


def _painted(
    indices: NDArray[Any], chunks: dict[bytes, bytes], where: str
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    palette = np.frombuffer(chunks.get(b"PLTE", b""), np.uint8)
    if palette.size == 0 or palette.size % 3:
        raise _damaged(where, "no palette")
    colours = palette.reshape(-1, 3)
    if int(indices.max()) >= len(colours):
        raise _damaged(where, f"colour {int(indices.max())} of a palette of {len(colours)}")
    alpha = np.full(len(colours), 255, np.uint8)
    declared = np.frombuffer(chunks.get(b"tRNS", b""), np.uint8)[: len(colours)]
    alpha[: len(declared)] = declared
    return colours[indices], alpha[indices] == 0

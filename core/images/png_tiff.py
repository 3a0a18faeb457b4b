"""PNG and TIFF images, decoded by Pillow.

TIFF images with one sample per pixel are decoded by `tiff` instead. Grey of 1 to 16 bit, palettes, 8-bit colours and
alpha are read. 16-bit colours are refused, because Pillow reduces them to 8 bit. The size is checked before any pixel
is unpacked.
"""

from __future__ import annotations

import io
import re
import struct
import zlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError
from ..foreign import damage_told
from . import tiff
from .raster import Raster, checked_size, grey_of
from .tiff_header import MAGIC as TIFF
from .tiff_header import PHOTOMETRIC, TiffHeader, unreadable

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

PNG = b"\x89PNG\r\n\x1a\n"
_GREY = {"1", "L", "I;16", "I;16B"}  # Pillow's modes of grey images
_COLOUR = {"P", "LA", "RGB", "RGBA"}
_SAMPLES = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # samples per pixel, by the colour type of a PNG
_PASSES = (  # passes of an interlaced PNG: first column, first row, step of the columns, step of the rows
    (0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2),
)  # fmt: skip
_PACKED, _UNPACKED = 1 << 16, 1 << 20  # [bytes] packed data read at a time; largest piece of data unpacked at a time


def decode(data: bytes, where: str) -> Raster:
    """Read a PNG, or the first page of a TIFF.

    Pixels with alpha 0 or with a transparent colour that the file declares are holes.

    Raises:
        DermisError: the image is damaged, cut short or too large, or its pixels would change in Pillow.
    """
    header = TiffHeader.of(data, where) if data.startswith(TIFF) else None
    if header is not None:
        made = tiff.decode(header)
        if made is not None:
            return made
        data = header.changed({})
    with damage_told(tiff.DAMAGED, where, remedy=tiff.REMEDY):
        _opened(data).verify()  # compares the check sums of all parts, which `load` does not
        image = _opened(data)
    columns, rows = image.size
    checked_size(columns, rows, where, packed=len(data))
    bits = _bits(image, where)
    if header is None:
        _check_rows(data, where)
    with damage_told(tiff.DAMAGED, where, remedy=tiff.REMEDY):
        image.load()
        pixels, stored, holes = _pixels(image, bits)
    levels = 1 << bits
    grey, findings = grey_of(pixels, where, levels - 1)
    if header is not None:
        declared, more = tiff.empty(header, stored)
        grey, holes, findings = header.upright(grey), header.upright(holes | declared), findings + more
    return Raster(np.ascontiguousarray(grey[::-1]), np.ascontiguousarray(holes[::-1]), levels, findings)


def _opened(data: bytes) -> ImageFile:
    """Return an image of which only the header has been read.

    Pillow's other formats are not tried, because height maps do not have them.
    """
    from PIL.PngImagePlugin import PngImageFile
    from PIL.TiffImagePlugin import TiffImageFile

    file = io.BytesIO(data)
    return PngImageFile(file) if data.startswith(PNG) else TiffImageFile(file)


def _bits(image: ImageFile, where: str) -> int:
    """Return the bits per sample, from Pillow's name of the packed pixels.

    Examples of such names are 'L;4' and 'I;16B'.
    """
    packed = image.tile[0].args
    name = str(packed if isinstance(packed, str) else packed[0]) if packed else ""
    said = re.search(r";(\d+)", name)
    bits = 1 if image.mode == "1" else int(said.group(1)) if said and image.mode != "P" else 8
    if image.mode not in _GREY | _COLOUR or (bits > 8 and image.mode in _COLOUR):
        raise unreadable(f"{bits} bit, {image.mode}", where)
    return bits


def _check_rows(data: bytes, where: str) -> None:
    """Refuse a PNG whose packed pixels have too few or too many bytes.

    Pillow would fill missing rows with 0 and drop surplus rows.
    """
    columns, rows, depth, colour, _, _, interlaced = struct.unpack_from(">IIBBBBB", data, len(PNG) + 8)
    needed = 0
    for column, row, wide, high in _PASSES if interlaced else ((0, 0, 1, 1),):
        across, down = max(-(-(columns - column) // wide), 0), max(-(-(rows - row) // high), 0)
        if across:  # a pass without pixels has no rows
            needed += down * (1 + (across * depth * _SAMPLES.get(colour, 1) + 7) // 8)
    with damage_told(tiff.DAMAGED, where, remedy=tiff.REMEDY):
        held = _unpacked(data, needed)
    if held != needed:
        raise DermisError(
            "the image has fewer pixels than its size" if held < needed else "the image has more pixels than its size",
            where=where,
            value=f"{held} bytes" if held < needed else f"more than {needed} bytes",
            limit=f"{needed} bytes: {columns} x {rows} of {depth} bit",
            remedy=tiff.REMEDY,
        )


def _unpacked(data: bytes, most: int) -> int:
    """Return the number of bytes to which the pixels of a PNG unpack.

    The count stops once it exceeds `most`.

    Raises:
        EOFError: the packed data end too early.
    """
    stream, held = zlib.decompressobj(), 0
    for part in _packed(data):
        rest: bytes | memoryview = part
        while not stream.eof and held <= most:
            got = len(stream.decompress(rest, _UNPACKED))
            held, rest = held + got, stream.unconsumed_tail
            if not rest and got < _UNPACKED:
                break
    if held < most and not stream.eof:
        raise EOFError(f"its pixels are truncated after {held} bytes of {most}")
    return held


def _packed(data: bytes) -> Iterator[memoryview]:
    """Yield the packed pixels of a PNG in small parts.

    They are in its first consecutive IDAT chunks.
    """
    view, at, begun = memoryview(data), len(PNG), False
    while at + 8 <= len(data):
        size, kind = struct.unpack_from(">I4s", data, at)
        if kind == b"IDAT":
            begun = True
            end = min(at + 8 + size, len(data))
            for i in range(at + 8, end, _PACKED):
                yield view[i : min(i + _PACKED, end)]
        elif begun:
            return
        at += 12 + size


def _pixels(image: ImageFile, bits: int) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.bool_]]:
    """Return brightness, stored samples and holes of an image.

    The shapes are (rows, columns, 1 or 3), (rows, columns, samples) and (rows, columns).
    """
    clear = image.info.get("transparency")
    if image.mode == "P":
        _check_palette(image)
        samples = np.asarray(image.convert("RGBA"))
    else:
        samples = np.atleast_3d(np.asarray(image))
    if image.mode in ("P", "LA", "RGBA"):
        stored = np.asarray(image)[..., None] if image.mode == "P" else samples[..., :-1]
        return samples[..., :-1], stored, samples[..., -1] == 0
    if bits < 8:
        samples = samples // (255 // ((1 << bits) - 1)) if image.mode == "L" else samples.astype(np.uint8)
        clear = None if clear is None else min(clear, (1 << bits) - 1)
    holes = np.zeros(samples.shape[:2], bool) if clear is None else np.asarray((samples == clear).all(axis=2))
    stored = samples
    # A TIFF with photometric 0 stores white as 0. Pillow inverts such samples itself if they have at most 8 bits.
    if getattr(image, "tag_v2", {}).get(PHOTOMETRIC) == 0:
        other = ((1 << bits) - 1) - samples
        samples, stored = (other, samples) if bits == 16 else (samples, other)
    return samples, stored, holes


def _check_palette(image: ImageFile) -> None:
    count = len(image.palette.palette) // len(image.palette.mode) if image.palette else 0
    highest = int(np.asarray(image).max())
    if highest >= count:
        raise ValueError(f"colour {highest} of a palette of {count}")

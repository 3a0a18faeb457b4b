"""TIFF images with one sample per pixel, in strips or tiles.

The samples are whole numbers or floating-point numbers of any size. Other TIFF images are read by Pillow, see
`png_tiff`. Pillow changes samples of types that it lacks: it does not swap the bytes of packed big-endian floats, and
it reads signed bytes as unsigned bytes. In this module, Pillow only unpacks bytes, and the tags of the file decide what
the bytes mean.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError, Finding, Severity
from ..foreign import check_size, damage_told
from . import tiff_header as tags
from .raster import Raster, checked_size, grey_of, largest_of
from .tiff_header import TiffHeader, unreadable

# Compressions that change no byte: none, LZW, Deflate (both numbers), PackBits, LZMA, Zstandard.
_LOSSLESS = {1, 5, 8, 32946, 32773, 34925, 50000}
_PILLOWS = {2, 3, 4, 6, 7}  # compressions that only Pillow reads: those for few bits, and JPEG
_DIFFERENCED = _LOSSLESS - {1, 32773}  # compressions that may have a predictor
DAMAGED, REMEDY = "the image is damaged or cut short", "Save the image again"


def decode(header: TiffHeader) -> Raster | None:
    """Read a TIFF with one sample per pixel; None if Pillow must read it.

    Pillow must read images with several samples per pixel, fewer than 8 bits, a palette, reversed bits, or a
    compression of `_PILLOWS`. Their sample type and compression have then been checked. Pixels that the file declares
    empty are holes, see `empty`.

    Raises:
        DermisError: the image is damaged, cut short or too large, or has samples of a kind that is not read.
    """
    where = header.where
    kind, samples = header.sample_type(), header.number(tags.SAMPLES, 1)
    columns, rows = header.number(tags.WIDTH), header.number(tags.ROWS)
    checked_size(columns, rows, where, packed=len(header.data))
    if samples > 1 and (kind.itemsize > 1 or kind.kind != "u" or samples > 4):
        raise unreadable(f"{8 * kind.itemsize} bit, {samples} samples a pixel", where)
    plain = header.number(tags.PHOTOMETRIC, 1) in (0, 1) and header.number(tags.FILL_ORDER, 1) == 1
    packing = header.number(tags.COMPRESSION, 1)
    if packing not in _LOSSLESS | _PILLOWS:
        raise unreadable(f"compressed by method {packing}", where)
    if samples > 1 or header.number(tags.BITS, 1) < 8 or not plain or packing not in _LOSSLESS:
        if kind.kind != "u" or kind.itemsize > 2:
            raise unreadable(f"{8 * kind.itemsize} bit, compressed as {packing}", where)
        return None
    if packing == 1:
        _check_bytes(header, kind, columns, rows)
    values = _samples(header, kind, columns, rows)
    holes, findings = empty(header, values[..., None])
    if header.number(tags.PHOTOMETRIC, 1) == 0 and kind.kind == "u":  # the file stores white as 0
        values = np.iinfo(kind).max - values
    largest, signed = largest_of(kind)
    grey, _ = grey_of(values[..., None], where, largest)
    levels = 0 if kind.kind == "f" else largest + 1
    return Raster(header.upright(grey)[::-1].copy(), header.upright(holes)[::-1].copy(), levels, findings, signed)


def empty(header: TiffHeader, stored: NDArray[Any]) -> tuple[NDArray[np.bool_], tuple[Finding, ...]]:
    """Return the pixels that a file declares empty, and findings.

    A pixel is empty if all its samples are the file's no-data number, or if the file's mask leaves the pixel out. The
    findings report further pages and declarations that are not read.

    Args:
        header: tags of the image.
        stored: samples as stored, before `TiffHeader.upright`, shape (rows, columns, n).

    Returns:
        Empty pixels, also before `TiffHeader.upright`, shape (rows, columns), and the findings.
    """
    number = header.no_data()
    holes = np.zeros(stored.shape[:2], bool) if number is None else holds(stored, number).all(axis=2)
    rows: list[tuple[Severity, str, str, str, str]] = []
    others = 0
    for page in header.further():
        kind = 0 if page is None else page.number(tags.PAGE_KIND)
        if page is None or not kind & (tags.MASK | tags.REDUCED):
            others += 1
        elif kind & tags.MASK and not kind & tags.REDUCED:
            try:
                holes |= ~_mask(page, holes.shape)
            except DermisError as error:
                what = f"the mask of the valid pixels is not read: {error.what}"
                rows.append(
                    ("warning", "mask-not-read", what, str(error.value), "Write a no-data number instead of it")
                )
    if others:
        what = "the file has further pages, which are not read"
        rows.append(("info", "further-pages", what, str(others), "Save the page that is meant as a file of its own"))
    for role, usual in (("scale", 1.0), ("offset", 0.0)):
        said = header.declared(role)
        if said is not None and said != usual:
            what = f"the file declares a {role} of its numbers, which is not applied"
            rows.append(
                (
                    "warning",
                    f"{role}-not-applied",
                    what,
                    f"{said:g}",
                    "Apply it before saving, or include it in the unit of the heights",
                )
            )
    return np.asarray(holes), tuple(
        Finding(severity, code, what, header.where, value=value, remedy=remedy)
        for severity, code, what, value, remedy in rows
    )


def _mask(page: TiffHeader, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return the pixels that exist according to the page of a mask.

    Args:
        page: the page of the mask.
        shape: rows and columns of the image, before `TiffHeader.upright`.

    Raises:
        DermisError: the page has another size than the image, or is no mask of a known kind.
    """
    from PIL.TiffImagePlugin import TiffImageFile

    size = page.number(tags.ROWS), page.number(tags.WIDTH)
    if size != shape:
        raise DermisError("it has another size", value=f"{size[1]} x {size[0]}")
    bits, packing = page.number(tags.BITS, 1), page.number(tags.COMPRESSION, 1)
    if bits not in (1, 8) or page.number(tags.SAMPLES, 1) != 1 or packing not in _LOSSLESS | _PILLOWS:
        raise DermisError("it is of an unknown kind", value=f"{bits} bit, compressed by method {packing}")
    with damage_told(DAMAGED, page.where, remedy=REMEDY):
        image = TiffImageFile(io.BytesIO(page.changed({tags.PHOTOMETRIC: 1})))
        image.load()
        return np.asarray(image) != 0


def holds(values: NDArray[Any], number: float) -> NDArray[np.bool_]:
    """Return which samples are equal to a number, as their type stores it.

    A number that the type cannot store equals none of them.
    """
    if values.dtype.kind == "f":
        with np.errstate(over="ignore"):
            return np.asarray(values == np.asarray(number).astype(values.dtype))
    ends = np.iinfo(values.dtype)
    if not np.isfinite(number) or number != round(number) or not ends.min <= number <= ends.max:
        return np.zeros(values.shape, bool)
    return np.asarray(values == values.dtype.type(int(number)))


def _check_bytes(header: TiffHeader, kind: np.dtype, columns: int, rows: int) -> None:
    """Refuse uncompressed pixels with more or fewer bytes than needed."""
    tiled = tags.TILE_BYTES in header.entries
    counts = tags.TILE_BYTES if tiled else tags.STRIP_BYTES
    if counts not in header.entries:  # some old writers leave out the counts
        return
    held = sum(header.numbers(counts))
    # Tiles are whole, even at the edges of the image. Strips end with the image, but some writers fill the last strip.
    high = max(header.number(tags.TILE_ROWS if tiled else tags.STRIP_ROWS, rows), 1)
    wide = max(header.number(tags.TILE_WIDTH, columns), 1) if tiled else columns
    needed = rows * columns * kind.itemsize
    filled = -(-rows // high) * high * -(-columns // wide) * wide * kind.itemsize
    if held not in ((filled,) if tiled else (needed, filled)):
        raise DermisError(
            "the number of bytes does not fit the image's size and samples",
            where=header.where,
            value=f"{held} bytes",
            limit=f"{filled if tiled else needed} bytes: {columns} x {rows} of {8 * kind.itemsize} bit",
            remedy=REMEDY,
        )


def _samples(header: TiffHeader, kind: np.dtype, columns: int, rows: int) -> NDArray[Any]:
    """Return the samples in native byte order, shape (rows, columns)."""
    from PIL.TiffImagePlugin import TiffImageFile

    differenced = header.number(tags.COMPRESSION, 1) in _DIFFERENCED
    predictor = header.number(tags.PREDICTOR, 1) if differenced else 1
    if predictor not in (1, 2, 3) or (predictor == 3 and kind.kind != "f"):
        raise unreadable(f"predictor {predictor} of {8 * kind.itemsize} bit", header.where)
    block = header.number(tags.TILE_WIDTH, columns) or columns
    width = -(-columns // block) * block  # tiles are whole, so their rows may extend beyond the image
    check_size(width * rows * kind.itemsize, header.where, packed=len(header.data))
    with damage_told(DAMAGED, header.where, remedy=REMEDY):
        image = TiffImageFile(io.BytesIO(header.as_bytes(kind.itemsize, width)))
        if image.mode != "L" or image.size != (width * kind.itemsize, rows):
            raise ValueError(f"unpacked as {image.mode} {image.size}")
        image.load()
        packed = np.asarray(image).reshape(rows, width // block, block * kind.itemsize)
    if predictor == 3:
        # A row of a block has the first bytes of all samples, then all second bytes, and so on, as differences.
        summed = np.add.accumulate(packed, axis=2, dtype=np.uint8)
        split = summed.reshape(rows, width // block, kind.itemsize, block)
        values = np.ascontiguousarray(split.swapaxes(2, 3)).view(kind.newbyteorder(">"))[..., 0]
    else:
        values = np.ascontiguousarray(packed).view(kind)
        if predictor == 2:
            own = np.dtype(f"=u{kind.itemsize}")  # sums of differences wrap around at the ends of the type
            whole = values.view(np.dtype(f"{kind.str[0]}u{kind.itemsize}") if kind.itemsize > 1 else own).astype(own)
            values = np.add.accumulate(whole, axis=2, dtype=own).view(kind.newbyteorder("="))
    native = values.reshape(rows, width)[:, :columns]
    return np.ascontiguousarray(native.astype(kind.newbyteorder("=")))

"""Raster: an image as heights, before any repair."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError, Finding
from ..foreign import check_size

# Weights of red, green and blue in the luminance of Rec. 709, as in Blender.
LUMINANCE = (0.2126, 0.7152, 0.0722)
MAX_PIXELS = 100_000_000  # 20 um per pixel on a screen of 20 cm, finer than a fingertip can resolve
_AT_ONCE = 1 << 20  # numbers that are in double precision at a time


@dataclass(frozen=True, eq=False)
class Raster:
    """An image with one number per pixel.

    Attributes:
        values: heights, float32, shape (rows, columns), row 0 at the bottom. Whole numbers of the file are divided by
            `largest`; floating-point numbers are as stored.
        holes: pixels that the file declares empty, such as those with alpha 0, bool, same shape.
        levels: number of non-negative values of the format (256 for 8 bit); 0 for floating point.
        findings: findings from reading.
        signed: whether the whole numbers of the format can be negative.
    """

    values: NDArray[np.float32]
    holes: NDArray[np.bool_]
    levels: int
    findings: tuple[Finding, ...] = ()
    signed: bool = False

    @property
    def largest(self) -> int:
        """Stored number that became 1; 1 for floating point."""
        return max(self.levels - 1, 1)


def largest_of(kind: np.dtype) -> tuple[int, bool]:
    """Return the largest number of a type, and whether it is signed.

    For floating point and booleans, the result is (1, False).
    """
    whole = kind.kind in "ui"
    return (int(np.iinfo(kind).max) if whole else 1), kind.kind == "i"


def checked_size(columns: int, rows: int, where: str, *, packed: int | None = None) -> None:
    """Refuse an image without pixels, or with too many for the memory.

    Args:
        columns: columns of pixels.
        rows: rows of pixels.
        where: place of the image in an error.
        packed: bytes of the packed pixels; None if the pixels are not packed.

    Raises:
        DermisError: the image has no pixels or more than `MAX_PIXELS`, or is far larger than its packed bytes.
    """
    if columns <= 0 or rows <= 0:
        raise DermisError("the image has no pixels", where=where, value=f"{columns} x {rows}", limit="at least 1 x 1")
    if columns * rows > MAX_PIXELS:
        raise DermisError(
            "the image is too large",
            where=where,
            value=f"{columns} x {rows}",
            limit=f"{MAX_PIXELS} pixels",
            remedy="Scale it down",
        )
    check_size(columns * rows * np.dtype(np.float32).itemsize, where, packed=packed)


def grey_of(pixels: NDArray[Any], where: str, largest: float = 1.0) -> tuple[NDArray[np.float32], tuple[Finding, ...]]:
    """Turn pixels with one or three numbers into heights.

    Colours become their luminance by Rec. 709, and a finding says so. No gamma curve is undone, because the numbers are
    heights and no colours.

    Args:
        pixels: shape (rows, columns, 1 or 3).
        where: place of the image in a finding.
        largest: the number that becomes 1.

    Returns:
        Heights, shape (rows, columns), and the finding if any pixel has a colour.
    """
    grey = np.empty(pixels.shape[:2], np.float32)
    coloured = 0
    # Few rows at a time: in double precision, all pixels would take eight times the memory of the file.
    rows = max(_AT_ONCE // pixels[0].size, 1)
    for at in range(0, len(pixels), rows):
        part = pixels[at : at + rows].astype(np.float64) / largest
        plain = part[..., 0]
        if part.shape[2] == 3:
            other = (plain != part[..., 1]) | (part[..., 1] != part[..., 2])
            coloured += int(np.count_nonzero(other))
            plain = np.where(other, part @ np.array(LUMINANCE), plain)  # grey pixels stay exactly as stored
        with np.errstate(over="ignore"):  # a height too large for single precision becomes infinite, and later a hole
            grey[at : at + rows] = plain
    if not coloured:
        return grey, ()
    finding = Finding(
        "info",
        "coloured-map",
        "colours were turned into heights by their luminance",
        where=where,
        count=coloured,
        remedy="Use a grey image if the heights were meant otherwise",
    )
    return grey, (finding,)

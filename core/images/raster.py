"""Raster: one picture as heights, before any repair."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError, Finding
from ..foreign import check_size

# Rec. 709 weights: what Blender, and the eye, take for the brightness of a colour.
LUMINANCE = (0.2126, 0.7152, 0.0722)
MAX_PIXELS = 100_000_000  # 20 um apart on a screen of 20 cm, finer than a fingertip tells apart
_AT_ONCE = 1 << 20  # numbers in double precision


@dataclass(frozen=True, eq=False)
class Raster:
    """One picture as one number a pixel.

    Attributes:
        values: row 0 at the bottom; whole-number formats run from 0 to 1, the others are as stored;
            float32, shape (rows, columns).
        holes: pixels that the file itself declares empty (alpha 0), bool, same shape.
        levels: how many values the format can tell apart (256 for 8 bit), 0 for floating point.
        findings: from reading.
        signed: the format's whole numbers reach below 0.
    """

    values: NDArray[np.float32]
    holes: NDArray[np.bool_]
    levels: int
    findings: tuple[Finding, ...] = ()
    signed: bool = False

    @property
    def largest(self) -> int:
        """The stored number that became 1; 1 for floating point."""
        return max(self.levels - 1, 1)


def largest_of(kind: np.dtype) -> tuple[int, bool]:
    """Return the largest number of a type, 1 of floating point and booleans, and whether it has numbers below 0."""
    whole = kind.kind in "ui"
    return (int(np.iinfo(kind).max) if whole else 1), kind.kind == "i"


def checked_size(columns: int, rows: int, where: str, *, packed: int | None = None) -> None:
    """Refuse a picture without pixels, or with more than memory should hold.

    Args:
        packed: bytes that its pixels are unpacked from, where they are.

    Raises:
        DermisError: 0 x 0, more than `MAX_PIXELS`, or a large one out of nearly nothing.
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
    """Turn pixels of one or three numbers into one: Rec. 709 luminance, with a finding where colours differ.

    The numbers are taken as data: no gamma curve is undone, because a height is not a colour.

    Args:
        pixels: shape (rows, columns, 1 or 3). largest: the number that becomes 1.
    """
    grey = np.empty(pixels.shape[:2], np.float32)
    coloured = 0
    rows = max(_AT_ONCE // pixels[0].size, 1)  # a few at a time: doubles of all would take eight times the file
    for at in range(0, len(pixels), rows):
        part = pixels[at : at + rows].astype(np.float64) / largest
        plain = part[..., 0]
        if part.shape[2] == 3:
            other = (plain != part[..., 1]) | (part[..., 1] != part[..., 2])
            coloured += int(np.count_nonzero(other))
            plain = np.where(other, part @ np.array(LUMINANCE), plain)  # greys stay exactly as stored
        with np.errstate(over="ignore"):  # what single precision cannot hold is infinite, a hole of a map
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

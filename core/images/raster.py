"""Raster: one picture as heights, before any repair."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError, Finding

# Rec. 709 weights: what Blender, and the eye, take for the brightness of a colour.
LUMINANCE = (0.2126, 0.7152, 0.0722)
MOST_PIXELS = 1 << 28


@dataclass(frozen=True, eq=False)
class Raster:
    """One picture as one number a pixel.

    Attributes:
        values: row 0 at the bottom; whole-number formats run from 0 to 1, the others are as stored;
            float32, shape (rows, columns).
        holes: pixels that the file itself declares empty (alpha 0), bool, same shape.
        levels: how many values the format can tell apart (256 for 8 bit), 0 for floating point.
        findings: what was noticed while reading.
    """

    values: NDArray[np.float32]
    holes: NDArray[np.bool_]
    levels: int
    findings: tuple[Finding, ...] = ()


def checked_size(columns: int, rows: int, where: str) -> None:
    """Refuse a picture without pixels, or with more than memory should hold.

    Raises:
        DermisError: 0 x 0, or more than 2^28 pixels.
    """
    if columns <= 0 or rows <= 0:
        raise DermisError("the image has no pixels", where=where, value=f"{columns} x {rows}", limit="at least 1 x 1")
    if columns * rows > MOST_PIXELS:
        raise DermisError("the image is too large", where=where, value=f"{columns} x {rows}",
                          limit=f"{MOST_PIXELS} pixels")  # fmt: skip


def grey_of(pixels: NDArray[Any], where: str) -> tuple[NDArray[np.float32], tuple[Finding, ...]]:
    """Turn pixels of one or three numbers into one: Rec. 709 luminance, with a finding where colours differ.

    The numbers are taken as data: no gamma curve is undone, because a height is not a colour.

    Args:
        pixels: shape (rows, columns, 1 or 3).
    """
    if pixels.shape[2] == 1:
        return np.ascontiguousarray(pixels[..., 0], dtype=np.float32), ()
    red, green, blue = pixels[..., 0], pixels[..., 1], pixels[..., 2]
    coloured = int(np.count_nonzero((red != green) | (green != blue)))
    if not coloured:
        return np.ascontiguousarray(red, dtype=np.float32), ()
    weights = LUMINANCE
    grey = (weights[0] * red + weights[1] * green + weights[2] * blue).astype(np.float32)
    finding = Finding(
        "info", "coloured-map", "colours were turned into heights by their luminance", where=where, count=coloured,
        remedy="Use a grey image if the heights were meant otherwise",
    )  # fmt: skip
    return grey, (finding,)

"""NPY files as images of heights; pickled objects are refused."""

from __future__ import annotations

import numpy as np

from ..errors import DermisError
from ..npz import array_of
from .raster import Raster, checked_size, grey_of, largest_of

MAGIC = b"\x93NUMPY"


def decode(data: bytes, where: str) -> Raster:
    """Read an array of heights, first row at the top, any byte order.

    The shape is (rows, columns) or (rows, columns, 1, 3 or 4). Whole numbers are divided by the largest number of their
    type, so that 8-bit and 16-bit images have values from 0 to 1.

    Raises:
        DermisError: the file is damaged, does not hold real numbers, or has another shape.
    """
    array = array_of(data, where)
    if array.dtype.kind not in "buif":
        raise DermisError("the array does not hold real numbers", where=where, value=str(array.dtype))
    if array.ndim == 2:
        array = array[..., None]
    if array.ndim != 3 or array.shape[2] not in (1, 3, 4):
        raise DermisError(
            "the array is not an image", where=where, value=array.shape, limit="(rows, columns[, 1, 3, 4])"
        )
    checked_size(array.shape[1], array.shape[0], where)
    largest, signed = largest_of(array.dtype)
    levels = 0 if array.dtype.kind == "f" else largest + 1
    holes = array[..., 3] == 0 if array.shape[2] == 4 else np.zeros(array.shape[:2], bool)
    grey, findings = grey_of(array[..., :3], where, largest)
    return Raster(np.ascontiguousarray(grey[::-1]), np.ascontiguousarray(holes[::-1]), levels, findings, signed)

"""Gradient of a height map, and its interpolation at any point."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32
from ..errors import DermisError

# Number of points that are interpolated at once; the work arrays then stay in the processor's second-level cache.
CHUNK = 16384
# Number of pixels (2 MB) that the gradient processes at once: enough for the overhead of numpy's calls to be small, and
# few enough for the processor's last-level cache.
RUN = 524288


def metres_of(size: tuple[float, float], height_unit: float) -> float:
    """Return the length of one unit of a map's heights [m].

    It is `height_unit`, or the width of the screen if `height_unit` is 0.

    Args:
        size: width and height of the screen [m].
        height_unit: length of one unit [m], or 0.
    """
    return height_unit if height_unit > 0 else size[0]


def gradient(
    heights: NDArray[np.floating], spacing: tuple[float, float], *, scale: float = 1.0, out: Floats32 | None = None
) -> Floats32:
    """Return the slopes dF/dx and dF/dy, shape (2, rows, columns).

    They are central differences, and one-sided differences at the border. If there is a single row, dF/dy is 0. If
    there is a single column, dF/dx is 0.

    The differences at the border are of first order on purpose. Such a difference is a slope that the surface has
    somewhere (mean value theorem). The steepest slope, which scales a whole bake, is therefore not too large there.

    Args:
        heights: F, shape (rows, columns).
        spacing: width and height of a pixel [m].
        scale: length of one unit of height [m].
        out: array for the result, contiguous float32, shape (2, rows, columns); None for a new array.

    Source: [S4] eq. 2 and 3
    """
    rows, columns = heights.shape
    if out is None:
        out = np.empty((2, rows, columns), np.float32)
    surface = np.ascontiguousarray(heights, None if heights.dtype == np.float32 else np.float64)
    flat, factors = surface.ravel(), [scale / step for step in spacing]
    targets = [plane.reshape(-1) for plane in out]
    # The map is processed in runs along the memory, x and y in turn, so that each run is scaled while it is still in
    # the cache. Differences along x are wrong across the ends of rows, so the first and last column are written last.
    for begin in range(0, flat.size, RUN):
        for target, stride, factor in zip(targets, (1, columns), factors, strict=True):
            first, last = max(begin, stride), min(begin + RUN, flat.size - stride)
            if first < last:
                part = target[first:last]
                ahead, behind = flat[first + stride : last + stride], flat[first - stride : last - stride]
                np.subtract(ahead, behind, out=part, casting="same_kind")
                part *= np.float32(0.5 * factor)
    _border(out[1], surface, factors[1])
    if rows < 2 or columns < 4:
        _border(out[0].T, surface.T, factors[0])
        return out
    # The last pixel of a row and the first of the next row are neighbours in memory, so they are written together.
    seams = flat[columns - 2 : -2].reshape(rows - 1, columns)[:, :4].copy()
    targets[0][columns - 1 : -1].reshape(rows - 1, columns)[:, :2] = (seams[:, 1::2] - seams[:, ::2]) * factors[0]
    out[0, 0, 0] = (surface[0, 1] - surface[0, 0]) * factors[0]
    out[0, -1, -1] = (surface[-1, -1] - surface[-1, -2]) * factors[0]
    return out


def _border(slopes: Floats32, lines: NDArray[np.floating], factor: float) -> None:
    """Write the one-sided slopes at the first and the last line.

    Args:
        slopes: result, shape (lines, pixels). Only its first and last line are written; all of it, with 0, if there is
            a single line.
        lines: heights, rows for the slope dF/dy and columns for dF/dx, shape (lines, pixels).
        factor: length of one unit of the heights, divided by the distance between two lines.
    """
    if len(lines) < 2:
        slopes[...] = 0.0
    else:
        slopes[0] = (lines[1] - lines[0]) * factor
        slopes[-1] = (lines[-1] - lines[-2]) * factor


def steepest(slopes: Floats32) -> float:
    """Return the largest length of a pixel's gradient.

    Args:
        slopes: dF/dx and dF/dy, shape (2, rows, columns).
    """
    squares = slopes[0] * slopes[0]
    squares += slopes[1] * slopes[1]
    return float(np.sqrt(squares.max()))


def bilinear(planes: Sequence[Floats32], size: tuple[float, float], x: Array, y: Array) -> Floats32:
    """Return the values of planes at points, shape (planes, n), float32.

    The interpolation is bilinear. A pixel's value is that at its centre. In the outer half of the pixels at the border,
    and beyond, the values of the border's pixels are used.

    Args:
        planes: arrays of pixels with the same shape, (rows, columns).
        size: width and height of the planes [m].
        x, y: points from the centre of the planes [m], finite, shape (n,).
    """
    count, (rows, columns) = len(planes), planes[0].shape
    # A single row or column is doubled, so that every point is between two of them.
    if rows < 2 or columns < 2:
        twice = 2 if rows < 2 else 1, 2 if columns < 2 else 1
        planes = [plane.repeat(twice[0], axis=0).repeat(twice[1], axis=1) for plane in planes]
    high, wide = planes[0].shape
    flats = [np.ascontiguousarray(plane).ravel() for plane in planes]
    per_x, per_y = columns / size[0], rows / size[1]
    out = np.empty((count, len(x)), np.float32)
    for start in range(0, len(x), CHUNK):
        part = slice(start, start + CHUNK)
        across = np.minimum(np.maximum(x[part] * per_x + (0.5 * columns - 0.5), 0.0), columns - 1.0)
        up = np.minimum(np.maximum(y[part] * per_y + (0.5 * rows - 0.5), 0.0), rows - 1.0)
        column = np.minimum(across.astype(np.int32), wide - 2)
        row = np.minimum(up.astype(np.int32), high - 2)
        right = (across - column).astype(np.float32)
        above = (up - row).astype(np.float32)
        corner = row.astype(np.intp) * wide + column
        for flat, target in zip(flats, out, strict=True):
            low, low_right = flat.take(corner, mode="clip"), flat[1:].take(corner, mode="clip")
            top, top_right = flat[wide:].take(corner, mode="clip"), flat[wide + 1 :].take(corner, mode="clip")
            low_right -= low
            low_right *= right
            low += low_right
            top_right -= top
            top_right *= right
            top += top_right
            top -= low
            top *= above
            np.add(low, top, out=target[part])
    return out


def check_map(heights: NDArray[np.floating], size: tuple[float, float], height_unit: float, where: str = "") -> None:
    """Raise an error for a map that has no gradient.

    Args:
        heights: shape (rows, columns), or (k, rows, columns) for a sequence.
        size: width and height of the screen [m].
        height_unit: length of one unit of the heights [m], or 0.

    Raises:
        DermisError: there are no pixels, the size is not positive and finite, the unit is negative or not finite, or a
            height is not finite.
    """
    where = where or "depth map"
    if heights.ndim not in (2, 3) or heights.size == 0:
        raise DermisError(
            "the map has no pixels",
            where=where,
            value=" x ".join(map(str, heights.shape)),
            limit="rows x columns, at least 1 x 1",
            remedy="Choose an image for the touch screen",
        )
    if not all(np.isfinite(s) and s > 0 for s in size):
        raise DermisError("the screen has no area", where=where, value=f"{size[0]} x {size[1]} m", limit="> 0")
    if not (np.isfinite(height_unit) and height_unit >= 0):
        raise DermisError("the height unit must be positive, or 0 for none", where=where, value=height_unit)
    broken = heights.size - int(np.count_nonzero(np.isfinite(heights)))
    if broken:
        raise DermisError(
            "the map has heights that are not finite numbers",
            where=where,
            value=f"{broken} pixels",
            remedy="Read it through core.effects.depth_map, which fills holes",
        )

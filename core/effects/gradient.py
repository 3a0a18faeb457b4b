"""The gradient field of a height map, and reading it at any point."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32
from ..errors import DermisError

# Points a pass: the work arrays of a chunk stay in the processor's second-level cache.
CHUNK = 16384
# Pixels a run of the gradient (2 MB): long enough to pay for numpy's calls, short enough for the last cache.
RUN = 524288


def metres_of(size: tuple[float, float], height_unit: float) -> float:
    """Return how many metres one unit of a map stands for: `height_unit`, or the screen's width where that is 0."""
    return height_unit if height_unit > 0 else size[0]


def gradient(
    heights: NDArray[np.floating], spacing: tuple[float, float], *, scale: float = 1.0, out: Floats32 | None = None
) -> Floats32:
    """Return dF/dx and dF/dy by central differences, one-sided at the border, shape (2, rows, columns).

    A single row or column has no slope along itself. The border is of first order on purpose: such a difference is a
    slope that the surface really has somewhere (mean value theorem), so the steepest slope, which scales a whole
    bake, is never exaggerated there.

    Args:
        heights: shape (rows, columns).
        spacing: width and height of a pixel [m].
        scale: metres a unit of height.
        out: to be written to, contiguous float32, shape (2, rows, columns).

    Source: [S4] eq. 2 and 3
    """
    rows, columns = heights.shape
    if out is None:
        out = np.empty((2, rows, columns), np.float32)
    surface = np.ascontiguousarray(heights, None if heights.dtype == np.float32 else np.float64)
    flat, factors = surface.ravel(), [scale / step for step in spacing]
    targets = [plane.reshape(-1) for plane in out]
    # Along the memory in runs, x and y in turn, each scaled while it is still in the cache. Differences along x run
    # over the rows' ends too: those two columns are written last.
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
    # A row's last pixel and the next row's first are neighbours in memory: both columns in one visit a row.
    seams = flat[columns - 2 : -2].reshape(rows - 1, columns)[:, :4].copy()
    targets[0][columns - 1 : -1].reshape(rows - 1, columns)[:, :2] = (seams[:, 1::2] - seams[:, ::2]) * factors[0]
    out[0, 0, 0] = (surface[0, 1] - surface[0, 0]) * factors[0]
    out[0, -1, -1] = (surface[-1, -1] - surface[-1, -2]) * factors[0]
    return out


def _border(slopes: Floats32, lines: NDArray[np.floating], factor: float) -> None:
    """Write the one-sided slopes of the first and the last line, across lines."""
    if len(lines) < 2:
        slopes[...] = 0.0
    else:
        slopes[0] = (lines[1] - lines[0]) * factor
        slopes[-1] = (lines[-1] - lines[-2]) * factor


def steepest(slopes: Floats32) -> float:
    """Return the largest length of a pixel's gradient, slopes of shape (2, rows, columns)."""
    squares = slopes[0] * slopes[0]
    squares += slopes[1] * slopes[1]
    return float(np.sqrt(squares.max()))


def bilinear(planes: Sequence[Floats32], size: tuple[float, float], x: Array, y: Array) -> Floats32:
    """Read planes of numbers at points by bilinear interpolation, shape (planes, n), float32.

    A pixel's value belongs to its centre; half a pixel from the border, and beyond, the border's value goes on.

    Args:
        planes: of one shape (rows, columns).
        size: width and height that the planes cover [m].
        x, y: points [m] from the centre, finite, shape (n,).
    """
    count, (rows, columns) = len(planes), planes[0].shape
    # A single row or column is doubled, so that there always is a neighbour.
    if rows < 2 or columns < 2:
        twice = 2 if rows < 2 else 1, 2 if columns < 2 else 1
        planes = [plane.repeat(twice[0], axis=0).repeat(twice[1], axis=1) for plane in planes]
    high, wide = planes[0].shape
    flats = [np.ascontiguousarray(plane).ravel() for plane in planes]
    per_x, per_y = columns / size[0], rows / size[1]
    out = np.empty((count, len(x)), np.float32)
    for start in range(0, len(x), CHUNK):
        part = slice(start, start + CHUNK)
        across = np.clip(x[part] * per_x + (0.5 * columns - 0.5), 0, columns - 1)
        up = np.clip(y[part] * per_y + (0.5 * rows - 0.5), 0, rows - 1)
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
    """Refuse a map that has no gradient.

    Raises:
        DermisError: no pixels, a size or a unit that is not positive and finite, heights that are not finite.
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

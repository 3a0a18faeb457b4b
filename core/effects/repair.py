"""Repairs of a height map: filled holes and smoothed staircases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array

# Numbers of this size and more are holes. Blender's depth pass writes 1e10 for a background at infinity, and no real
# height or depth is as large.
FAR = 1e9
FEWEST_LEVELS, MAX_LEVELS = 16, 256  # smallest and largest number of levels of a staircase
# A number likely stands for 'no data' under two conditions. FREQUENT: at least this share of all pixels is equal to it.
# NEAREST: the distance to the nearest other number is more than this share of the distance to the farthest number. A 0
# that far from all depths is no depth, since a camera cannot measure so near, and rendered depths have no such gap.
FREQUENT, NEAREST = 1e-3, 0.05
# Numbers that programs write for 'no data', besides the ends of the type's range (formats of GDAL and Esri).
CUSTOMARY = (-9999.0, -99999.0, -32767.0, -32768.0, 65535.0)
_RELAXATIONS = 12  # relaxations of filled pixels at each size of blocks
_RADII = (64, 32, 16, 8, 4, 2, 1)  # [pixels] radii of the averages that smooth a staircase, in order of use
_PASSES = 2  # averages with each radius


@dataclass(frozen=True)
class Staircase:
    """Levels of a map's heights.

    Attributes:
        levels: number of different heights; 0 if there are more than 256.
        step: smallest difference of two levels [unit of the map]; 0 if there are fewer than 2 levels or more than 256.
        found: whether the map is a smooth surface that is stored in few levels, see `staircase`.
    """

    levels: int
    step: float
    found: bool


def holes_in(values: NDArray[np.floating], declared: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
    """Return the pixels of a map that have no height, as booleans.

    A pixel has no height if it is declared as empty, if it is not a finite number, or if its absolute value is at least
    `FAR`.

    Args:
        declared: pixels that are known to be empty, booleans, same shape as `values`.
    """
    with np.errstate(invalid="ignore"):
        holes = ~(np.abs(values) < FAR)
    return holes if declared is None else holes | declared


def holds(values: NDArray[Any], number: float) -> NDArray[np.bool_]:
    """Return the pixels of a map that are equal to a number, as booleans.

    The number is first rounded to the precision of the map, since 0.1 in float32 differs from 0.1 in float64.
    """
    if values.dtype.kind != "f":
        return np.asarray(values.astype(np.float64) == number)
    with np.errstate(over="ignore"):
        return np.asarray(values == np.asarray(number).astype(values.dtype))


def likely_holes(depths: Array, *, coarse: bool = False) -> int:
    """Return how many zeros of a depth map stand for 'nothing measured'.

    The result is 0 if the zeros are depths.

    Args:
        depths: shape (n,).
        coarse: whether the depths are brightness in few levels. Black is a depth then, unless many pixels are black
            and the other depths stand apart from black.
    """
    if not depths.size or (depths < 0.0).any():
        return 0
    return (not coarse and _far_off(depths, 0.0)) or _stands_apart(depths, 0.0, NEAREST)


def likely_no_data(values: Array, ends: Sequence[float]) -> tuple[float, int] | None:
    """Return the number that most likely stands for 'no data', and its count.

    The count is the number of pixels that are equal to it. The result is None if no number stands for 'no data'.

    Only the smallest and the largest number are considered. The distance of such a number from all other numbers must
    be larger than the range of the other numbers, and many pixels must be equal to the number. For a number in `ends`,
    one of two weaker conditions is enough: few pixels at that distance, or many pixels at a smaller distance (see
    `NEAREST`). Zero is never returned, because it is the ground of reliefs.

    Args:
        values: heights or depths, shape (n,).
        ends: ends of the range of the numbers' type, and numbers that are customary for 'no data'.
    """
    if not values.size:
        return None
    for number in (float(values.min()), float(values.max())):
        if number == 0.0:
            continue
        few = _far_off(values, number) if number in ends else 0
        if few:
            return number, few
        count = _stands_apart(values, number, NEAREST if number in ends else 0.5)
        if count > 1:
            return number, count
    return None


def _far_off(values: Array, number: float) -> int:
    """Return how many values are equal to a number far from all others.

    The count may be small. The result is 0 if the distance of the number from all other values is not larger than
    their range. If all other values are equal, the result is 0 unless the number is negative: two levels that are not
    negative are a mask.

    Args:
        values: shape (n,).
    """
    same = values == number
    others = values[~same]
    if not 0 < len(others) < len(values):
        return 0
    low, high = others.min(), others.max()
    if max(low - number, number - high) <= high - low or (low == high and number >= 0.0):
        return 0
    return len(values) - len(others)


def _stands_apart(values: Array, number: float, least: float) -> int:
    """Return how many values are equal to a number that stands apart.

    The result is 0 if few values are equal to the number (see `FREQUENT`), if the distance to the nearest other value
    is at most `least` times the distance to the farthest, or if the other values have fewer than 16 levels.

    Args:
        values: shape (n,).
    """
    same = values == number
    count = int(np.count_nonzero(same))
    if count < max(FREQUENT * len(values), 1) or count == len(values):
        return 0
    others = values[~same]
    distances = np.abs(others - number)
    if distances.min() <= least * distances.max():
        return 0
    return count if len(np.unique(_few(others))) >= FEWEST_LEVELS else 0  # fewer are a mask or terraces


def filled(values: Array, holes: NDArray[np.bool_]) -> Array:
    """Return a map whose holes are filled smoothly from their rims.

    Known heights are averaged over blocks of doubling size until every block has a height. Then, from large blocks to
    small ones, each hole gets the height of its block and is relaxed towards the mean of its four neighbours (Laplace's
    equation). Every step is an average. The filled heights therefore stay in the range of the known heights, and no
    peak, pit or slope steeper than that of the rim appears.

    Args:
        values: heights, shape (rows, columns).
        holes: pixels to be filled, booleans, same shape; at least one pixel is not a hole.
    """
    known = ~holes
    if known.all():
        return values
    sums, counts = np.where(known, values, 0.0), known.astype(np.float64)
    levels = []
    while True:
        levels.append((sums, counts))
        if (counts > 0).all() or sums.size == 1:
            break
        # Each block counts as one known height. Otherwise a distant corner with many pixels would outweigh the rim.
        means = np.divide(sums, counts, out=np.zeros_like(sums), where=counts > 0)
        present = (counts > 0).astype(np.float64)
        sums, counts = _halved(means), _halved(present)
    sums, counts = levels.pop()
    result = np.divide(sums, counts, out=np.zeros_like(sums), where=counts > 0)
    while levels:
        sums, counts = levels.pop()
        here = np.divide(sums, counts, out=np.zeros_like(sums), where=counts > 0)
        coarse = result.repeat(2, axis=0).repeat(2, axis=1)[: sums.shape[0], : sums.shape[1]]
        empty = counts == 0
        result = np.where(empty, coarse, here)
        for _ in range(_RELAXATIONS):
            np.copyto(result, _neighbours(result), where=empty)
    return result


def staircase(values: NDArray[np.floating]) -> Staircase:
    """Return the levels of a map, and whether it is a staircase.

    A staircase is a smooth surface that is stored in few levels, as in 8-bit images. It has 16 to 256 levels. Fewer
    levels are a mask or terraces, which are intended. The levels have distances that are multiples of one step, and
    more than a quarter of all changes between neighbouring pixels are a single step.

    Args:
        values: heights, shape (rows, columns).
    """
    levels = np.unique(_few(values))
    if len(levels) > MAX_LEVELS or len(levels) < 2:
        return Staircase(0 if len(levels) > MAX_LEVELS else len(levels), 0.0, False)
    step = float(np.diff(levels).min())
    multiples = (levels.astype(np.float64) - float(levels[0])) / step
    regular = bool(np.abs(multiples - np.rint(multiples)).max() < 0.02)
    if not regular or len(levels) < FEWEST_LEVELS:
        return Staircase(len(levels), step, False)
    changes = np.concatenate([np.abs(np.diff(values, axis=a)).ravel() for a in (-2, -1)])
    changes = changes[changes > 0.5 * step]
    single = np.count_nonzero(changes < 1.5 * step)
    return Staircase(len(levels), step, bool(single > 0.25 * len(changes)))


def smoothed(values: Array, step: float) -> Array:
    """Return a smoothed staircase that still rounds to the same levels.

    The map is averaged over squares of decreasing size. After each average, the heights are limited to half a step
    above and below the stored ones. Edges of more than one step therefore stay sharp.

    Args:
        values: heights, shape (rows, columns).
        step: difference of two neighbouring levels [unit of the map].
    """
    low, high = values - 0.5 * step, values + 0.5 * step
    result = values
    for radius in _RADII:
        for _ in range(_PASSES):
            result = np.clip(_box(_box(result, radius, 0), radius, 1), low, high)
    return result


def _few(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return all values, or a sample of them if it has too many levels.

    A sample is enough then, and sorting a large map is slow. The result has the shape (n,).
    """
    sample = values.ravel()[:: max(1, values.size // 65536)]
    return sample if len(np.unique(sample)) > MAX_LEVELS else values.ravel()


def _halved(values: Array) -> Array:
    rows, columns = values.shape
    padded = np.zeros((rows + rows % 2, columns + columns % 2))
    padded[:rows, :columns] = values
    return np.asarray(padded[0::2, 0::2] + padded[1::2, 0::2] + padded[0::2, 1::2] + padded[1::2, 1::2])


def _neighbours(values: Array) -> Array:
    padded = np.pad(values, 1, mode="edge")
    return 0.25 * (padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:])


def _box(values: Array, radius: int, axis: int) -> Array:
    """Return averages over 2 radius + 1 pixels along an axis.

    Beyond the border, the surface is continued with its slope (reflection in a point).
    """
    radius = min(radius, (values.shape[axis] - 1) // 2)
    if radius < 1:
        return values
    pads = [(0, 0), (0, 0)]
    pads[axis] = (radius + 1, radius)
    padded = np.pad(values, pads, mode="reflect", reflect_type="odd")
    sums = np.cumsum(padded, axis=axis)
    width = 2 * radius + 1
    first, last = [slice(None)] * 2, [slice(None)] * 2
    first[axis], last[axis] = slice(0, -width), slice(width, None)
    return np.asarray((sums[tuple(last)] - sums[tuple(first)]) / width)

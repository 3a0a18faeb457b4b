"""Repairs of a height map: holes filled, staircases of coarse numbers smoothed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array

# A background at infinity is written as 1e10 by Blender's depth pass; no height or depth in use is as large.
FAR = 1e9
FEWEST_LEVELS, MAX_LEVELS = 16, 256
# One number likely stands for 'no data' where it is this share of a map or more, and nothing else is nearer to it than
# this part of the farthest: a camera cannot measure so near, a rendered depth comes down to 0 in small steps.
FREQUENT, NEAREST = 1e-3, 0.05
# Numbers that writers of height maps use for it, besides the ends of their type (GDAL's and Esri's formats).
CUSTOMARY = (-9999.0, -99999.0, -32767.0, -32768.0, 65535.0)
_RELAXATIONS = 12
_RADII = (64, 32, 16, 8, 4, 2, 1)
_PASSES = 2


@dataclass(frozen=True)
class Staircase:
    """Facts about the numbers of a map.

    Attributes:
        levels: how many different heights the map has (0 where there are more than 256).
        step: difference of two neighbouring levels [units of the map].
        found: the heights climb in single steps, with flats between: a smooth surface stored coarsely.
    """

    levels: int
    step: float
    found: bool


def holes_in(values: NDArray[np.floating], declared: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
    """Return where a map has no height: declared empty, not a finite number, or 1e9 and beyond."""
    with np.errstate(invalid="ignore"):
        holes = ~(np.abs(values) < FAR)
    return holes if declared is None else holes | declared


def holds(values: NDArray[Any], number: float) -> NDArray[np.bool_]:
    """Return where a map holds a number, as its own precision would store it: 0.1 is another one in float32."""
    if values.dtype.kind != "f":
        return np.asarray(values.astype(np.float64) == number)
    with np.errstate(over="ignore"):
        return np.asarray(values == np.asarray(number).astype(values.dtype))


def likely_holes(depths: Array, *, coarse: bool = False) -> int:
    """Return how many zeros of a depth map, shape (n,), stand for 'nothing measured'; 0 where they are depths.

    Args:
        coarse: the depths are brightness of few levels, in which black is a depth.
    """
    if not depths.size or (depths < 0.0).any():
        return 0
    return (not coarse and _far_off(depths, 0.0)) or _stands_apart(depths, 0.0, NEAREST)


def likely_no_data(values: Array, ends: Sequence[float]) -> tuple[float, int] | None:
    """Return the number that most likely stands for 'no data', and how many pixels hold it; None where none does.

    It is the largest or the least number, and apart from all others by more than they differ among each other. A number
    at an end of its type may be in few pixels, or nearer to the others where it is in many; any other is in many.
    Zero is the ground that reliefs stand on, and never one.

    Args:
        values: heights or depths, shape (n,). ends: numbers at an end of their type, or customary for it.
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
    """Return how many values are a number, however few; 0 where it is no farther from the others than they differ.

    One other number is enough beside a negative one. Beside others it makes a mask, which has two levels.
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
    """Return how many values are a number; 0 where they are few, or another is as near to it as this part of all."""
    same = values == number
    count = int(np.count_nonzero(same))
    if count < max(FREQUENT * len(values), 1) or count == len(values):
        return 0
    others = values[~same]
    distances = np.abs(others - number)
    if distances.min() <= least * distances.max():
        return 0
    return count if len(np.unique(_few(others))) >= FEWEST_LEVELS else 0  # fewer are a mask or terraces, meant so


def filled(values: Array, holes: NDArray[np.bool_]) -> Array:
    """Fill holes from their rims, smoothly and without ever leaving the range of the known heights.

    Known heights are averaged over blocks of doubling size until every block has one; on the way back each hole
    takes its block's height and is relaxed towards the mean of its four neighbours (Laplace's equation). Every
    step is an average, so no peak, pit or slope steeper than the rim's own appears.

    Args:
        values: shape (rows, columns); at least one pixel is not a hole.
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
        # Blocks count as one known height each, else a far corner full of pixels would outweigh the rim.
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
    """Look whether a map is a smooth surface stored in few levels, as 8-bit images are.

    Sixteen levels at least (a mask or a few terraces are meant as they are) and 256 at most, all multiples of one
    step, and more than a quarter of all changes between neighbours by exactly one step.
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
    """Smooth a staircase within the heights that would have been stored alike.

    The map is averaged over squares of shrinking size, and after each average brought back to within half a step
    of the stored number. The result therefore rounds to the same levels: edges of more than a step stay sharp.

    Args:
        values: shape (rows, columns).
        step: difference of two levels.
    """
    low, high = values - 0.5 * step, values + 0.5 * step
    result = values
    for radius in _RADII:
        for _ in range(_PASSES):
            result = np.clip(_box(_box(result, radius, 0), radius, 1), low, high)
    return result


def _few(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the values, or only a sample that already shows too many levels: sorting a large map is slow."""
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
    """Average over 2 radius + 1 pixels; beyond the border the surface goes on with its slope (point reflection)."""
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

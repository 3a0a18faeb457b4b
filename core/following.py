"""Following a path at limited speed: left behind where it leaps, straight after it, and on it again once caught."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .arrays import Array


def follow(
    target: Array, leaps: NDArray[np.integer], advance: Callable[[int, list[float], list[float]], list[float] | None]
) -> Array:
    """Follow a path as far as each step allows; wherever it can be reached, the result is the path to the bit.

    Args:
        target: shape (n, columns); its first row is where the follower begins.
        leaps: rows that cannot be reached from the row before, rising, from 1 on.
        advance: where a follower gets on the way to a row from a place, given row, place and goal; None: to the goal.

    Returns:
        Shape (n, columns).
    """
    path, caught = target.copy(), 0
    for leap in leaps.tolist():
        if leap < caught:
            continue
        row, place = leap, path[leap - 1].tolist()
        while row < len(target):
            reached = advance(row, place, target[row].tolist())
            if reached is None:
                break
            path[row] = place = reached
            row += 1
        caught = row + 1  # on the target again at `row`; it can next be left behind after it
    return path

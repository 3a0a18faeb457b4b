"""Following a path at limited speed: left behind where it leaps, straight after it, and on it again once caught.

Where the future is known, a follower sets out in time.
"""

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


def in_time(times: Array, wanted: Array, bound: NDArray[np.bool_], slews: Array, rest: Array) -> Array:
    """Return a path that is where it is wanted in time: it leaves its rest early enough, and goes back at once.

    Args:
        times: [s], rising, shape (n,).
        wanted: shape (n, columns). bound: rows of it that count, shape (n,): at others it rests where it can.
        slews: largest change a second of each column, shape (columns,). rest: shape (columns,).

    Returns:
        Shape (n, columns). No path within the limits has a smaller largest distance from the bound rows.
    """
    path = np.where(bound[:, None], wanted, rest)
    if not bound.any() or np.isinf(slews).all():
        return path
    low, high = _cone(times, wanted, bound, slews)
    path[bound] = 0.5 * (low + high)[bound]
    low, high = _cone(times, path, bound, slews)
    path[~bound] = np.clip(path, low, high)[~bound]
    return path


def _cone(times: Array, values: Array, bound: NDArray[np.bool_], slews: Array) -> tuple[Array, Array]:
    """Return the lowest and the highest values that all bound rows can be reached from and left to, (n, columns)."""
    limited = np.isfinite(slews)
    way = times[:, None] * np.where(limited, slews, 0.0)

    def above(rows: Array) -> Array:
        rows = np.where(bound[:, None], rows, np.inf)
        forwards = np.minimum.accumulate(rows - way, axis=0) + way
        return np.minimum(forwards, np.minimum.accumulate((rows + way)[::-1], axis=0)[::-1] - way)

    high, low = above(values), -above(-values)
    return np.where(limited, low, np.where(bound[:, None], values, -np.inf)), np.where(
        limited, high, np.where(bound[:, None], values, np.inf)
    )

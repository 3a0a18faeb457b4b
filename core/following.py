"""Following a path at limited speed.

A follower is left behind when the path leaps. From then on it moves straight towards the present point of the path,
until it has caught up. If the future of the path is known, it can start early enough, see `in_time`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .arrays import Array


def follow(
    target: Array, leaps: NDArray[np.integer], advance: Callable[[int, list[float], list[float]], list[float] | None]
) -> Array:
    """Follow a path as far as each step allows.

    Args:
        target: points of the path, shape (n, columns). The follower begins at the first one.
        leaps: rows of `target` that cannot be reached from the row before them, rising, each at least 1.
        advance: function of a row's index, the follower's point at the row before, and the goal, which is that row of
            `target`. It returns the point that the follower reaches, or None if it reaches the goal.

    Returns:
        Points of the follower, shape (n, columns); exactly those of `target` at all rows that it reaches.
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
        caught = row + 1  # the follower is on the path at `row`, so only a later leap matters
    return path


def in_time(times: Array, wanted: Array, bound: NDArray[np.bool_], slews: Array, rest: Array) -> Array:
    """Return a path of limited speed that sets out early enough for its goals.

    Away from its goals the path is at rest. It leaves rest only as early as the speed requires, and returns at once.

    Args:
        times: times of the rows [s], rising, shape (n,).
        wanted: goals, shape (n, columns).
        bound: True for rows whose goals count, shape (n,). At all other rows the path is as near to rest as the speed
            allows.
        slews: largest change of each column per second, shape (columns,); inf for no limit.
        rest: values of the columns at rest, shape (columns,).

    Returns:
        The path, shape (n, columns). In each column, its largest distance from the goals that count is the smallest
        possible within the limits.
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
    """Return the bounds of the values from which all goals are within reach.

    Goals are the values at rows that are `bound`. For a row and a column, the lower bound exceeds the upper one if no
    value can reach all goals.

    Returns:
        Lower and upper bounds, each of shape (n, columns). In columns without a limit of speed, both bounds are the
        goal at rows that are `bound`, and infinite at all other rows.
    """
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

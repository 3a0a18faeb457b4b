"""Onset: on which side a disc begins a new contact.

At a new contact nothing holds the disc to one side yet, so that several are tried. A touch begins weakly, and many
poses render its first instant alike; from then on friction holds the disc to the one that it began with. So each side
is judged by the residual that it would leave of the same touch once that is strong.

Source: [S0] 5.1 for the search of a frame; the look ahead is this project's own
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import Array
from .gauss_newton import Minimum

FIRST_STARTS = 4  # searches at a touch that is strong at once
FIRST_GAIN = 0.1  # of the cost: for less the side that promised most is kept
SIDES = 8  # searches at a faint touch
AHEAD = 0.3  # of a table's median strength: a touch as strong as that is one that matters
FAINT = 1.5  # times weaker than that
ALIKE = np.radians(0.5)  # of all values, lengths over the platform's radius: nearer poses are the same


def best_side(
    starts: list[Array],
    search: Callable[[Array], Minimum],
    scale: Array,
    left_of: Callable[[Minimum], float] | None = None,
) -> Minimum:
    """Return where the best of several searches ended.

    Args:
        starts: configurations, those that promise most first.
        search: function that returns the minimum found from a configuration.
        scale: scale of a configuration's values, see `disc_device.scale_of`.
        left_of: residual of a strong touch, if the disc began on this side; None where the touch is strong.
    """
    found = [search(start) for start in starts]
    first = found[:FIRST_STARTS]
    best = _least(first, [side.cost for side in first])
    if left_of is None:
        return best
    sides = [best]
    for side in found:
        if all(float(np.abs((side.x - other.x) / scale).max()) > ALIKE for other in sides):
            sides.append(side)
    return _least(sides, [left_of(side) for side in sides])


def _least(sides: list[Minimum], costs: list[float]) -> Minimum:
    """Return the side that costs least, or one before it that costs hardly more."""
    best, least = sides[0], costs[0]
    for side, cost in zip(sides[1:], costs[1:], strict=True):
        if cost < (1.0 - FIRST_GAIN) * least:
            best, least = side, cost
    return best

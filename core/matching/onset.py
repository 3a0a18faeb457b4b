"""Choice of the pose in which a disc begins a new contact.

A new contact has no friction history, so the search starts from several poses. A touch begins weakly, and many poses
render its first instant equally well. From then on friction keeps the disc near the pose in which it began. For a weak
touch, each candidate is therefore judged by a second search: its target is the same stimulus scaled up to a stronger
touch, and its friction state is the one that the candidate leaves. The candidate with the least residual is chosen,
but a later candidate replaces an earlier one only if it lowers the cost by more than `FIRST_GAIN`. The best match of
the weak touch among the first `FIRST_STARTS` starts is the first candidate. The others follow in the order of their
starts' promise.

Source: [S0] 5.1 for the search of a frame. The second search is this project's own.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import Array
from .minimum import Minimum

FIRST_STARTS = 4  # starts of the search if the touch is not weak
FIRST_GAIN = 0.1  # a later start replaces an earlier one only if it lowers the cost by more than this share
SIDES = 8  # starts of the search if the touch is weak
AHEAD = 0.3  # norm of the stronger target, relative to the median norm of the stimuli in the warm-start table
# A touch is weak if the stronger target's norm is at least this many times the norm of the touch's target.
FAINT = 1.5
# Two poses count as the same if no value differs by more than this [rad]. Lengths are divided by the platform's radius.
ALIKE = np.radians(0.5)


def best_side(
    starts: list[Array],
    search: Callable[[Array], Minimum],
    scale: Array,
    left_of: Callable[[Minimum], float] | None = None,
) -> Minimum:
    """Search from several configurations and return the best minimum.

    Args:
        starts: configurations to start from, shape (n,) each, the most promising first.
        search: function that returns the minimum found from a configuration.
        scale: scale of a configuration's values, see `disc_device.scale_of`, shape (n,).
        left_of: function that takes a minimum and returns the residual cost for a stronger target if contact begins at
            this minimum. With it, the distinct minima of all starts are compared by this cost. If it is None, the
            minima of the first `FIRST_STARTS` starts are compared by their own cost.
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
    """Return the minimum of least cost.

    A later minimum replaces an earlier one only if it lowers the cost by more than the share `FIRST_GAIN`.
    """
    best, least = sides[0], costs[0]
    for side, cost in zip(sides[1:], costs[1:], strict=True):
        if cost < (1.0 - FIRST_GAIN) * least:
            best, least = side, cost
    return best

"""Which patterns of pins a skin's mesh can tell apart: the others are not asked for.

Pins that press by turns more and less put less pressure on skin than pins that press alike. How much less follows from
the array: pressures of neighbours overlap. Where a mesh has fewer nodes than there are pins, some patterns put hardly
anything on its nodes, and an inverse would press a hundred times as hard to get something out of them. Real skin
answers to every pattern, so a mesh's answer to those is not about skin.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..arrays import Array
from ..devices.pin_array import PinContacts, PinLayout
from ..errors import Finding
from .deformation import RANK_TOLERANCE, Matcher, Method

# A pattern counts as seen where its gain on the mesh is at least this share of the weakest one's on real skin; chosen
# far enough below 1 that a mesh which sees all patterns, though not all alike, loses none.
SEEN = 0.1


def weakest_gain(points: Array, directions: Array, spread: float) -> float:
    """Return the gain of the weakest pattern of pins on skin over that of the strongest, free of any mesh.

    A pattern's gain is the root mean square of its pressure over that of its forces. Pins press with Gaussians, of
    which two at a distance d overlap by exp(-d^2 / 4 spread^2).

    Args:
        points: points of action of the pins [m], shape (n, 3), n > 0.
        directions: unit vectors, shape (n, 3).
        spread: standard deviation of the Gaussians [m].
    """
    squared = ((points[:, None] - points[None]) ** 2).sum(axis=2)
    gains = np.linalg.eigvalsh(np.exp(-squared / (4.0 * spread**2)) * (directions @ directions.T))
    return float(np.sqrt(max(gains[0], 0.0) / gains[-1]))


def tolerance_of(pins: PinLayout, met: PinContacts) -> float:
    """Return the share of the strongest pattern's gain below which a mesh does not see a pattern."""
    if not met.hits.any():
        return RANK_TOLERANCE
    return max(RANK_TOLERANCE, SEEN * weakest_gain(met.points[met.hits], pins.directions[met.hits], pins.spread))


def doubts(matcher: Matcher, distribution: Array, methods: Iterable[Method], where: str) -> tuple[Finding, ...]:
    """Return a warning where a method inverts the effect of pins on a mesh that is coarser than they are.

    Args:
        matcher: matcher for the skin and the pins.
        distribution: the matrix A, shape (3 m, pins).
        methods: those in use; DM2 and FM2 invert nothing.
    """
    inverting = [m for m in methods if not m.endswith("2")]
    nodes, pins = int(distribution.reshape(-1, 3, matcher.pins).any(axis=(1, 2)).sum()), len(matcher.active)
    if not inverting or nodes >= pins:
        return ()
    return (
        Finding(
            "warning",
            "coarse-skin",
            f"{', '.join(inverting)} on a skin whose mesh is coarser than the pins: "
            f"{pins - matcher.controllable_patterns} of {pins} patterns of pins are left out",
            where,
            f"{nodes} nodes under {pins} pins",
            f">= {pins} nodes",
            "Choose the standard or the fine skin, or DM2 or FM2",
        ),
    )

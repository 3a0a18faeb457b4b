"""Patterns of pin forces that a skin's mesh resolves.

A pattern in which neighbouring pins press alternately more and less makes less pressure on skin than one in which all
pins press alike, because the pressures of neighbours overlap. How much less follows from the array. If a mesh has fewer
nodes than the array has pins, some patterns put hardly any force on its nodes. A pseudoinverse would then use a hundred
times the force to obtain an effect. Real skin responds to every pattern, so this response is an artefact of the mesh,
and methods that invert leave such patterns out.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..arrays import Array
from ..devices.pin_array import PinContacts, PinLayout
from ..errors import Finding
from .deformation import RANK_TOLERANCE, Matcher, Method

# A mesh resolves a pattern if its gain there is at least this share of the weakest pattern's gain on real skin. The
# share is far below 1, so that no pattern is lost on a mesh that resolves all of them, if not equally well.
SEEN = 0.1


def weakest_gain(points: Array, directions: Array, spread: float) -> float:
    """Return the ratio of the weakest to the strongest gain of a pattern of pins, on skin without a mesh.

    A pattern's gain is the RMS of its pressure divided by the RMS of its forces. The pressure of a pin is a Gaussian.
    Two of these at a distance d overlap by exp(-d^2 / 4 spread^2).

    Args:
        points: points of action of the pins [m], shape (n, 3), n > 0.
        directions: unit vectors, shape (n, 3).
        spread: standard deviation of the Gaussians [m].
    """
    squared = ((points[:, None] - points[None]) ** 2).sum(axis=2)
    gains = np.linalg.eigvalsh(np.exp(-squared / (4.0 * spread**2)) * (directions @ directions.T))
    return float(np.sqrt(max(gains[0], 0.0) / gains[-1]))


def tolerance_of(pins: PinLayout, met: PinContacts) -> float:
    """Return the gain below which a mesh does not resolve a pattern, as a share of the strongest gain."""
    if not met.hits.any():
        return RANK_TOLERANCE
    return max(RANK_TOLERANCE, SEEN * weakest_gain(met.points[met.hits], pins.directions[met.hits], pins.spread))


def doubts(matcher: Matcher, distribution: Array, methods: Iterable[Method], where: str) -> tuple[Finding, ...]:
    """Return a warning if a method inverts the effect of pins on a mesh that is coarser than the pins.

    Args:
        matcher: matcher for the skin and the pins.
        distribution: the matrix A, shape (3 m, pins).
        methods: methods in use; DM2 and FM2 do not invert.
        where: name of the finger or device, for the finding.
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

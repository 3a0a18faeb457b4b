"""Legs of a thimble, and a thimble that follows virtual touches, each of its settings free to be chosen."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.devices.linkage import Linkage
from core.devices.thimble import Thimble
from core.matching.thimble import Follower, matcher
from core.matching.thimble_sequence import ThimbleSequence
from core.skin.model import SkinModel


def match_sequence(
    device: Thimble, skin: SkinModel, forces: NDArray[np.float64], method: str = "stress", **settings: Any
) -> ThimbleSequence:
    """Match forces of a virtual touch on the pad nodes [N], shape (n, m, 3); `settings` as in `matcher`."""
    return Follower(matcher(device, skin, method, **settings), skin, method).follow(forces)


def leg_margins(device: Linkage, x: ArrayLike) -> NDArray[np.float64]:
    """Return how far each leg is from being stretched or folded, shape (3,).

    The value is 1 minus the absolute cosine of the angle between the crank and the line from the servo to the joint
    on the platform. It is negative if the leg cannot reach.
    """
    distance = np.array([np.hypot(r, h) for r, h, _, _ in device.leg_planes(device.pose(x))])
    return 1.0 - np.abs((device.crank**2 + distance**2 - device.rod**2) / (2 * device.crank * distance))

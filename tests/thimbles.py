"""A thimble that follows a sequence of virtual touches, each of its settings free to be chosen."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.devices.thimble import Thimble
from core.matching.thimble import Follower, matcher
from core.matching.thimble_sequence import ThimbleSequence
from core.skin.model import SkinModel


def match_sequence(
    device: Thimble, skin: SkinModel, forces: NDArray[np.float64], method: str = "stress", **settings: Any
) -> ThimbleSequence:
    """Match forces of a virtual touch on the pad nodes [N], shape (n, m, 3); `settings` as in `matcher`."""
    return Follower(matcher(device, skin, method, **settings), skin, method).follow(forces)

"""One finger and one body while a scene is swept: what is known so far, and the whole of it at the end."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from .pad_contact import PairContact
from .pad_proxy import PadProxy
from .solver.bodies import BONE


@dataclass
class PairRecord:
    """What is known about a finger and a body so far, in pieces as the chunks brought them.

    Attributes:
        start: samples at which the gap is known, rising.
        gap, normal, point, surface_velocity, smooth_normal: there, as in `PairContact`; the last where a device asks.
        last: the last such sample. seen: the last that `proxy` took in.
        side: of an open surface, on which the finger is, +1 or -1.
        proxy: of a closed surface: which of its sides the finger came from.
    """

    start: list[NDArray[np.intp]] = field(default_factory=list)
    gap: list[Array] = field(default_factory=list)
    normal: list[Array] = field(default_factory=list)
    point: list[Array] = field(default_factory=list)
    surface_velocity: list[Array] = field(default_factory=list)
    smooth_normal: list[Array] = field(default_factory=list)
    last: int = -2
    seen: int = -2
    side: int = 1
    proxy: PadProxy = field(default_factory=lambda: PadProxy(float(BONE[2])))

    def assembled(self, count: int) -> PairContact:
        """Spread what is known over all samples, `count` of them."""
        index = np.concatenate(self.start)
        gap = np.full(count, np.inf)
        gap[index] = np.concatenate(self.gap)
        arrays = []
        for parts in (self.normal, self.point, self.surface_velocity):
            full = np.zeros((count, 3))
            full[index] = np.concatenate(parts)
            arrays.append(full)
        smooth_normal = np.zeros((count, 3)) if self.smooth_normal else None
        if smooth_normal is not None:
            smooth_normal[index] = np.concatenate(self.smooth_normal)
        return PairContact(gap, arrays[0], arrays[1], arrays[2] if arrays[2].any() else None, smooth_normal)

"""One finger and one body while a scene is swept: their distances so far, and all of them at the end."""

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
    """Distances of a finger and a body so far, in pieces as the chunks brought them.

    Attributes:
        start: samples at which the gap is known, rising.
        gap, normal, point, surface_velocity, smooth_normal: there, as in `PairContact`; the last where a device asks.
        last: the last such sample. seen: the last that `proxy` took in.
        side: side of an open surface on which the finger is, +1 or -1.
        proxy: for a closed surface, tracks the side from which the finger came.
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

    def forget(self, first: int) -> None:
        """Forget the chunks before a sample, which one of them begins with."""
        while self.start and self.start[0][-1] < first:
            for pieces in (self.start, self.gap, self.normal, self.point, self.surface_velocity, self.smooth_normal):
                del pieces[:1]

    def assembled(self, first: int, count: int) -> PairContact:
        """Spread the pieces over `count` samples from the first on."""
        index = np.concatenate(self.start) - first

        def spread(parts: list[Array], beyond: float = 0.0) -> Array:
            known = np.concatenate(parts)
            if index.size == count:  # it is known at all of them
                return known
            out = np.full((count, *known.shape[1:]), beyond)
            out[index] = known
            return out

        velocity = spread(self.surface_velocity)
        return PairContact(
            spread(self.gap, np.inf),
            spread(self.normal),
            spread(self.point),
            velocity if velocity.any() else None,
            spread(self.smooth_normal) if self.smooth_normal else None,
        )

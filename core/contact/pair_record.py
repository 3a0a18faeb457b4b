"""PairRecord: gaps between one finger and one body during a sweep."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from .pad_contact import PairContact
from .pad_proxy import PadProxy
from .solver.bodies import BONE


@dataclass
class PairRecord:
    """Gaps between a finger and a body so far, in pieces.

    Attributes:
        start: indices of the samples at which the gap is known, rising.
        gap, normal, point, surface_velocity, smooth_normal: values at these samples, as in `PairContact`. A surface
            that does not move has no velocity. The last is empty if no device uses it.
        last: last sample at which the gap is known.
        seen: last sample that `proxy` has taken.
        side: side of an open surface on which the finger is, +1 or -1.
        proxy: for a closed surface, determines the side from which the finger came.
    """

    start: list[NDArray[np.intp]] = field(default_factory=list)
    gap: list[Array] = field(default_factory=list)
    normal: list[Array] = field(default_factory=list)
    point: list[Array] = field(default_factory=list)
    surface_velocity: list[Array | None] = field(default_factory=list)
    smooth_normal: list[Array] = field(default_factory=list)
    last: int = -2
    seen: int = -2
    side: int = 1
    proxy: PadProxy = field(default_factory=lambda: PadProxy(float(BONE[2])))

    def forget(self, first: int) -> None:
        """Remove the pieces before sample `first`, which is the first of a chunk."""
        while self.start and self.start[0][-1] < first:
            for pieces in (self.start, self.gap, self.normal, self.point, self.surface_velocity, self.smooth_normal):
                del pieces[:1]

    def assembled(self, first: int, count: int) -> PairContact:
        """Return the contact at `count` samples from sample `first` on."""
        index = np.concatenate(self.start) - first

        def spread(parts: Iterable[Array], beyond: float = 0.0) -> Array:
            known = np.concatenate([*parts])
            if index.size == count:  # known at all samples
                return known
            out = np.full((count, *known.shape[1:]), beyond)
            out[index] = known
            return out

        velocity = self.surface_velocity
        moving = (np.zeros_like(p) if v is None else v for v, p in zip(velocity, self.point, strict=True))
        return PairContact(
            spread(self.gap, np.inf),
            spread(self.normal),
            spread(self.point),
            spread(moving) if any(part is not None and part.any() for part in velocity) else None,
            spread(self.smooth_normal) if self.smooth_normal else None,
        )

"""SearchRadius: distance from a pad within which surfaces are measured."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..parameters.finger import FINGER
from ..scene.tactile_scene import Chunk, TactileScene

# A pad that approaches faster than this [m/s] may be detected only at the sample at which it arrives.
FASTEST_APPROACH = 12.0


class SearchRadius:
    """Search radius of each finger: its touch distance, plus a margin for the approach between two samples.

    Args:
        scene: the scene's header; animated touch distances come with the chunks.

    Attributes:
        longest: largest search radius of all fingers so far [m].
    """

    def __init__(self, scene: TactileScene) -> None:
        self._distances = [float(FINGER["touch_distance"].of(f.parameters)) for f in scene.fingers]
        self._keys = [f"finger/{f}/touch_distance" for f in range(len(self._distances))]
        self._margin = FASTEST_APPROACH / scene.rate
        self.longest = max(self._distances, default=0.0) + self._margin

    def over(self, chunk: Chunk) -> Array | None:
        """Return each finger's radius at each sample [m], shape (F, n); None if no touch distance is animated."""
        if not any(key in chunk.animated for key in self._keys):
            return None
        own = np.empty((len(self._keys), len(chunk.times)))
        for f, key in enumerate(self._keys):
            own[f] = chunk.animated.get(key, self._distances[f])
        # A value that is not finite is replaced later by one of this or an earlier chunk.
        radius = np.where(np.isfinite(own), own + self._margin, self.longest)
        self.longest = max(self.longest, float(radius.max()))
        return radius

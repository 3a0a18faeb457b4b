"""SearchRadius: within which distance of a pad a surface must be to be worth measuring."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..parameters.finger import FINGER
from ..scene.tactile_scene import Chunk, TactileScene

# A pad that comes nearer faster than this [m/s] may be noticed only at the sample in which it arrives.
FASTEST_APPROACH = 12.0


class SearchRadius:
    """The distances at which pads count as touching, and a margin for their approach between two samples.

    Args:
        scene: its header; animated distances come with the chunks.

    Attributes:
        longest: largest search radius of all fingers so far [m].
    """

    def __init__(self, scene: TactileScene) -> None:
        self._distances = [float(FINGER["touch_distance"].of(f.parameters)) for f in scene.fingers]
        self._keys = [f"finger/{f}/touch_distance" for f in range(len(self._distances))]
        self._margin = FASTEST_APPROACH / scene.rate
        self.longest = max(self._distances, default=0.0) + self._margin

    def over(self, chunk: Chunk) -> Array | None:
        """Return each finger's radius at each sample [m], shape (F, n), or None where no touch distance is animated."""
        if not any(key in chunk.animated for key in self._keys):
            return None
        own = np.empty((len(self._keys), len(chunk.times)))
        for f, key in enumerate(self._keys):
            own[f] = chunk.animated.get(key, self._distances[f])
        # A value that is no number is held later, at one that this chunk or an earlier one has.
        radius = np.where(np.isfinite(own), own + self._margin, self.longest)
        self.longest = max(self.longest, float(radius.max()))
        return radius

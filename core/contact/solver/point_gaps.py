"""Replacement of the gaps of points."""

from __future__ import annotations

import numpy as np

from ...arrays import Indices
from .bodies import NodeGaps

# Gaps of a point, and their values beyond reach.
_BEYOND = {
    "gap": np.inf,
    "clearance": np.inf,
    "normal": 0.0,
    "body": -1,
    "triangle": -1,
    "friction": 0.0,
    "softness": 0.0,
}


def passed_on(gaps: NodeGaps, former: Indices) -> NodeGaps:
    """Return the gaps of other points: each has those of a former point, or is beyond reach with -1, shape (n,)."""
    none = (former < 0).nonzero()[0]
    arrays = {name: getattr(gaps, name).take(former, axis=0, mode="clip") for name in _BEYOND}
    if len(none):
        for name, far in _BEYOND.items():
            arrays[name][none] = far
    return NodeGaps(gaps.bodies, **arrays)

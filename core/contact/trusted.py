"""Trusted: how deep a finger may go into things, and how far it may be dragged, before its model of tissue is off.

Linear skin keeps the depth that it always had. Tissue that stiffens is trusted as deep, and dragged as far, as it was
measured to be no more than `WORST` off; beyond, frames are told.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

from ..parameters.error_bands import DEPTHS, LINEAR, NEO_HOOKEAN, SLID_AT, SLIDES, error_band
from .solver.path_solver import DEPTH_LIMIT

# Of the stress, in half of the touches: what linear skin reaches at its depth limit.
WORST = error_band(LINEAR, DEPTH_LIMIT).stress.median
WORDS = {LINEAR: "linear", NEO_HOOKEAN: "neo-Hookean"}


class Range(NamedTuple):
    """The greatest depth of the undeformed skin, and slide (see `PathStep.slide`), that a tissue is trusted at [m]."""

    depth: float
    slide: float


@lru_cache(maxsize=4)
def trusted(tissue: str) -> Range:
    """Return the range of a tissue.

    Raises:
        DermisError: an unknown tissue.
    """
    if tissue == LINEAR:
        return Range(DEPTH_LIMIT, math.inf)
    deep = [d for d in DEPTHS if error_band(tissue, d).stress.median <= WORST]
    far = [s for s in SLIDES if error_band(tissue, SLID_AT, s).stress.median <= WORST]
    return Range(max(deep, default=DEPTHS[0]), max(far, default=SLIDES[0]))

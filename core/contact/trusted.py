"""Range of penetration and slide within which a model of the tissue is trusted.

Beyond it, frames are reported. For linear skin, the range is a fixed penetration. For nonlinear skin, it is the largest
penetration and slide at which the error of the model was measured to be at most `WORST`.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

from ..parameters.error_bands import DEPTHS, LINEAR, NEO_HOOKEAN, SLID_AT, SLIDES, error_band
from .solver.path_solver import DEPTH_LIMIT

# Median error of the stress that counts as acceptable: that of linear skin at its depth limit.
WORST = error_band(LINEAR, DEPTH_LIMIT).stress.median
WORDS = {LINEAR: "linear", NEO_HOOKEAN: "neo-Hookean"}


class Range(NamedTuple):
    """Range within which a model of the tissue is trusted.

    Attributes:
        depth: largest penetration of the undeformed skin [m].
        slide: largest slide, see `PathStep.sums` [m].
    """

    depth: float
    slide: float


@lru_cache(maxsize=4)
def trusted(tissue: str) -> Range:
    """Return the range of a tissue model, 'linear' or 'neo_hookean'.

    Raises:
        DermisError: the tissue model is unknown.
    """
    if tissue == LINEAR:
        return Range(DEPTH_LIMIT, math.inf)
    deep = [d for d in DEPTHS if error_band(tissue, d).stress.median <= WORST]
    far = [s for s in SLIDES if error_band(tissue, SLID_AT, s).stress.median <= WORST]
    return Range(max(deep, default=DEPTHS[0]), max(far, default=SLIDES[0]))

"""Range of penetration and slide within which a model of the tissue is trusted.

Beyond it, frames are reported. For linear skin, the range of the penetration is fixed; for nonlinear skin, it is the
largest penetration at which the error of the model was measured to be at most `WORST`. The range of the slide is the
largest one that adds at most as much to the error, between measured slides by interpolation.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

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
    deep = [d for d in DEPTHS if error_band(tissue, d).stress.median <= WORST]
    more = [_stress(tissue, s) - _stress(tissue, 0.0) for s in SLIDES]
    depth = DEPTH_LIMIT if tissue == LINEAR else max(deep, default=DEPTHS[0])
    return Range(depth, float(np.interp(WORST, more, SLIDES)))


def _stress(tissue: str, slide: float) -> float:
    """Return the median error of the stress of a tissue that slid, at the depth at which slides were measured."""
    return error_band(tissue, SLID_AT, slide).stress.median

"""Working out a skin's stiffening in a child process: nothing comes back but the file it leaves in the cache."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cache import Cache
from ..skin.model import shape_and_material
from ..skin.shape import FingertipShape
from ..steps import drain
from . import stiffening_store as store
from .stiffening_fit import STEPS


def make_stiffening(
    arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], report: Callable[[int, int], None]
) -> dict[str, NDArray[Any]]:
    """Put the stiffening of a fingertip into a cache; return how many patterns it has.

    Args:
        arrays: not used.
        parameters: 'skin' (as in a skin preset, SI), 'folder' and 'limit' [bytes] of the cache.

    Raises:
        DermisError: a mesh of one's own, Poisson's ratio out of range, or a folder that cannot be written.
    """
    cache, shape, poisson = _asked(parameters)
    made = drain(store.make_stiffening(shape, poisson, cache=cache), lambda step: report(*step))
    report(STEPS, STEPS)
    return {"patterns": np.array(made.count)}


def _asked(parameters: Mapping[str, Any]) -> tuple[Cache, FingertipShape, float]:
    cache = Cache(Path(str(parameters["folder"])), int(parameters["limit"]))
    shape, material = shape_and_material(parameters["skin"])
    if shape is None:
        raise store.no_shape()
    return cache, shape, material.poisson

"""Making a skin in a child process: nothing comes back but the files it leaves in the cache."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cache import Cache
from .model import skin_from_parameters

STAGES = 2


def make(
    arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], report: Callable[[int, int], None]
) -> dict[str, NDArray[Any]]:
    """Put a skin and its table of responses into a cache; return its number of tetrahedra and of pad nodes.

    Args:
        arrays: not used.
        parameters: 'skin' (as in a skin preset, SI), 'level', 'folder' and 'limit' [bytes] of the cache.

    Raises:
        DermisError: a skin that cannot be made, or a folder that cannot be written.
    """
    report(0, STAGES)
    cache = Cache(Path(str(parameters["folder"])), int(parameters["limit"]))
    model = skin_from_parameters(parameters["skin"], level=str(parameters["level"]), cache=cache)
    report(1, STAGES)
    assert model.unit_response.size  # computed, and with that stored
    report(STAGES, STAGES)
    return {"tetrahedra": np.array(len(model.mesh.tetrahedra)), "pad": np.array(model.pad_count)}

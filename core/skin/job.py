"""Jobs of a child process that compute a skin or its smooth pad."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cache import Cache
from ..errors import DermisError
from ..files import read_bytes
from ..steps import drain
from .model import shape_and_material, skin_from_parameters
from .remainder import STEPS
from .surface_store import QUICK, make_remainder

STAGES = 2  # number of stages that `make` reports


def make(
    arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], report: Callable[[int, int], None]
) -> dict[str, NDArray[Any]]:
    """Compute a skin and its table of responses, and store them in a cache.

    Args:
        arrays: not used.
        parameters: 'skin' (as in a skin preset, in SI units), 'level', 'folder' and 'limit' [bytes] of the cache.
        report: function that is called with the number of finished stages and the number of all stages.

    Returns:
        'tetrahedra' and 'pad': numbers of tetrahedra and of pad nodes.

    Raises:
        DermisError: the skin cannot be computed, or the folder cannot be written.
    """
    report(0, STAGES)
    cache = Cache(Path(str(parameters["folder"])), int(parameters["limit"]))
    model = skin_from_parameters(parameters["skin"], level=str(parameters["level"]), cache=cache)
    report(1, STAGES)
    assert model.unit_response.size  # the access computes and stores the table
    report(STAGES, STAGES)
    return {"tetrahedra": np.array(len(model.mesh.tetrahedra)), "pad": np.array(model.pad_count)}


def make_files(
    arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], report: Callable[[int, int], None]
) -> dict[str, NDArray[Any]]:
    """Compute a skin as `make` does, and return its cache files.

    This is for machines without a common folder. The result has the bytes of each file by the file's name.

    Args:
        arrays: not used.
        parameters: 'skin' (as in a skin preset, in SI units) and 'level'.
        report: as for `make`.

    Raises:
        DermisError: the skin cannot be computed.
    """
    with tempfile.TemporaryDirectory(prefix="dermis-skin-", ignore_cleanup_errors=True) as folder:
        make(arrays, {**parameters, "folder": folder, "limit": 1 << 40}, report)
        files = sorted(path for path in Path(folder).glob("*/*") if path.is_file())
        return {path.name: np.frombuffer(read_bytes(path), np.uint8) for path in files}


def make_surface(
    arrays: Mapping[str, NDArray[Any]], parameters: Mapping[str, Any], report: Callable[[int, int], None]
) -> dict[str, NDArray[Any]]:
    """Compute the remainder of a smooth pad, and store it in a cache.

    Args:
        arrays: not used.
        parameters: 'skin' (as in a skin preset, in SI units), 'folder' and 'limit' [bytes] of the cache, and optionally
            'level' of the mesh.
        report: as for `make`.

    Returns:
        'rank': number of functions of the remainder.

    Raises:
        DermisError: the skin is a mesh of the user's own, which has no smooth pad, or the folder cannot be written.
    """
    cache = Cache(Path(str(parameters["folder"])), int(parameters["limit"]))
    shape, material = shape_and_material(parameters["skin"])
    if shape is None:
        raise DermisError("a mesh of your own has no smooth pad", where="skin", code="no-smooth-pad")
    level = str(parameters.get("level", QUICK))
    made = drain(make_remainder(shape, material.poisson, level, cache=cache), lambda step: report(*step))
    report(STEPS, STEPS)
    return {"rank": np.array(made.rank)}

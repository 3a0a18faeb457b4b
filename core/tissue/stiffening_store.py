"""Where tables of how skin stiffens come from: a file that ships, or the cache."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from ..cache import Cache, cache_key
from ..errors import DermisError
from ..skin.shape import FingertipShape
from ..stiffening.stiffening import Stiffening

STIFFENING_VERSION = 1


def stiffening_key(shape: FingertipShape, poisson: float) -> str:
    """Return the key of a table: it depends on the shape and on Poisson's ratio, and on nothing else."""
    lengths = {name: round(length, 9) for name, length in asdict(shape).items()}
    return cache_key(
        f"dermis-stiffening {STIFFENING_VERSION}", json.dumps(lengths, sort_keys=True), repr(round(poisson, 6))
    )


def shipped_name(shape: FingertipShape, poisson: float) -> str:
    """Return the name of the file in which a table ships."""
    return f"stiffening_{stiffening_key(shape, poisson)[:16]}.npz"


def find_stiffening(
    shape: FingertipShape, poisson: float, *, shipped: Path | None = None, cache: Cache | None = None
) -> Stiffening | None:
    """Return a table that was made before, or None: one that ships, else from the cache."""
    places = [None if shipped is None else shipped / shipped_name(shape, poisson)]
    places.append(None if cache is None else cache.get(stiffening_key(shape, poisson)))
    for path in places:
        if path is None or not path.is_file():
            continue
        try:
            return Stiffening.read(path)
        except DermisError:  # damaged: it can be made again
            continue
    return None

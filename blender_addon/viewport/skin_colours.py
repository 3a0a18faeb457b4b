"""Colour maps for values on skin, as tables of 256 colours (sRGB)."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from .._core import Array

COUNT = 256
# Colours at equal distances from low to high. Source: matplotlib's inferno and viridis (CC0), sampled.
_STOPS: dict[str, tuple[str, ...]] = {
    "inferno": (
        "000004",
        "160b39",
        "420a68",
        "6a176e",
        "932667",
        "bc3754",
        "dd513a",
        "f37819",
        "fca50a",
        "f6d746",
        "fcffa4",
    ),
    "viridis": (
        "440154",
        "482475",
        "414487",
        "355f8d",
        "2a788e",
        "21918c",
        "22a884",
        "44bf70",
        "7ad151",
        "bddf26",
        "fde725",
    ),
    "grey": ("1a1a1a", "f5f5f5"),
    # blue, white and orange: the sign is visible without distinguishing red from green
    "signed": ("0b3c8c", "2f6cc4", "73a6e0", "b9d3f0", "f2f2f2", "f8d2a8", "f2a254", "dd7413", "9c4a00"),
}


@cache
def table(name: str) -> NDArray[np.float32]:
    """Return a colour map, red, green and blue from 0 to 1, shape (256, 3)."""
    return at(name, np.linspace(0.0, 1.0, COUNT)).astype(np.float32)


def at(name: str, levels: Array) -> Array:
    """Return the colours of levels from 0 to 1, shapes (n,) and (n, 3)."""
    stops = np.array([[int(s[i : i + 2], 16) / 255.0 for i in (0, 2, 4)] for s in _STOPS[name]])
    where = np.linspace(0.0, 1.0, len(stops))
    return np.stack([np.interp(levels, where, stops[:, k]) for k in range(3)], axis=1)


def segments(name: str) -> int:
    """Return the number of linear parts of a colour map."""
    return len(_STOPS[name]) - 1

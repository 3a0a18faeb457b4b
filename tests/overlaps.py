"""Tiles of a pad that overlap."""

from __future__ import annotations

import numpy as np

from core.arrays import Array, Indices
from core.skin.tiles import Tiles


def overlap(all_tiles: Tiles, tiles: Indices, others: Indices) -> tuple[Indices, Indices, Array]:
    """Return the pairs of tiles in `tiles` and `others` that overlap.

    Returns:
        For each pair, the position in `tiles`, the position in `others`, and the share of the first tile's area
        that the second one covers, shape (k,) each. Areas are those in the chart.
    """
    order = np.argsort(all_tiles.root[others], kind="stable")
    ranked = all_tiles.root[others[order]]
    low, high = (np.searchsorted(ranked, all_tiles.root[tiles], side) for side in ("left", "right"))
    one = np.repeat(np.arange(len(tiles)), high - low)
    two = order[np.arange(len(one)) - np.repeat(np.cumsum(high - low) - high, high - low)]
    ends = []
    for cells, which in ((tiles, one), (others, two)):
        size = (1 << all_tiles.levels) >> all_tiles.halved[cells]
        start = all_tiles.place[cells] * size
        ends += [start[which], (start + size)[which]]
    low, high, low_, high_ = ends
    sides = np.maximum(np.minimum(high, high_) - np.maximum(low, low_), 0) / (high - low)
    share = sides[:, 0] * sides[:, 1]
    met = np.flatnonzero(share > 0.0)
    return one[met], two[met], share[met]

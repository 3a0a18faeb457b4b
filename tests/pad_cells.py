"""Cells of a pad that cover others."""

from __future__ import annotations

import numpy as np

from core.arrays import Indices
from core.skin.pad_chart import PadChart


def descendants(chart: PadChart, cells: Indices, level: int) -> tuple[Indices, Indices]:
    """Return the cells of a level that cover given cells.

    A given cell of this level, or of a finer one, is returned as it is. Bars are not allowed.

    Returns:
        The cells, shape (k,), and for each the position in `cells` of the cell in which it lies, shape (k,).
    """
    found, owner = np.asarray(cells), np.arange(len(cells))
    while (coarse := chart.levels[found] < level).any():
        split = chart.children(found[coarse]).ravel()
        found = np.concatenate([found[~coarse], split])
        owner = np.concatenate([owner[~coarse], np.repeat(owner[coarse], 4)])
    order = np.argsort(owner, kind="stable")
    return found[order], owner[order]

"""Succession: which points come in the place of which, when cells are split and merged.

Force is passed on whole: a cell's goes to those that it overlaps, in proportion to the overlap, so that cells
that are merged leave the sum of theirs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Indices
from ...skin.pad_chart import PadChart


@dataclass(frozen=True, eq=False)
class Succession:
    """Points that come in others' place.

    Attributes:
        heirs: indices of the new cells, one for each pair of an old cell and a new one, shape (n,).
        sources: indices of the old cells, shape (n,).
        shares: share of the old cell's force that the new cell inherits, shape (n,).
    """

    heirs: Indices
    sources: Indices
    shares: Array

    def force(self, old: Array, new: Array) -> None:
        """Add the forces of old points [N] to new ones, in place."""
        np.add.at(new, self.heirs, self.shares[:, None] * old[self.sources])

    def main(self, load: Array) -> tuple[Indices, Indices]:
        """Return each heir once, and of its sources the one with the largest load."""
        order = np.lexsort((-load[self.sources], self.heirs))
        heirs, first = np.unique(self.heirs[order], return_index=True)
        return heirs, self.sources[order][first]


def succession(chart: PadChart, leaving: Indices, sources: Indices, entering: Indices) -> Succession:
    """Return which cells that enter come in the place of which that leave, the first heir counted 0.

    Args:
        leaving: cells, shape (k,). sources: their places, shape (k,). entering: cells, shape (n,).
    """
    old, heir, share = chart.tiles.overlap(leaving, entering)
    total = np.bincount(old, share, minlength=len(leaving))
    return Succession(heir, sources[old], share / total[old])

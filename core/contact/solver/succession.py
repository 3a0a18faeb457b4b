"""Succession: transfer of state from removed points to new ones when cells are split or merged.

The force of a cell is distributed to the cells that it overlaps, in proportion to the overlap. The total force is then
conserved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Indices
from ...skin.pad_chart import PadChart


@dataclass(frozen=True, eq=False)
class Succession:
    """New cells with the former cells that they replace.

    Attributes:
        heirs: indices of the new cells, one for each pair of an old cell and a new one, shape (n,).
        sources: indices of the old cells, shape (n,).
        shares: share of the old cell's force that the new cell inherits, shape (n,).
    """

    heirs: Indices
    sources: Indices
    shares: Array

    def force(self, old: Array, new: Array) -> None:
        """Add the forces of former points [N] to those of new points, in place."""
        np.add.at(new, self.heirs, self.shares[:, None] * old[self.sources])

    def main(self, load: Array) -> tuple[Indices, Indices]:
        """Return each new cell once, with the former cell of largest load that it replaces."""
        order = np.lexsort((-load[self.sources], self.heirs))
        heirs, first = np.unique(self.heirs[order], return_index=True)
        return heirs, self.sources[order][first]


def succession(chart: PadChart, leaving: Indices, sources: Indices, entering: Indices) -> Succession:
    """Return the relation between removed and added cells.

    Args:
        chart: chart of the pad.
        leaving: indices of the removed cells, shape (k,).
        sources: positions of their points, shape (k,).
        entering: indices of the added cells, shape (n,); the first has the number 0 in `Succession.heirs`.
    """
    old, heir, share = chart.tiles.overlap(leaving, entering)
    total = np.bincount(old, share, minlength=len(leaving))
    return Succession(heir, sources[old], share / total[old])

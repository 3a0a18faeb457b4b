"""PointHistory: which points come in the place of which, when cells are split and merged.

Force is passed on whole: a cell's goes to those that it is split into by their areas, and cells that are merged leave
the sum of theirs.
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
        heirs: by their place in the new cells, one for each pair of an old cell and a new one, shape (n,).
        sources: by their place in the old cells, shape (n,). shares: of the source's force, shape (n,).
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


def succession(chart: PadChart, areas: Array, leaving: Indices, sources: Indices, entering: Indices) -> Succession:
    """Return which cells that enter come in the place of which that leave, the first heir counted 0.

    Args:
        areas: of all cells [m^2]. leaving: cells, shape (k,). sources: their places, shape (k,).
        entering: cells, shape (n,).
    """
    heirs, olds = [], []
    for below, above, merged in ((leaving, entering, True), (entering, leaving, False)):
        child, parent = _within(chart, below, above)
        heirs.append(parent if merged else child)
        olds.append(child if merged else parent)
    merged_count = len(heirs[0])
    heir, old = np.concatenate(heirs), np.concatenate(olds)
    share = np.ones(len(heir))
    size = areas[entering[heir[merged_count:]]]
    total = np.bincount(old[merged_count:], size, minlength=len(leaving))
    share[merged_count:] = size / total[old[merged_count:]]
    return Succession(heir, sources[old], share)


def _within(chart: PadChart, cells: Indices, others: Indices) -> tuple[Indices, Indices]:
    """Return pairs of a cell and one of the others that it lies in, by their places."""
    order = np.argsort(others)
    ranked = others[order]
    found: list[tuple[Indices, Indices]] = []
    index, up = np.arange(len(cells)), cells
    while len(ranked):
        up = chart.parent(up)
        kept = up >= 0
        index, up = index[kept], up[kept]
        if not len(index):
            break
        at = np.minimum(np.searchsorted(ranked, up), len(ranked) - 1)
        hit = ranked[at] == up
        found.append((index[hit], order[at[hit]]))
    if not found:
        none = np.zeros(0, dtype=np.int64)
        return none, none
    first, second = zip(*found, strict=True)
    return np.concatenate(first), np.concatenate(second)

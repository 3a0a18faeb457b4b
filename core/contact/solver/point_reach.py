"""PointReach: upper bounds of the skin's displacement all over a pad.

Skin bulges beside an object, so the displacement is needed not only at contact points. At points it is known. Elsewhere
skin carries no force, and its displacement is smooth. There, forces are summed over blocks of four cells, and the
displacement is computed at every second cell. The bound of a cell is the largest displacement at its own centre and
those of its neighbours, because one of them is nearer to the object.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Array, Floats32, Indices
from ...skin.pad_chart import PadChart
from ...skin.row_table import RowTable
from ...skin.surface_compliance import SurfaceCompliance
from .cone import carrying


class PointReach:
    """Bounds of the displacement of all cells of level 0 of a pad.

    Args:
        pad: compliance between cells of the pad.

    Attributes:
        places: centres of the cells at rest [m], shape (p, 3).
        sizes: largest distance of a point of each cell from its centre [m], shape (p,).
    """

    def __init__(self, pad: SurfaceCompliance) -> None:
        self._pad, self._chart, roots = pad, pad.chart, pad.chart.beside
        self.places: Array = pad.cells.positions[self._chart.base]
        corners = self._chart.corners(self._chart.base)
        self.sizes: Array = np.linalg.norm(corners - self.places[:, None], axis=2).max(axis=1)
        odd = np.append(self._chart.base % 2 == 1, False)
        odd[:-1] &= ~odd[roots[:, 1, [0, 2]]].any(axis=1)  # cells for which the neighbours around the finger are enough
        self._told = np.flatnonzero(~odd[:-1])
        self._about: Indices = np.ascontiguousarray(roots.reshape(len(roots), -1).T)
        self._blocks, self._members = _blocks(self._chart)
        self._rows = RowTable(len(self._members), self._made)

    def moved(self, cells: Indices, force: Array, image: Array) -> Array:
        """Return an upper bound of the displacement in each cell [m], shape (p,).

        Args:
            cells: cells whose centres are the points, shape (n,).
            force: forces on the points [N], shape (n, 3).
            image: displacement of the points [m], shape (n, 3).
        """
        roots, loaded = self._chart.tiles.root[cells], carrying(force).nonzero()[0]
        under, which = np.unique(self._blocks[roots[loaded]], return_inverse=True)
        on: Array = np.stack([np.bincount(which, force[loaded, k], len(under)) for k in range(3)], axis=1)
        far = self._pad.displaced(self._rows[under], on)
        most = np.zeros(len(self.places) + 1)
        most[self._told] = np.sqrt(np.einsum("ij,ij->i", far, far))
        np.maximum.at(most, roots, np.sqrt(np.einsum("ij,ij->i", image, image)))
        return np.asarray(most.take(self._about).max(axis=0))

    def _made(self, blocks: Indices) -> Floats32:
        """Return the displacement at every second cell for forces spread over blocks."""
        coarse = self._pad.coarse
        means = [coarse[self._members[block]][:, :, self._told].mean(axis=0) for block in blocks.tolist()]
        return np.asarray(np.stack(means))


def _blocks(chart: PadChart) -> tuple[Indices, list[Indices]]:
    """Return the block of each cell of level 0, and the cells of each block of two by two."""
    half = chart.halves[chart.base]
    corner = np.floor((chart.places[chart.base] - [chart.shape.reach, 0.0]) / (4.0 * half) + 1e-9)
    size = np.round(np.log2(half.max(axis=0) / half))
    _, block, count = np.unique(np.hstack([corner, size]), axis=0, return_inverse=True, return_counts=True)
    block = block.reshape(-1)
    return block, np.split(np.argsort(block, kind="stable"), np.cumsum(count)[:-1])

"""PointReach: how far skin has moved all over a pad, and not only at points: it bulges out beside an object.

Where points are, how far is known. Elsewhere skin carries no force, and moves the more smoothly the farther it is from
forces; so those are taken together by four cells, and it is told at every second cell. Nowhere in a cell does skin move
more than at the centre of it or of one beside it: of two neighbours one is nearer to the object.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Array, Floats32, Indices
from ...skin.pad_chart import PadChart
from ...skin.row_table import RowTable
from .point_set import PointSet


class PointReach:
    """Tells of all coarsest cells of a pad.

    Args:
        points: present points of the pad.

    Attributes:
        places: the centres of those cells at rest [m], shape (p, 3).
        sizes: how far the skin of each is from its centre, at most [m], shape (p,).
    """

    def __init__(self, points: PointSet) -> None:
        self._points, self._chart, roots = points, points.pad.chart, points.pad.chart.beside
        self.places: Array = points.pad.cells.positions[self._chart.base]
        corners, _ = self._chart.corners(self._chart.base, 0.5)
        self.sizes: Array = np.linalg.norm(corners - self.places[:, None], axis=2).max(axis=1)
        odd = np.append(self._chart.base % 2 == 1, False)
        odd[:-1] &= ~odd[roots[:, 1, [0, 2]]].any(axis=1)  # told by those beside it around the finger
        self._told = np.flatnonzero(~odd[:-1])
        self._about: Indices = np.ascontiguousarray(roots.reshape(len(roots), -1).T)
        self._blocks, self._members = _blocks(self._chart)
        self._rows = RowTable(len(self._members), self._made)

    def moved(self, force: Array, image: Array) -> Array:
        """Return how far skin has moved in each cell, at most [m], shape (p,).

        Args:
            force: on the points [N], shape (n, 3). image: their displacement [m], shape (n, 3).
        """
        roots, loaded = self._chart.tiles.root[self._points.cells], np.flatnonzero(force.any(axis=1))
        under, which = np.unique(self._blocks[roots[loaded]], return_inverse=True)
        on: Array = np.stack([np.bincount(which, force[loaded, k], len(under)) for k in range(3)], axis=1)
        far = self._points.pad.displaced(self._rows[under], on)
        most = np.zeros(len(self.places) + 1)
        most[self._told] = np.sqrt(np.einsum("ij,ij->i", far, far))
        np.maximum.at(most, roots, np.sqrt(np.einsum("ij,ij->i", image, image)))
        return np.asarray(most.take(self._about).max(axis=0))

    def _made(self, blocks: Indices) -> Floats32:
        """Return the displacement, at the cells that are told of, by force spread over each of some blocks."""
        coarse = self._points.pad.coarse
        means = [coarse[self._members[block]][:, :, self._told].mean(axis=0) for block in blocks.tolist()]
        return np.asarray(np.stack(means))


def _blocks(chart: PadChart) -> tuple[Indices, list[Indices]]:
    """Return the block that each coarsest cell is in, and the cells of each block: two along and two around."""
    half = chart.halves[chart.base]
    corner = np.floor((chart.places[chart.base] - [chart.shape.reach, 0.0]) / (4.0 * half) + 1e-9)
    size = np.round(np.log2(half.max(axis=0) / half))
    _, block, count = np.unique(np.hstack([corner, size]), axis=0, return_inverse=True, return_counts=True)
    block = block.reshape(-1)
    return block, np.split(np.argsort(block, kind="stable"), np.cumsum(count)[:-1])

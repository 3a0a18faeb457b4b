"""NodalForces: forces on the smooth skin as forces on the nodes of a mesh, with the same sum and the same moment.

The smooth pad reaches up to 6 mm farther than the pad of a mesh. On linear skin a force out there keeps its moment,
with forces up to twice its size on three nodes, one against the other. Tissue that follows a law is hardened by those,
and its correction would come back to the smooth skin as often larger again: more than the whole compliance there (5
times on a draft mesh), and skin was held on a fold by the forces that pressed it there. So on such skin a force out
there acts at the rim of the mesh's pad, and skin there stiffens as the rim does: up to 4.5 mm above the pad's middle,
no mode of the correction is more than 1.5 times its compliance (1.2 on a standard mesh).
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..errors import DermisError
from ..recent import Recent
from .mesh import TetraMesh
from .pad_chart import PadChart
from .row_table import RowTable

NEAREST = 12  # triangles of the pad, by their centres, of which one is taken for a cell

Floats = NDArray[np.floating[Any]]
_ROW = np.dtype([("nodes", np.int64, 3), ("weights", np.float64, (3, 3, 3))])  # of each cell


class NodalForces:
    """Takes forces on cells of a smooth pad to the pad nodes of a mesh, and displacement of the nodes to the cells.

    A cell's force goes to the three nodes of the triangle that it lies over. It does not lie in the triangle's plane:
    forces on the same nodes that have no sum make up for the moment. Both ways are each other's transpose, so that
    work is the same on both sides.

    Args:
        mesh: of the same fingertip. chart: its smooth pad.
        follows_law: forces beyond the pad of the mesh act at its rim, and keep their sum alone.

    Raises:
        DermisError: the mesh has no triangle whose corners are all on the pad.
    """

    def __init__(self, mesh: TetraMesh, chart: PadChart, follows_law: bool = False) -> None:
        self.mesh, self.chart, self._follows_law = mesh, chart, follows_law
        place = np.full(len(mesh.nodes), -1)
        place[mesh.pad] = np.arange(len(mesh.pad))
        triangles = place[mesh.surface]
        self._triangles = triangles[(triangles >= 0).all(axis=1)]
        if not len(self._triangles):
            raise DermisError("no triangle of the skin is on the pad", where=f"skin mesh '{mesh.name}'")
        self._corners = mesh.nodes[mesh.pad][self._triangles]
        self._centres = self._corners.mean(axis=1)

    @classmethod
    def of(cls, mesh: TetraMesh, chart: PadChart, follows_law: bool = False) -> NodalForces:
        """Return the one of a mesh and a chart; it is kept, since fingers that are alike share it."""
        key = id(mesh), id(chart), follows_law  # it holds both, so no other has their ids
        return _made.make(key, lambda: cls(mesh, chart, follows_law))

    def spread(self, cells: Indices, force: Floats) -> Array:
        """Return the forces on the pad nodes [N], shape (m, 3), for forces on cells, shape (n, 3)."""
        nodes, weights = self._weights(cells)
        on = np.einsum("nkab,nb->nka", weights, np.asarray(force, np.float64)).reshape(-1, 3)
        count = len(self.mesh.pad)
        return np.stack([np.bincount(nodes.reshape(-1), on[:, k], count) for k in range(3)], axis=1)

    def gather(self, cells: Indices, displacement: Floats) -> Array:
        """Return the displacement of cells [m], shape (n, 3), for that of the pad nodes, shape (m, 3)."""
        nodes, weights = self._weights(cells)
        return np.einsum("nkab,nka->nb", weights, np.asarray(displacement, np.float64)[nodes])

    def _weights(self, cells: Indices) -> tuple[Indices, Array]:
        """Return the three nodes of each cell, shape (n, 3), and what of its force goes to each, (n, 3, 3, 3)."""
        found = self._table[np.asarray(cells)]
        return found["nodes"], found["weights"]

    def _locate(self, cells: Indices) -> NDArray[Any]:
        points = self.chart.cells.positions[cells]
        near = self._nearest(points)
        shares = _barycentric(self._corners[near], points[:, None])
        best = shares.min(axis=2).argmax(axis=1)
        rows = np.arange(len(points))
        beyond = shares[rows, best].min(axis=1) < 0.0
        share = np.maximum(shares[rows, best], 0.0)
        share /= share.sum(axis=1, keepdims=True)
        triangle = near[rows, best]
        corners = self._corners[triangle]
        arms = corners - corners.mean(axis=1, keepdims=True)
        off = points - np.einsum("nk,nka->na", share, corners)
        if self._follows_law:
            up = np.cross(arms[:, 1] - arms[:, 0], arms[:, 2] - arms[:, 0])
            up /= np.linalg.norm(up, axis=1, keepdims=True)
            off[beyond] = (np.einsum("na,na->n", off, up)[:, None] * up)[beyond]
        squares = np.einsum("nka,nka->n", arms, arms)[:, None, None] * np.eye(3)
        turn = np.linalg.solve(squares - np.einsum("nka,nkb->nab", arms, arms), _cross(off))
        found = np.empty(len(cells), dtype=_ROW)
        found["nodes"] = self._triangles[triangle]
        found["weights"] = share[:, :, None, None] * np.eye(3) - _cross(arms) @ turn[:, None]
        return found

    def _nearest(self, points: Array) -> Indices:
        """Return the triangles whose centres are nearest to points, the nearest first, shape (n, few).

        All are measured: a cell is asked for once, and a tree of so few costs a tenth of a second to be loaded.
        """
        apart = np.zeros((len(points), len(self._triangles)))
        for k in range(3):
            apart += (points[:, k, None] - self._centres[:, k]) ** 2
        if len(self._triangles) > NEAREST:
            some = np.argpartition(apart, NEAREST, axis=1)[:, :NEAREST]
            some.sort(axis=1)
        else:
            some = np.broadcast_to(np.arange(len(self._triangles)), apart.shape)
        order = np.argsort(np.take_along_axis(apart, some, axis=1), axis=1, kind="stable")
        return np.take_along_axis(some, order, axis=1)

    @cached_property
    def _table(self) -> RowTable:
        return RowTable(len(self.chart.places), self._locate)


def _barycentric(corners: Array, points: Array) -> Array:
    """Return barycentric coordinates of the feet of points on triangles' planes, shape (..., 3)."""
    a, b = corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]
    normal = np.cross(a, b)
    to = points - corners[..., 0, :]
    scale = (normal * normal).sum(axis=-1)
    second = (np.cross(to, b) * normal).sum(axis=-1) / scale
    third = (np.cross(a, to) * normal).sum(axis=-1) / scale
    return np.stack([1.0 - second - third, second, third], axis=-1)


def _cross(vectors: Array) -> Array:
    """Return the matrices that take w to v x w, shape (..., 3, 3)."""
    out = np.zeros((*vectors.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., k, j] = vectors[..., i]
        out[..., j, k] = -vectors[..., i]
    return out


_made: Recent[tuple[int, int, bool], NodalForces] = Recent(4)

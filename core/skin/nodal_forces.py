"""NodalForces: forces on the smooth skin as forces on mesh nodes.

The forces keep their sum. They keep their moment too, except on nonlinear skin beyond the pad of the mesh.

The smooth pad extends up to 6 mm beyond the pad of a mesh. On linear skin, a force in this region keeps its moment:
three nodes carry opposed forces of up to twice its size. Nonlinear tissue would stiffen under these opposed forces, and
the correction would be magnified again when displacements are mapped back to the smooth skin. With such forces, the
correction exceeded the whole compliance in this region (5 times on a draft mesh), and skin stayed folded under the
forces that pressed it. On nonlinear skin, a force in this region therefore acts at the rim of the mesh's pad, and the
skin of the region stiffens like the rim. Up to 4.5 mm above the middle of the pad, no mode of the correction then
exceeds 1.5 times the compliance (1.2 times on a standard mesh).
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

NEAREST = 12  # number of triangles with the nearest centres, among which the triangle of a cell is chosen

Floats = NDArray[np.floating[Any]]
_ROW = np.dtype([("nodes", np.int64, 3), ("weights", np.float64, (3, 3, 3))])  # record of a cell


class NodalForces:
    """Map between cells of a smooth pad and the pad nodes of a mesh.

    The force on a cell is distributed to the three nodes of the triangle below it. The cell is not in the plane of the
    triangle, so additional forces on the same nodes, whose sum is zero, supply the missing moment. Displacements are
    mapped from nodes to cells by the transpose, so that the work is the same on both sides.

    Args:
        mesh: mesh of the fingertip.
        chart: smooth pad of the same fingertip.
        follows_law: whether forces beyond the pad of the mesh act at its rim. They then keep their sum but not their
            moment.

    Raises:
        DermisError: no triangle of the mesh has all corners on the pad.
    """

    def __init__(self, mesh: TetraMesh, chart: PadChart, follows_law: bool = False) -> None:
        self.mesh, self.chart, self._follows_law = mesh, chart, follows_law
        place = np.full(len(mesh.nodes), -1)
        place[mesh.pad] = np.arange(len(mesh.pad))
        triangles = place[mesh.surface]
        self._triangles = triangles[(triangles >= 0).all(axis=1)]
        if not len(self._triangles):
            raise DermisError("no triangle of the skin is on the pad", where=f"skin mesh '{mesh.name}'")
        corners = mesh.nodes[mesh.pad][self._triangles]
        self._centres = corners.mean(axis=1)
        self._arms = corners - self._centres[:, None]
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        normals = np.cross(a, b)
        scale = np.einsum("na,na->n", normals, normals)[:, None]
        # gradients of the barycentric coordinates of points that are projected on the plane of a triangle [1/m]
        second, third = np.cross(b, normals) / scale, np.cross(normals, a) / scale
        self._slopes = np.stack([-second - third, second, third], axis=1)
        self._normals = normals / np.sqrt(scale)
        squares = np.einsum("nka,nka->n", self._arms, self._arms)[:, None, None] * np.eye(3)
        # matrices from a moment about the centre to forces on the corners whose sum is zero [1/m]
        inertia = squares - np.einsum("nka,nkb->nab", self._arms, self._arms)
        self._turns = _cross(self._arms) @ np.linalg.inv(inertia)[:, None]

    @classmethod
    def of(cls, mesh: TetraMesh, chart: PadChart, follows_law: bool = False) -> NodalForces:
        """Return the map for a mesh and a chart.

        It is kept in memory and shared by fingers of one shape.
        """
        # A kept map holds its mesh and its chart, so no other object gets their ids.
        key = id(mesh), id(chart), follows_law
        return _made.make(key, lambda: cls(mesh, chart, follows_law))

    def spread(self, cells: Indices, force: Floats) -> Array:
        """Return the forces on the pad nodes [N], shape (m, 3).

        Args:
            cells: indices of the cells that carry force, shape (n,).
            force: forces on these cells [N], shape (n, 3).
        """
        force = np.asarray(force, np.float64)
        carry = np.einsum("ij->i", np.abs(force)).nonzero()[0]  # most cells of a frame carry none, and need no place
        nodes, weights = self._weights(cells.take(carry))
        on = np.einsum("nkab,nb->nka", weights, force.take(carry, axis=0))
        places = 3 * nodes[:, :, None] + np.arange(3)
        summed = np.bincount(places.reshape(-1), on.reshape(-1), 3 * len(self.mesh.pad))
        return np.asarray(summed.reshape(-1, 3), np.float64)

    def gather(self, cells: Indices, displacement: Floats) -> Array:
        """Return the displacements of cells [m], shape (n, 3).

        Args:
            cells: indices of the cells, shape (n,).
            displacement: displacements of the pad nodes [m], shape (m, 3).
        """
        nodes, weights = self._weights(cells)
        return np.einsum("nkab,nka->nb", weights, np.asarray(displacement, np.float64)[nodes])

    def _weights(self, cells: Indices) -> tuple[Indices, Array]:
        """Return the nodes of cells, and matrices from forces on cells to nodes.

        Returns:
            Three pad nodes for each cell, shape (n, 3). For each of them, the matrix that maps the force on the cell to
            the force on the node, shape (n, 3, 3, 3).
        """
        found = self._table[np.asarray(cells)]
        return found["nodes"], found["weights"]

    def _locate(self, cells: Indices) -> NDArray[Any]:
        points = self.chart.cells.positions[cells]
        near = self._nearest(points)
        away = points[:, None] - self._centres[near]
        shares = np.einsum("nika,nia->nik", self._slopes[near], away) + 1.0 / 3.0
        best = shares.min(axis=2).argmax(axis=1)
        rows = np.arange(len(points))
        triangle, share = near[rows, best], np.maximum(shares[rows, best], 0.0)
        share /= share.sum(axis=1, keepdims=True)
        off = away[rows, best] - np.einsum("nk,nka->na", share, self._arms[triangle])
        if self._follows_law:
            beyond = shares[rows, best].min(axis=1) < 0.0
            up = self._normals[triangle]
            off[beyond] = (np.einsum("na,na->n", off, up)[:, None] * up)[beyond]
        found = np.empty(len(cells), dtype=_ROW)
        found["nodes"] = self._triangles[triangle]
        found["weights"] = share[:, :, None, None] * np.eye(3) - self._turns[triangle] @ _cross(off)[:, None]
        return found

    def _nearest(self, points: Array) -> Indices:
        """Return the triangles with the nearest centres, shape (n, `NEAREST`).

        If the pad has fewer triangles, all are returned. All distances are computed instead of searching a tree,
        because each cell is located only once, and the import of a search tree would take a tenth of a second.

        Args:
            points: positions of the cells [m], shape (n, 3).
        """
        if len(self._triangles) <= NEAREST:
            return np.tile(np.arange(len(self._triangles)), (len(points), 1))
        apart = np.zeros((len(points), len(self._triangles)))
        for k in range(3):
            apart += (points[:, k, None] - self._centres[:, k]) ** 2
        some = np.argpartition(apart, NEAREST, axis=1)[:, :NEAREST]
        some.sort(axis=1)
        return some

    @cached_property
    def _table(self) -> RowTable:
        return RowTable(len(self.chart.places), self._locate)


def _cross(vectors: Array) -> Array:
    """Return the matrices S with S w = v x w, shape (..., 3, 3).

    Args:
        vectors: the vectors v, shape (..., 3).
    """
    out = np.zeros((*vectors.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., k, j] = vectors[..., i]
        out[..., j, k] = -vectors[..., i]
    return out


_made: Recent[tuple[int, int, bool], NodalForces] = Recent(4)

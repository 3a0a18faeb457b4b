"""Quadratic tetrahedra, curved where the skin is: their nodes are corners and middles of edges. Lengths in mm.

Linear elements would have to be far smaller than the rounding of an edge, over which skin is stretched to many times
its width, and their surface cuts through what is between two nodes. Quadratic ones bend within themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.skin.mesh import TetraMesh
from core.skin.stress import locate

from .bisection import EDGES, NAIL, SmoothMesh, places

Array = NDArray[np.float64]
Index = NDArray[np.integer]
NEAR, FAR = 0.13819660112501052, 0.5854101966249685  # barycentric, of a rule that is exact to degree 2
RULE = np.full((4, 4), NEAR) + (FAR - NEAR) * np.eye(4)
NODES = np.concatenate([np.eye(4), 0.5 * (np.eye(4)[EDGES[:, 0]] + np.eye(4)[EDGES[:, 1]])])  # barycentric
NEWTON = 6  # steps to a place within a curved element


@dataclass(frozen=True, eq=False)
class QuadraticMesh:
    """Tetrahedra of ten nodes.

    Attributes:
        nodes: [mm], shape (n, 3). elements: four corners, then the middles of `EDGES`, shape (e, 10).
        held: which nodes do not move, shape (n,). pad: nodes of the skin that do, rising.
        middle: which nodes lie on the middle line of the skin, shape (n,).
    """

    nodes: Array
    elements: NDArray[np.int64]
    held: NDArray[np.bool_]
    pad: NDArray[np.int64]
    middle: NDArray[np.bool_]

    def __repr__(self) -> str:
        return f"{len(self.nodes)} nodes, {len(self.elements)} quadratic tetrahedra"

    def slopes(self, elements: Array, at: Array) -> tuple[Array, Array]:
        """Return gradients of the shape functions [1/mm], shape (e, q, 10, 3), and Jacobians [mm^3], shape (e, q).

        Args:
            elements: of the mesh, shape (e, 10). at: barycentric coordinates, shape (e or 1, q, 4).
        """
        along = shape_slopes(at)
        jacobian = np.swapaxes(along, -1, -2) @ self.nodes[elements][:, None]  # d x / d along, rows: along
        return along @ np.swapaxes(np.linalg.inv(jacobian), -1, -2), np.linalg.det(jacobian)

    def locate(self, points: Array) -> tuple[NDArray[np.int64], Array]:
        """Return the element that holds each point [mm] and its barycentric coordinates there, shape (p, 4).

        Raises:
            ValueError: a point is in none.
        """
        none = np.zeros(0, np.int32)
        corners = TetraMesh(self.nodes, self.elements[:, :4].astype(np.int32), none, none, none.reshape(0, 3))
        element, at = locate(corners, points)
        if (element < 0).any():
            raise ValueError("a point lies outside the tissue")
        own = self.elements[element]
        for _ in range(NEWTON):
            off = points - np.einsum("pa,pax->px", shape_values(at), self.nodes[own])
            jacobian = np.swapaxes(shape_slopes(at), -1, -2) @ self.nodes[own]
            step = np.linalg.solve(np.swapaxes(jacobian, -1, -2), off[..., None])[..., 0]
            at = at + np.concatenate([-step.sum(axis=1, keepdims=True), step], axis=1)
        return element, at


def shape_values(at: Array) -> Array:
    """Return the ten shape functions at barycentric coordinates, shape (..., 4) to (..., 10)."""
    ends = at[..., EDGES]
    return np.concatenate([at * (2.0 * at - 1.0), 4.0 * ends[..., 0] * ends[..., 1]], axis=-1)


def shape_slopes(at: Array) -> Array:
    """Return their slopes along the last three barycentric coordinates, shape (..., 4) to (..., 10, 3)."""
    out = np.zeros((*at.shape[:-1], 10, 4))
    corner, middle = np.arange(4), 4 + np.arange(6)
    out[..., corner, corner] = 4.0 * at - 1.0
    for own, other in (EDGES.T, EDGES.T[::-1]):
        out[..., middle, own] = 4.0 * at[..., other]
    return out[..., 1:] - out[..., :1]


def with_middles(tetrahedra: Index, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the ends of all edges, shape (m, 2), and elements whose middles are numbered from `count` on."""
    pairs = np.sort(tetrahedra[:, EDGES].astype(np.int64), axis=2)
    keys, number = np.unique(pairs[..., 0] * count + pairs[..., 1], return_inverse=True)
    elements = np.concatenate([tetrahedra, count + number.reshape(-1, 6)], axis=1)
    return np.stack(np.divmod(keys, count), axis=1), elements


def bent(mesh: SmoothMesh) -> QuadraticMesh:
    """Return quadratic tetrahedra whose skin and bone are those of the finger, but where that would fold one."""
    count = len(mesh.nodes)
    ends, elements = with_middles(mesh.tetrahedra, count)
    a, b = ends.T
    middle = 0.5 * (mesh.nodes[a] + mesh.nodes[b])
    share, chart = 0.5 * (mesh.share[a] + mesh.share[b]), 0.5 * (mesh.chart[a] + mesh.chart[b])
    smooth = middle.copy()
    for surface in (0.0, 1.0):
        there = (share == surface) & (middle[:, 2] < NAIL)
        smooth[there] = places(mesh.shape, chart[there], surface)
    nodes = np.concatenate([mesh.nodes, smooth])
    share = np.concatenate([mesh.share, share])
    skin = share == 1.0
    held = (share == 0.0) | (skin & mesh.shape.under_nail(nodes * 1e-3))
    line = np.concatenate([mesh.middle, mesh.middle[a] & mesh.middle[b]])
    found = QuadraticMesh(nodes, elements, held, np.flatnonzero(skin & ~held), line)
    while True:
        folded = (found.slopes(elements, np.concatenate([RULE, NODES])[None])[1] <= 0.0).any(axis=1)
        straight = np.setdiff1d(elements[folded, 4:], np.flatnonzero((nodes[count:] == middle).all(axis=1)) + count)
        if not len(straight):
            return found
        nodes[straight] = middle[straight - count]

"""Planes and pieces of a triangle surface.

A plane is a set of connected triangles that lie in one plane; its rim is its outline. A piece is a part of the surface
that bends gently from triangle to triangle; creases are between pieces.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import Array, Indices
from .topology import Topology
from .triangles import TriangleTable

# [m] Smallest radius of a gentle bend.
# [m] Largest distance between the middles of two neighbours that is used; larger distances count as this one.
RADIUS, LARGE = 5e-3, 1e-3
# Triangles lie in one plane if 1 minus the cosine between their normals is below this.
LEVEL = 1e-9
# Largest number of edges of a rim. Of a plane with more, each triangle counts as a plane of its own, since distances
# to so many edges would take too long.
MOST = 128


def pieces(table: TriangleTable, topology: Topology) -> Indices:
    """Return the index of each triangle's piece, shape (T,)."""
    ab, ac = table.rows[3:6].T, table.rows[6:9].T
    lengths = np.sqrt(np.maximum(table.rows[[9, 11, 10]].T, 1e-300))
    heights = np.sqrt((np.cross(ab, ac) ** 2).sum(axis=1))[:, None] / lengths  # above each edge
    back = topology.across[topology.across]  # the neighbours of the neighbour at each edge
    own = (back == np.arange(len(ab))[:, None, None]).argmax(axis=2)
    apart = (heights + heights[topology.across, own]) / 3.0  # distance between the middles, across the edge
    return joined(table, topology, np.cos(np.minimum(apart, LARGE) / RADIUS))


def joined(table: TriangleTable, topology: Topology, smallest: Array | float) -> Indices:
    """Join triangles across edges; return each triangle's group, shape (T,).

    Args:
        table: the triangles.
        topology: adjacency of the triangles.
        smallest: neighbours are joined if the cosine between their normals is above this; one value for all edges, or
            one for each triangle and edge, shape (T, 3).
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    normals, across = table.bounds[3:6].T, topology.across
    together = (across >= 0) & (np.einsum("tk,tek->te", normals, normals[across]) > smallest)
    triangle, edge = together.nonzero()
    pairs, count = (triangle, across[triangle, edge]), len(across)
    graph = coo_matrix((np.ones(len(triangle), bool), pairs), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


class Planes(NamedTuple):
    """The planes of a surface.

    Attributes:
        plane: index of the plane of each triangle, shape (T,).
        first: index of the first edge of each plane's rim in `start`, and finally E, shape (P + 1,).
        start, way: first point and vector of each edge of a rim [m], shape (E, 3), ordered by plane.
    """

    plane: Indices
    first: Indices
    start: Array
    way: Array

    @classmethod
    def of(cls, table: TriangleTable, topology: Topology) -> Planes:
        """Return the planes of a surface."""
        normals, across = table.bounds[3:6].T, topology.across
        plane = joined(table, topology, 1.0 - LEVEL)
        one = np.unique(plane, return_index=True)[1][plane]  # a triangle of the same plane
        bent = plane[~(np.einsum("tk,tk->t", normals, normals[one]) > 1.0 - LEVEL)]  # level from step to step only
        long = np.flatnonzero(np.bincount(plane[_rims(plane, across)[0]]) > MOST)
        alone = np.flatnonzero(np.isin(plane, np.concatenate([bent, long])))
        plane[alone] = plane.max() + 1 + np.arange(len(alone))
        plane = np.unique(plane, return_inverse=True)[1].reshape(-1)
        triangle, edge = _rims(plane, across)
        order = np.argsort(plane[triangle], kind="stable")
        triangle, edge = triangle[order], edge[order]
        a, ab, ac = (table.rows[i : i + 3].T[triangle] for i in (0, 3, 6))
        start = np.choose(edge[:, None], [a, a + ab, a + ac])
        way = np.choose(edge[:, None], [ab, ac - ab, -ac])
        return cls(plane, np.searchsorted(plane[triangle], np.arange(plane.max() + 2)), start, way)

    def rim(self, triangle: Indices, points: Array) -> Array:
        """Return the distances of points from the rims of their planes [m], (n,).

        It is inf for a plane without a rim.

        Args:
            triangle: index of the triangle on which each point lies, shape (n,).
            points: the points [m], shape (n, 3).
        """
        plane = self.plane[triangle]
        counts = self.first[plane + 1] - self.first[plane]
        ends = np.cumsum(counts)
        owner = np.repeat(np.arange(len(points)), counts)
        edges = np.arange(len(owner)) + np.repeat(self.first[plane] - (ends - counts), counts)
        way, to = self.way[edges], points[owner] - self.start[edges]
        along = np.einsum("ek,ek->e", to, way) / np.maximum(np.einsum("ek,ek->e", way, way), 1e-300)
        to -= np.clip(along, 0.0, 1.0)[:, None] * way
        apart = np.full(len(points), np.inf)
        np.minimum.at(apart, owner, np.einsum("ek,ek->e", to, to))
        return np.sqrt(apart)


def _rims(plane: Indices, across: Indices) -> tuple[Indices, Indices]:
    """Return the edges on rims: triangle, and index in it, shape (k,) each."""
    triangle, edge = ((across < 0) | (plane[across] != plane[:, None])).nonzero()
    return triangle, edge

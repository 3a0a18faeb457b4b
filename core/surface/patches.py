"""Patches: curved surface over a triangle mesh and its corners' normals.

There is a cubic Bezier triangle over each triangle. It goes through the triangle's corners and is perpendicular to
their normals. The shape of an edge depends only on the positions and normals of its two ends, so neighbours meet
without a gap. An edge is sharp where the normals of its two sides differ. Its tangents then lie in the tangent planes
of both sides, so the rim of a cylinder becomes round and stays sharp.

Source: Vlachos, Peters, Boyd, Mitchell 2001, Curved PN triangles; edges bend as circular arcs do instead of by a third
of the chord, which is wrong by 3/8 R phi^4 over an arc of 2 phi
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from .topology import IRREGULAR, Topology

# Two normals whose cosine is above this belong to one smooth surface. It is the cosine of 2 degrees, the accuracy of
# normals in modelling programs.
ALIKE = 0.9994
# Least cosine between a bent edge's tangent and its chord, that of 33.5 degrees. Steeper edges stay straight. The edges
# of an icosahedron (31.7 degrees) bend to a ball; those of a cube that is shaded smooth (35.3 degrees) stay straight.
STEEPEST = 0.8339
FOLDS = 8  # largest number of rounds in which the edges of patches that would fold are made straight
# Corners of the 16 small triangles on which a patch is tested for folds, in quarters along two edges.
_GRID = np.array([(i, j) for i in range(5) for j in range(5 - i)])
_SMALL = np.array(
    [[(i, j), (i + 1, j), (i, j + 1)] for i in range(4) for j in range(4 - i)]
    + [[(i + 1, j), (i + 1, j + 1), (i, j + 1)] for i in range(3) for j in range(3 - i)]
)


class Patches:
    """Bezier triangles over the triangles of a mesh, whose vertices may move.

    Args:
        vertices: vertices of the mesh in its first shape [m], shape (V, 3).
        normals: unit normals at each triangle's corners, shape (T, 3, 3).
        triangles: indices of vertices, shape (T, 3).

    Attributes:
        triangles: the triangles, as given.
        topology: adjacency of the triangles.
        straight: whether each edge is straight in all shapes, shape (T, 3).
    """

    def __init__(self, vertices: Array, normals: Array, triangles: NDArray[np.int32]) -> None:
        self.triangles = triangles
        self.topology = Topology.build(vertices, triangles)
        self._twin = _twins(self.topology)
        own = np.arange(self._twin.size).reshape(-1, 3)
        alone = self._twin == own
        following = own[:, [1, 2, 0]]
        # The corner of the other side at an edge's start, and that at its end.
        self._start = np.where(alone, own, following.reshape(-1)[self._twin])
        self._end = np.where(alone, following, self._twin)
        self.straight = self.topology.edge_kind == IRREGULAR
        for _ in range(FOLDS):
            folded = _folds(self.net(vertices, normals))
            new = (folded[:, None] | folded[self._twin // 3]) & ~self.straight
            if not new.any():
                break
            self.straight |= new

    def net(self, vertices: Array, normals: Array) -> Array:
        """Return the control points of all patches [m], shape (T, 10, 3).

        They are the three corners, then two on each edge, then one in the middle.

        Args:
            vertices: vertices of the mesh in any shape [m], shape (V, 3).
            normals: unit normals at each triangle's corners, shape (T, 3, 3).
        """
        start = vertices[self.triangles]
        end = start[:, [1, 2, 0]]
        chord = end - start
        each = normals.reshape(-1, 3)
        first = start + _handle(chord, normals, each[self._start], self.straight)
        second = end + _handle(-chord, normals[:, [1, 2, 0]], each[self._end], self.straight)
        edges = np.stack([first, second], axis=2).reshape(-1, 6, 3)
        # The middle point is exact if the surface is quadratic.
        middle = 1.5 * edges.mean(axis=1) - 0.5 * start.mean(axis=1)
        return np.concatenate([start, edges, middle[:, None]], axis=1)


def bends(net: Array) -> Array:
    """Return the bend of each patch [m], shape (T,).

    It is the largest distance between a control point of an edge and its place on the straight edge.
    """
    corners, edges = net[:, :3], net[:, 3:9].reshape(-1, 3, 2, 3)
    ends = np.stack([corners, corners[:, [1, 2, 0]]], axis=2)
    flat = (2.0 * ends + ends[:, :, ::-1]) / 3.0
    return np.asarray(np.linalg.norm(edges - flat, axis=3).max(axis=(1, 2)))


def weights(places: Array) -> Array:
    """Return the weights of control points at places on a patch, (n, 10).

    Args:
        places: barycentric coordinates on the patch, shape (n, 3).
    """
    u, v, w = places.T
    corners = [u**3, v**3, w**3]
    edges = [3 * a * a * b for pair in ((u, v), (v, w), (w, u)) for a, b in (pair, pair[::-1])]
    return np.stack([*corners, *edges, 6 * u * v * w], axis=1)


def _handle(chord: Array, own: Array, other: Array, straight: NDArray[np.bool_]) -> Array:
    """Return the vector from an edge's end to the next control point [m].

    Its shape, and that of all vectors here, is (T, 3, 3): one for each triangle and edge.

    Args:
        chord: vector to the edge's other end [m].
        own, other: unit normals of the edge's two sides at this end.
        straight: whether an edge is straight in all shapes, shape (T, 3).
    """
    length = np.linalg.norm(chord, axis=2)
    along = chord / np.maximum(length, 1e-300)[..., None]
    smooth = np.einsum("tki,tki->tk", own, other) > ALIKE
    mean = _unit(own + other)
    on_plane = along - np.einsum("tki,tki->tk", along, mean)[..., None] * mean
    crease = np.cross(own, other)
    crease *= np.sign(np.einsum("tki,tki->tk", crease, along))[..., None]
    tangent = _unit(np.where(smooth[..., None], on_plane, crease))
    cosine = np.einsum("tki,tki->tk", tangent, along)
    plain = straight | ~(cosine >= STEEPEST)
    reach = np.where(plain, 1.0, 2.0 / (1.0 + cosine)) * length / 3.0  # that of a circular arc, to the fifth order
    return np.asarray(np.where(plain[..., None], along, tangent) * reach[..., None])


def _twins(topology: Topology) -> NDArray[np.int64]:
    """Return the index of each edge in the triangle across, shape (T, 3).

    Edge k of triangle t has the index 3 t + k. An edge without another triangle has its own index.
    """
    corners, across = topology.corners, topology.across
    own = np.arange(corners.size).reshape(-1, 3)
    end = corners[:, [1, 2, 0]]
    match = corners[across] == end[..., None]  # the other triangle has the edge in the other direction
    match &= corners[across][..., [1, 2, 0]] == corners[..., None]
    twin = 3 * across + match.argmax(axis=2)
    return np.where((across >= 0) & match.any(axis=2), twin, own)


def _folds(net: Array) -> NDArray[np.bool_]:
    """Return which patches fold over somewhere, shape (T,)."""
    sides = net[:, [1, 2, 0]] - net[:, :3]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    # Control points are a third of the triangle's height apart. If they move by at most 1/16 of it, they keep their
    # order, and the patch needs no test.
    out = bends(net) * np.linalg.norm(sides, axis=2).max(axis=1) > area / 16.0
    out[out] = _turn_over(net[out])
    return np.asarray(out)


def _turn_over(net: Array) -> NDArray[np.bool_]:
    number = {tuple(g): i for i, g in enumerate(_GRID.tolist())}
    small = np.array([[number[tuple(c)] for c in t] for t in _SMALL.tolist()])
    places = np.column_stack([_GRID, 4 - _GRID.sum(axis=1)])[:, [2, 0, 1]] / 4.0
    points = np.einsum("pc,tci->tpi", weights(places), net)
    a, b, c = (points[:, small[:, k]] for k in range(3))
    flat = np.cross(net[:, 1] - net[:, 0], net[:, 2] - net[:, 0])
    return np.asarray((np.einsum("tsi,ti->ts", np.cross(b - a, c - a), flat) <= 0.0).any(axis=1))


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1), 1e-300)[..., None]

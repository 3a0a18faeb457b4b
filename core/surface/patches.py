"""Patches: the curved surface that a triangle mesh and its corners' normals stand for.

A cubic Bezier triangle stands over each triangle, through its corners and square to their normals. Its edges depend on
nothing but the two ends' places and normals, so neighbours meet without a gap. Along a sharp edge, where the normals of
its two sides differ, the edge runs in both sides' tangent planes: a cylinder's rim becomes round and stays sharp.

Source: Vlachos, Peters, Boyd, Mitchell 2001, Curved PN triangles; edges bend as circular arcs do instead of by a third
of the chord, which is wrong by 3/8 R phi^4 over an arc of 2 phi
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from .topology import IRREGULAR, Topology

ALIKE = 0.9994  # cosine of 2 degrees: normals of one smooth surface, as accurately as modelling programs keep them
# Cosine between an edge and its tangent below which it stays straight: 33.5 degrees. An icosahedron's edges (31.7) bend
# to a ball; a cube that shades smooth (35.3) is a cube.
STEEPEST = 0.8339
FOLDS = 8  # rounds in which edges of patches that would fold are made straight
# Corners of the 16 small triangles on which folds are looked for, in quarters along two edges.
_GRID = np.array([(i, j) for i in range(5) for j in range(5 - i)])
_SMALL = np.array(
    [[(i, j), (i + 1, j), (i, j + 1)] for i in range(4) for j in range(4 - i)]
    + [[(i + 1, j), (i + 1, j + 1), (i, j + 1)] for i in range(3) for j in range(3 - i)]
)


class Patches:
    """Bezier triangles over the triangles of one topology, whatever its shape.

    Args:
        vertices: [m], shape (V, 3). normals: unit, of each triangle's corners, shape (T, 3, 3).
        triangles: shape (T, 3).

    Attributes:
        triangles: as given. topology: how they hang together. straight: edges that stay so, shape (T, 3).
    """

    def __init__(self, vertices: Array, normals: Array, triangles: NDArray[np.int32]) -> None:
        self.triangles = triangles
        self.topology = Topology.build(vertices, triangles)
        self._twin = _twins(self.topology)
        own = np.arange(self._twin.size).reshape(-1, 3)
        alone = self._twin == own
        following = own[:, [1, 2, 0]]
        # which corner of the other side lies at an edge's start, and which at its end
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
        """Return control points: three corners, two on each edge, one amid [m], shape (T, 10, 3).

        Args:
            vertices: the same ones as at first, anywhere. normals: as at first.
        """
        start = vertices[self.triangles]
        end = start[:, [1, 2, 0]]
        chord = end - start
        each = normals.reshape(-1, 3)
        first = start + _handle(chord, normals, each[self._start], self.straight)
        second = end + _handle(-chord, normals[:, [1, 2, 0]], each[self._end], self.straight)
        edges = np.stack([first, second], axis=2).reshape(-1, 6, 3)
        # exact where the surface is quadratic
        middle = 1.5 * edges.mean(axis=1) - 0.5 * start.mean(axis=1)
        return np.concatenate([start, edges, middle[:, None]], axis=1)


def bends(net: Array) -> Array:
    """Return how far the edges' control points lie from the flat triangle's edges [m], shape (T,)."""
    corners, edges = net[:, :3], net[:, 3:9].reshape(-1, 3, 2, 3)
    ends = np.stack([corners, corners[:, [1, 2, 0]]], axis=2)
    flat = (2.0 * ends + ends[:, :, ::-1]) / 3.0
    return np.asarray(np.linalg.norm(edges - flat, axis=3).max(axis=(1, 2)))


def weights(places: Array) -> Array:
    """Return the weight of each control point at places on a patch, shape (n, 10).

    Args:
        places: barycentric, shape (n, 3).
    """
    u, v, w = places.T
    corners = [u**3, v**3, w**3]
    edges = [3 * a * a * b for pair in ((u, v), (v, w), (w, u)) for a, b in (pair, pair[::-1])]
    return np.stack([*corners, *edges, 6 * u * v * w], axis=1)


def _handle(chord: Array, own: Array, other: Array, straight: NDArray[np.bool_]) -> Array:
    """Return the way from an edge's end to the control point next to it, shape (T, 3, 3).

    Args:
        chord: to the edge's other end. own, other: normals of its two sides at this end. straight: shape (T, 3).
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
    reach = np.where(plain, 1.0, 2.0 / (1.0 + cosine)) * length / 3.0  # of an arc, to the fifth order
    return np.asarray(np.where(plain[..., None], along, tangent) * reach[..., None])


def _twins(topology: Topology) -> NDArray[np.int64]:
    """Return for each edge, 3 t + k, the same one of the triangle across; itself where there is none, shape (T, 3)."""
    corners, across = topology.corners, topology.across
    own = np.arange(corners.size).reshape(-1, 3)
    end = corners[:, [1, 2, 0]]
    match = corners[across] == end[..., None]  # the other side begins where this one ends
    match &= corners[across][..., [1, 2, 0]] == corners[..., None]
    twin = 3 * across + match.argmax(axis=2)
    return np.where((across >= 0) & match.any(axis=2), twin, own)


def _folds(net: Array) -> NDArray[np.bool_]:
    """Return which patches turn over somewhere, shape (T,)."""
    sides = net[:, [1, 2, 0]] - net[:, :3]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    # control points lie a third of the triangle's height apart: those that move by much less keep their order
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

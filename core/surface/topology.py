"""Topology of a triangle surface: neighbours, boundaries, irregular edges.

It depends on the triangles, and on which vertices coincide, but not on the shape. For a deforming mesh it is computed
once.
"""

from __future__ import annotations

import weakref
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..components import components
from .triangles import TriangleTable

REGULAR, BOUNDARY, IRREGULAR = 0, 1, 2
# Largest distance between two results for one point, in rounding steps of single precision. Each is off by up to two.
STEPS = 4
# Coordinates of a fingertip [m]. Parts of a bead, too, were joined where such coordinates are rounded.
FINGERTIP = 20e-3


@dataclass(frozen=True, eq=False)
class Topology:
    """Neighbours and kinds of the edges and corners of a triangle surface.

    Edge k of a triangle runs from corner k to corner k + 1.

    Attributes:
        corners: vertex indices after coincident vertices were merged, shape (T, 3).
        merged: index of the vertex that replaces each vertex, shape (V,).
        across: index of the neighbouring triangle at each edge, -1 if there is not exactly one, shape (T, 3).
        edge_kind: REGULAR, BOUNDARY (one face only) or IRREGULAR (three or more faces, or two that disagree
            about the outside), shape (T, 3).
        vertex_kind: BOUNDARY if the vertex has a boundary edge; otherwise IRREGULAR if it has an irregular edge, or if
            sheets of faces meet in this point only; otherwise REGULAR, shape (V,).
        closed: whether every edge is used as often in one direction as in the other, so that inside and outside exist.
        boundary_edges, irregular_edges: numbers of such edges.
        ignored: whether each triangle is left out, shape (T,).
        doubled: whether it is left out because it lies on another triangle, shape (T,); None if there are none.
        weld: largest distance between vertices that were merged [m].
    """

    corners: NDArray[np.int64]
    merged: NDArray[np.int64]
    across: NDArray[np.int64]
    edge_kind: NDArray[np.int8]
    vertex_kind: NDArray[np.int8]
    closed: bool
    boundary_edges: int
    irregular_edges: int
    ignored: NDArray[np.bool_]
    doubled: NDArray[np.bool_] | None = None
    weld: float = 0.0

    @classmethod
    def build(cls, vertices: Array, triangles: NDArray[np.integer]) -> Topology:
        """Return the topology of triangles.

        Vertices that coincide are merged. Vertices on rims are merged even if they differ by rounding to single
        precision. Triangles that lie on others, and triangles without area on rims, are ignored.

        Args:
            vertices: vertices [m], shape (V, 3).
            triangles: indices of vertices, shape (T, 3).
        """
        found = cls._of(merge_coincident(vertices), triangles, np.zeros(len(triangles), dtype=np.bool_))
        if found.boundary_edges:
            welded, weld = _welded(vertices, found)
            if weld > 0.0:
                found = replace(cls._of(welded, triangles, found.ignored), weld=weld)
        across = found.across
        if found.irregular_edges or ((across[:, 0] == across[:, 1]) & (across[:, 0] >= 0)).any():
            doubled = _doubled(found.corners)
            if doubled.any():
                found = replace(cls._of(found.merged, triangles, doubled), weld=found.weld, doubled=doubled)
        flat = None
        while found.boundary_edges:
            flat = ~TriangleTable.build(vertices, triangles).usable if flat is None else flat
            loose = flat & (found.edge_kind == BOUNDARY).any(axis=1)
            if not loose.any():
                break
            again = cls._of(found.merged, triangles, found.ignored | loose)
            found = replace(again, weld=found.weld, doubled=found.doubled)
        return found

    @classmethod
    def _of(cls, merged: NDArray[np.int64], triangles: NDArray[np.integer], ignored: NDArray[np.bool_]) -> Topology:
        count, corners = len(merged), merged[triangles].astype(np.int64)
        ignored = ignored | (corners == np.roll(corners, -1, axis=1)).any(axis=1)  # both sides of an edge, or a point
        start = corners.copy()
        start[ignored] = start[ignored, :1]  # an ignored triangle becomes a point, which has no edges
        end = np.roll(start, -1, axis=1)
        low, high = np.minimum(start, end).ravel(), np.maximum(start, end).ravel()
        forward = (start < end).ravel()
        collapsed = low == high
        key = np.where(collapsed, -1, low * count + high)
        order = np.argsort(key, kind="stable")
        ordered = key[order]
        first = np.flatnonzero(np.diff(ordered, prepend=-2))
        size = np.diff(first, append=ordered.size)
        ups = np.add.reduceat(forward[order].astype(np.int64), first)
        real = ordered[first] >= 0
        pair = real & (size == 2) & (ups == 1)
        single = real & (size == 1)
        kind = np.where(pair | ~real, REGULAR, np.where(single, BOUNDARY, IRREGULAR)).astype(np.int8)
        across = np.full(corners.size, -1, dtype=np.int64)
        a, b = order[first[pair]], order[first[pair] + 1]
        across[a], across[b] = b // 3, a // 3
        edge_kind = np.empty(corners.size, dtype=np.int8)
        edge_kind[order] = np.repeat(kind, size)
        vertex_kind = np.zeros(count, dtype=np.int8)
        for wanted in (IRREGULAR, BOUNDARY):  # a boundary is set last and prevails: beyond it there is no inside
            edges = edge_kind == wanted
            vertex_kind[low[edges]] = wanted
            vertex_kind[high[edges]] = wanted
        _mark_pinched(start, across.reshape(-1, 3), vertex_kind)
        closed = bool(np.all(ups[real] * 2 == size[real])) and bool(real.any())
        return cls(
            corners,
            merged,
            across.reshape(-1, 3),
            edge_kind.reshape(-1, 3),
            vertex_kind,
            closed,
            int(single.sum()),
            int((real & ~pair & ~single).sum()),
            ignored,
        )

    @cached_property
    def irregular(self) -> bool:
        """Whether at some edge or vertex no normal determines the side."""
        return bool((self.edge_kind == IRREGULAR).any() or (self.vertex_kind == IRREGULAR).any())

    @cached_property
    def parts(self) -> NDArray[np.int64]:
        """Index of each triangle's part, connected across edges, shape (T,)."""
        triangle, edge = (self.across >= 0).nonzero()
        return components(len(self.across), triangle, self.across[triangle, edge])

    def fits(self, vertices: Array, triangles: NDArray[np.integer]) -> bool:
        """Return whether this topology holds for triangles in another shape.

        The triangles must be the same. Merged vertices must still coincide, and triangles that are ignored because
        they have no area must still have none.
        """
        if vertices.shape[0] != self.merged.shape[0] or not np.array_equal(self.merged[triangles], self.corners):
            return False
        apart = np.abs(vertices[self.merged] - vertices).max()
        if apart > (_rounding(vertices) if self.weld else 0.0):
            return False
        loose = self.ignored if self.doubled is None else self.ignored & ~self.doubled
        return not loose.any() or not TriangleTable.build(vertices, triangles[loose]).usable.any()


def merge_coincident(vertices: Array) -> NDArray[np.int64]:
    """Return the lowest index at exactly the place of each vertex, shape (V,)."""
    exact = np.ascontiguousarray(vertices + 0.0)  # -0.0 becomes 0.0
    order = np.lexsort(exact.T)
    ordered = exact[order]
    new = np.ones(order.size, dtype=bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    group = np.cumsum(new) - 1
    lowest = np.minimum.reduceat(order, np.flatnonzero(new)) if order.size else order
    merged = np.empty(order.size, dtype=np.int64)
    merged[order] = lowest[group]
    return merged


def _rounding(vertices: Array) -> float:
    """Return the length of `STEPS` rounding steps of single precision [m].

    A step is that of the largest coordinate, but at least that of a fingertip's.
    """
    return float(STEPS * np.finfo(np.float32).eps * max(np.abs(vertices).max(), FINGERTIP))


def _welded(vertices: Array, found: Topology) -> tuple[NDArray[np.int64], float]:
    """Merge vertices on rims that rounding may have separated.

    Vertices that `found` merged stay merged. Vertices that only a chain of others joins, over more than twice the
    rounding, stay apart.

    Returns:
        Index of the vertex that replaces each vertex, shape (V,), and the largest distance between the two [m].
    """
    from scipy.spatial import cKDTree

    rim = np.unique(found.corners[(found.edge_kind == BOUNDARY).any(axis=1)])
    near = _rounding(vertices)
    pairs = cKDTree(vertices[rim]).query_pairs(near, output_type="ndarray")
    if not len(pairs):
        return found.merged, 0.0
    group = components(len(vertices), *rim[pairs].T)[found.merged]
    # Groups of vertices that `found` replaced are empty, so the numbers of the others have gaps.
    _, first, place = np.unique(group, return_index=True, return_inverse=True)
    merged = first[place]
    far = np.linalg.norm(vertices[merged] - vertices, axis=1)
    # A chain of neighbours along a rim is no crack: far from the origin it would draw a whole rim into one corner.
    chained = np.zeros(len(first), dtype=np.bool_)
    chained[place[far > 2.0 * near]] = True
    merged = np.where(chained[place], found.merged, merged)
    return merged, float(np.linalg.norm(vertices[merged] - vertices, axis=1).max())


def _doubled(corners: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which triangles lie on others with the same corners, shape (T,).

    Of triangles with the same orientation, all but the first are marked. Of two with opposite orientations, both are
    marked, unless the part consists of such pairs only. It is then a sheet with two sides, and one side is kept.
    """
    count = len(corners)
    live = (corners != np.roll(corners, -1, axis=1)).all(axis=1)
    row, lowest = np.arange(count), corners.argmin(axis=1)
    even = corners[row, (lowest + 1) % 3] < corners[row, (lowest + 2) % 3]
    _, group = np.unique(np.sort(corners, axis=1), axis=0, return_inverse=True)
    group = group.reshape(-1)
    out = np.zeros(count, dtype=np.bool_)
    kept = []  # the first triangle of each group, for one orientation and for the other
    for way in (even, ~even):
        those = np.flatnonzero(way & live)
        names, first = np.unique(group[those], return_index=True)
        out[np.setdiff1d(those, those[first])] = True
        kept.append(dict(zip(names.tolist(), those[first].tolist(), strict=True)))
    both = sorted(kept[0].keys() & kept[1].keys())
    if not both:
        return out
    pairs = np.array([[kept[0][name], kept[1][name]] for name in both])
    part = components(count + int(corners.max()) + 1, np.repeat(row, 3), count + corners.ravel())[:count]
    alone = np.ones(part.max() + 1, dtype=np.bool_)
    single = live & ~out
    single[pairs] = False
    alone[part[single]] = False
    out[pairs.max(axis=1)] = True
    out[pairs[~alone[part[pairs[:, 0]]]]] = True
    return out


def _mark_pinched(corners: NDArray[np.int64], across: NDArray[np.int64], vertex_kind: NDArray[np.int8]) -> None:
    """Mark vertices in which sheets of faces meet at a point only.

    The faces around a regular vertex form a single fan. The sum of the face normals of several sheets does not
    determine the side of any of them.
    """
    live = (corners != np.roll(corners, -1, axis=1)).all(axis=1)
    where = np.where(np.repeat(live, 3), corners.ravel(), -1)  # vertex of each corner of a face, -1 without a face
    vertices, first, faces = np.unique(where, return_index=True, return_counts=True)
    some = vertices >= 0
    vertices, first, faces = vertices[some], first[some], faces[some]
    # A fan is walked from face to face, from the first corner of its vertex: on to its end, or round to where it began.
    size, closed = np.ones(len(first), dtype=np.int64), np.zeros(len(first), dtype=np.bool_)
    for side in (0, 2):  # across the edge after the corner, then across the one before it
        walk, at = np.flatnonzero(~closed), first[~closed]
        while walk.size:
            beyond = across[at // 3, (at + side) % 3]
            walk, beyond = walk[beyond >= 0], beyond[beyond >= 0]
            at = 3 * beyond + np.argmax(corners[beyond] == vertices[walk, None], axis=1)
            back = at == first[walk]
            closed[walk[back]] = True
            walk, at = walk[~back], at[~back]
            size[walk] += 1
    pinched = vertices[size < faces]
    vertex_kind[pinched[vertex_kind[pinched] == REGULAR]] = IRREGULAR


_CACHE: dict[int, tuple[weakref.ref[NDArray[np.integer]], Topology]] = {}


def topology_of(vertices: Array, triangles: NDArray[np.integer]) -> Topology:
    """Return the topology of triangles.

    It is kept as long as the array of triangles exists, and returned again while it fits, see `Topology.fits`.
    """
    key = id(triangles)
    entry = _CACHE.get(key)
    if entry is not None and entry[0]() is triangles and entry[1].fits(vertices, triangles):
        return entry[1]
    topology = Topology.build(vertices, triangles)
    if triangles.base is None:  # not for a view, which may be deleted while its memory is still in use
        _CACHE[key] = (weakref.ref(triangles, lambda _: _CACHE.pop(key, None)), topology)
    return topology


def cut_otherwise(one: NDArray[np.integer], other: NDArray[np.integer]) -> bool:
    """Return whether meshes have the same faces, cut along other diagonals.

    Vertices can then be followed from one mesh to the other. A diagonal is an edge that only one of the two meshes has.
    Triangles that share diagonals form a face. A face has the same outline in both meshes, and all its corners are on
    the outline.

    Args:
        one, other: vertex indices of the triangles, shape (T, 3). Those of a face are in the same rows in both.
    """
    if one.shape != other.shape:
        return False
    rows = (one != other).any(axis=1)
    a, b = _edges(one[rows]), _edges(other[rows])
    if not a.size or np.unique(a).size < a.size or np.unique(b).size < b.size:
        return False
    common, in_a, in_b = np.intersect1d(a, b, assume_unique=True, return_indices=True)
    faces = []
    for edges, outline in ((a, in_a), (b, in_b)):
        inner = np.ones(edges.size, dtype=np.bool_)
        inner[outline] = False
        face = _joined(edges, np.flatnonzero(inner))
        if face is None:
            return False
        faces.append(face[outline // 3])
    pairs = np.unique(np.stack(faces), axis=1).shape[1]
    return common.size > 0 and all(np.unique(face).size == pairs for face in faces)


def _edges(triangles: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return a number for each directed edge, shape (3 t,)."""
    start = triangles.astype(np.int64)
    return (start << 32 | np.roll(start, -1, axis=1)).ravel()


def _joined(edges: NDArray[np.int64], inner: NDArray[np.intp]) -> NDArray[np.int64] | None:
    """Return the face of each triangle if joined at inner edges.

    Args:
        edges: directed edges of the triangles, see `_edges`, shape (3 t,).
        inner: indices of the inner edges, shape (k,).

    Returns:
        Index of each triangle's face, shape (t,). None unless each inner edge joins two triangles, each face has
        several triangles, and no vertex lies within a face.
    """
    start, end = edges[inner] >> 32, edges[inner] & 0xFFFFFFFF
    there, back = np.argsort(edges[inner]), np.argsort(end << 32 | start)
    if not np.array_equal(edges[inner][there], (end << 32 | start)[back]):
        return None
    t = edges.size // 3
    face = components(t, inner[there] // 3, inner[back] // 3)
    # If the triangles of a face are joined as a tree, no vertex lies within the face.
    tree = inner.size == 2 * (t - 1 - face.max(initial=-1))
    return face if tree and np.bincount(face).min() > 1 else None

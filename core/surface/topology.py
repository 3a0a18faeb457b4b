"""How the triangles of a surface hang together: which parts are closed, open, or not a surface at all.

It depends on the triangles (and on which vertices coincide), not on the shape, so a deforming mesh pays for it once.
"""

from __future__ import annotations

import weakref
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from .triangles import TriangleTable

REGULAR, BOUNDARY, IRREGULAR = 0, 1, 2
# Single precision has a point that was computed twice, by two steps each time, so many steps apart.
STEPS = 4


@dataclass(frozen=True, eq=False)
class Topology:
    """Neighbours and kinds of the edges and corners of a triangle surface.

    Edge k of a triangle runs from corner k to corner k + 1.

    Attributes:
        corners: vertex indices after coincident vertices were merged, shape (T, 3).
        merged: for each vertex the one that stands for it, shape (V,).
        across: neighbouring triangle over each edge, -1 where there is not exactly one, shape (T, 3).
        edge_kind: REGULAR, BOUNDARY (one face only) or IRREGULAR (three or more faces, or two that disagree
            about the outside), shape (T, 3).
        vertex_kind: the worst kind among the edges at each vertex, BOUNDARY before IRREGULAR, shape (V,).
        closed: every edge is used as often in one direction as in the other, so inside and outside exist.
        boundary_edges, irregular_edges: how many there are.
        ignored: triangles that have no part in it, shape (T,). doubled: those of them that lie on others, shape (T,).
        weld: vertices that were merged lie so far apart at most [m].
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
        """Read the topology off triangles, shape (T, 3), merging vertices [m], shape (V, 3), that coincide.

        Vertices of rims are merged where single precision may have parted them. Triangles that lie on others, and
        those without area at rims, have no part in it.
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
        start = corners.copy()
        start[ignored] = start[ignored, :1]  # one point, which has no edges
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
        for wanted in (IRREGULAR, BOUNDARY):  # a boundary outweighs: beyond it lies nothing to be inside of
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
        """Whether there are edges or vertices at which no normal tells the side."""
        return bool((self.edge_kind == IRREGULAR).any() or (self.vertex_kind == IRREGULAR).any())

    @cached_property
    def parts(self) -> NDArray[np.int64]:
        """Which part that hangs together across edges each triangle belongs to, shape (T,)."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        triangle, edge = (self.across >= 0).nonzero()
        pairs, count = (triangle, self.across[triangle, edge]), len(self.across)
        graph = coo_array((np.ones(triangle.size, np.bool_), pairs), shape=(count, count))
        return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)

    def fits(self, vertices: Array, triangles: NDArray[np.integer]) -> bool:
        """Whether it was built of these triangles, and merges and ignores the same in this shape too."""
        if vertices.shape[0] != self.merged.shape[0] or not np.array_equal(self.merged[triangles], self.corners):
            return False
        apart = np.abs(vertices[self.merged] - vertices).max()
        if apart > (_rounding(vertices) if self.weld else 0.0):
            return False
        loose = self.ignored if self.doubled is None else self.ignored & ~self.doubled
        return not loose.any() or not TriangleTable.build(vertices, triangles[loose]).usable.any()


def merge_coincident(vertices: Array) -> NDArray[np.int64]:
    """Return for each vertex the lowest index among those at exactly the same place, shape (V,)."""
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
    """Return how far apart single precision may put one point that was computed twice [m]: four steps of it."""
    return float(STEPS * np.finfo(np.float32).eps * np.abs(vertices).max())


def _welded(vertices: Array, found: Topology) -> tuple[NDArray[np.int64], float]:
    """Return merged vertices, those of rims that rounding may have parted included, and how far apart they are [m]."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    rim = np.unique(found.corners[(found.edge_kind == BOUNDARY).any(axis=1)])
    pairs = cKDTree(vertices[rim]).query_pairs(_rounding(vertices), output_type="ndarray")
    if not len(pairs):
        return found.merged, 0.0
    graph = coo_array((np.ones(len(pairs), np.bool_), rim[pairs].T), shape=(len(vertices),) * 2)
    group = connected_components(graph, directed=False)[1][found.merged]
    merged = np.unique(group, return_index=True)[1][group]
    return merged, float(np.linalg.norm(vertices[merged] - vertices, axis=1).max())


def _doubled(corners: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which triangles lie on others of the same corners, shape (T,).

    Of those that look the same way, all but the first. Those that look opposite ways cancel out, unless the part has no
    others: it is a sheet with two sides, of which one is kept.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count = len(corners)
    live = (corners != np.roll(corners, -1, axis=1)).all(axis=1)
    row, lowest = np.arange(count), corners.argmin(axis=1)
    even = corners[row, (lowest + 1) % 3] < corners[row, (lowest + 2) % 3]
    _, group = np.unique(np.sort(corners, axis=1), axis=0, return_inverse=True)
    group = group.reshape(-1)
    out = np.zeros(count, dtype=np.bool_)
    kept = []  # the first of each group that looks one way, and of each that looks the other
    for way in (even, ~even):
        those = np.flatnonzero(way & live)
        names, first = np.unique(group[those], return_index=True)
        out[np.setdiff1d(those, those[first])] = True
        kept.append(dict(zip(names.tolist(), those[first].tolist(), strict=True)))
    both = sorted(kept[0].keys() & kept[1].keys())
    if not both:
        return out
    pairs = np.array([[kept[0][name], kept[1][name]] for name in both])
    ends = np.stack([np.repeat(row, 3), count + corners.ravel()])
    graph = coo_array((np.ones(3 * count, np.bool_), ends), shape=(count + corners.max() + 1,) * 2)
    part = connected_components(graph, directed=False)[1][:count]
    alone = np.ones(part.max() + 1, dtype=np.bool_)
    single = live & ~out
    single[pairs] = False
    alone[part[single]] = False
    out[pairs.max(axis=1)] = True
    out[pairs[~alone[part[pairs[:, 0]]]]] = True
    return out


def _mark_pinched(corners: NDArray[np.int64], across: NDArray[np.int64], vertex_kind: NDArray[np.int8]) -> None:
    """Mark vertices where two sheets of faces meet in a point: the faces around one must form a single fan.

    The sum of face normals over both sheets says nothing about either side.
    """
    live = (corners != np.roll(corners, -1, axis=1)).all(axis=1)
    # face corners are nodes of a graph, joined across edges; each regular vertex must be one component
    label = np.arange(corners.size)
    next_corner = np.arange(corners.size).reshape(-1, 3)
    links = []
    for k in range(3):
        t = np.flatnonzero((across[:, k] >= 0) & live)
        other = across[t, k]
        for corner in (k, (k + 1) % 3):
            vertex = corners[t, corner]
            at = np.argmax(corners[other] == vertex[:, None], axis=1)
            links.append((next_corner[t, corner], next_corner[other, at]))
    if not links:
        return
    a = np.concatenate([link[0] for link in links])
    b = np.concatenate([link[1] for link in links])
    while True:  # pointer jumping: each round at least halves the longest chain
        low = np.minimum(label[a], label[b])
        before = label.copy()
        np.minimum.at(label, a, low)
        np.minimum.at(label, b, low)
        label = label[label]
        if np.array_equal(label, before):
            break
    roots = (label == np.arange(corners.size)) & np.repeat(live, 3)
    fans = np.bincount(corners.ravel()[roots], minlength=vertex_kind.size)
    vertex_kind[(fans > 1) & (vertex_kind == REGULAR)] = IRREGULAR


_CACHE: dict[int, tuple[weakref.ref[NDArray[np.integer]], Topology]] = {}


def topology_of(vertices: Array, triangles: NDArray[np.integer]) -> Topology:
    """Return the topology of triangles, kept for as long as the same triangles array lives unchanged."""
    key = id(triangles)
    entry = _CACHE.get(key)
    if entry is not None and entry[0]() is triangles and entry[1].fits(vertices, triangles):
        return entry[1]
    topology = Topology.build(vertices, triangles)
    if triangles.base is None:  # a view may die while its memory is shared: not worth keeping
        _CACHE[key] = (weakref.ref(triangles, lambda _: _CACHE.pop(key, None)), topology)
    return topology


def cut_otherwise(one: NDArray[np.integer], other: NDArray[np.integer]) -> bool:
    """Return whether triangles are of the same faces, of which some are cut along other diagonals.

    Vertices can then be followed from one to the other. Triangles that share diagonals form a face; a diagonal
    is an edge of one of the two only. Faces have the same outline in both, and all their corners are on it.

    Args:
        one, other: vertices of triangles, those of a face in the same rows; shape (T, 3).
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
    """Return a number for each directed edge, three a triangle."""
    start = triangles.astype(np.int64)
    return (start << 32 | np.roll(start, -1, axis=1)).ravel()


def _joined(edges: NDArray[np.int64], inner: NDArray[np.intp]) -> NDArray[np.int32] | None:
    """Return the face of each triangle, shape (t,), where they are joined at inner edges.

    None unless each inner edge joins two, each face has several, and no vertex lies within one.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    start, end = edges[inner] >> 32, edges[inner] & 0xFFFFFFFF
    there, back = np.argsort(edges[inner]), np.argsort(end << 32 | start)
    if not np.array_equal(edges[inner][there], (end << 32 | start)[back]):
        return None
    t = edges.size // 3
    graph = coo_array((np.ones(inner.size), (inner[there] // 3, inner[back] // 3)), shape=(t, t))
    count, face = connected_components(graph, directed=False)
    # Triangles that are joined as a tree have no vertex within.
    tree = inner.size == 2 * (t - count)
    return face if tree and np.bincount(face).min() > 1 else None

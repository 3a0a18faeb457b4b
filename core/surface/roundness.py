"""Roundness of the parts of a triangle surface: the radius of the sharpest convex bend of each.

It is that of the shape, however its flat faces are cut into triangles.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..components import components
from .topology import BOUNDARY, Topology
from .triangles import TriangleTable, column_crosses, column_dots

# Two faces form an edge if their normals differ by more than this [rad]; below it they approximate a curved surface.
EDGE = 0.5
FLAT = 1e-4  # triangles whose normals differ by less are parts of one flat face [rad]
ROUNDING = 1e-15  # of a coordinate, over the largest: normals of triangles so thin that it turns them more are not used
# MOST: neighbours before and after a triangle beyond the same ones without area. With more, long rows take longer.
# ALONG: sine of the angle up to which an edge is along the line in which two planes meet. Sides of a triangle without
# area are parallel but for rounding.
MOST, ALONG = 8, 0.1
ONCE = 2_000_000  # distances that are computed at once


class Roundness(NamedTuple):
    """Roundness of the parts of a surface, which have no vertex in common.

    Attributes:
        radii: smallest radius of a convex bend of each part [m]: 0 with an edge or a rim, inf with none, shape (p,).
        part: index of each triangle's part, shape (T,).
    """

    radii: Array
    part: Indices


def roundness(table: TriangleTable, topology: Topology) -> Roundness:
    """Return the roundness of the parts of a surface.

    Args:
        table: triangles of the surface.
        topology: their neighbours.
    """
    usable, across, corners = table.usable, topology.across, topology.corners
    joined = components(len(topology.vertex_kind), corners[:, :2].ravel(), corners[:, 1:].ravel())
    part = np.unique(joined[corners[:, 0]], return_inverse=True)[1].reshape(-1)
    radii = np.full(int(part.max()) + 1, np.inf)
    radii[part[usable & (topology.edge_kind == BOUNDARY).any(axis=1)]] = 0.0
    areas = _twice_areas(table)
    middles = table.rows[:3] + (table.rows[3:6] + table.rows[6:9]) / 3.0
    pairs = _neighbours(table, topology)
    normals = np.ascontiguousarray(_normals(table, pairs, areas).T)
    kept = radii[part[pairs.triangle]] > 0.0
    kept[pairs.direct :] &= _meet(table, normals, pairs.some(slice(pairs.direct, None)))
    triangle, edge, other, back, _ = pairs.some(kept)
    own = normals[:, triangle]
    turn = np.arccos(np.clip(column_dots(own, normals[:, other]), -1.0, 1.0))
    below = column_dots(middles[:, other] - middles[:, triangle], own) < 0.0
    bent = turn > FLAT
    convex = bent & below
    radii[part[triangle[convex & (turn > EDGE)]]] = 0.0
    curved = radii[part[triangle]] > 0.0
    convex &= curved
    if not convex.any():
        return Roundness(radii, part)
    face = components(len(usable), triangle[~bent], other[~bent])  # index of each triangle's flat face
    bent &= curved
    here = np.full(across.shape, np.nan)
    sides = np.unique(3 * triangle[bent] + edge[bent])
    here.reshape(-1)[sides] = _widths(table, normals.T, areas, face, sides // 3, sides % 3)
    triangle, edge, other, back, turn = (column[convex] for column in (triangle, edge, other, back, turn))
    apart = (here[triangle, edge] + here[other, back]) / 3.0  # of the faces' middles, across the edge
    np.minimum.at(radii, part[triangle], apart / turn)
    return Roundness(radii, part)


class _Pairs(NamedTuple):
    """Pairs of triangles that have an area and may be neighbours; each pair comes twice, in both orders.

    Attributes:
        triangle, edge: a triangle and its edge, shape (n,) each.
        other, back: the other triangle and its edge, shape (n,) each.
        direct: number of pairs with a common edge, which come first. The others lie beyond triangles without area.
    """

    triangle: Indices
    edge: Indices
    other: Indices
    back: Indices
    direct: int

    def some(self, which: slice | NDArray[np.bool_]) -> _Pairs:
        """Return some of the pairs; `direct` is then not known, and 0."""
        return _Pairs(self.triangle[which], self.edge[which], self.other[which], self.back[which], 0)


def _neighbours(table: TriangleTable, topology: Topology) -> _Pairs:
    """Return pairs of triangles that have an area and may be neighbours.

    Triangles without area are passed: those that border on the same group of them may be neighbours, each with the
    `MOST` before it and after it along the group.
    """
    usable, across = table.usable, topology.across
    triangle, edge = ((across >= 0) & usable[:, None] & usable[across]).nonzero()
    other = across[triangle, edge]
    pairs = [(triangle, edge, other, (across[other] == triangle[:, None]).argmax(axis=1))]
    flat, side = ((across >= 0) & ~usable[:, None]).nonzero()
    beyond = across[flat, side]
    inner = ~usable[beyond]
    group = components(len(usable), flat[inner], beyond[inner])[flat[~inner]]
    flat, beyond = flat[~inner], beyond[~inner]
    at = (across[beyond] == flat[:, None]).argmax(axis=1)
    order = np.lexsort((_places(table, group, beyond, at), group))
    group, beyond, at = group[order], beyond[order], at[order]
    for apart in range(1, MOST + 1):
        one = (group[apart:] == group[:-apart]).nonzero()[0]
        if not len(one):
            break
        one = one[beyond[one] != beyond[one + apart]]
        one, two = np.append(one, one + apart), np.append(one + apart, one)
        pairs.append((beyond[one], at[one], beyond[two], at[two]))
    triangle, edge, others, back = (np.concatenate(column) for column in zip(*pairs, strict=True))
    return _Pairs(triangle, edge, others, back, len(other))


def _places(table: TriangleTable, group: Indices, triangle: Indices, edge: Indices) -> Array:
    """Return where edges are along the groups of triangles on which they border [m], shape (n,).

    Triangles without area lie along one line, nearly always. The place is along the axis in which a group is longest.
    """
    a, ab, ac = (table.rows[k : k + 3, triangle] for k in (0, 3, 6))
    middle = a + 0.5 * np.choose(edge, (ab, ab + ac, ac))
    size = []
    for column in middle:
        low, high = np.full(int(group.max(initial=0)) + 1, np.inf), np.full(int(group.max(initial=0)) + 1, -np.inf)
        np.minimum.at(low, group, column)
        np.maximum.at(high, group, column)
        size.append(high - low)
    return np.asarray(np.choose(np.argmax(size, axis=0)[group], middle))


def _meet(table: TriangleTable, normals: Array, pairs: _Pairs) -> NDArray[np.bool_]:
    """Return whether the planes of two triangles are the same, or meet along an edge of each, shape (n,)."""
    one, edge, other, back, _ = pairs
    a, b = table.rows[3:6], table.rows[6:9]
    sides = np.stack([a, b - a, -b])
    line = column_crosses(normals[:, one], normals[:, other])
    length = np.sqrt(column_dots(line, line))
    ways = [sides[side, :, triangle].T for triangle, side in ((one, edge), (other, back))]
    meet = column_dots(*ways) < 0.0  # each lies on its own side
    for way in ways:
        off = column_crosses(line, way)
        meet &= column_dots(off, off) <= (ALONG * length) ** 2 * column_dots(way, way)
    return meet | (length <= FLAT)


def _twice_areas(table: TriangleTable) -> Array:
    """Return twice the area of each triangle [m^2], shape (T,)."""
    a, b = table.rows[3:6], table.rows[6:9]
    normal = column_crosses(a, b)
    return np.sqrt(column_dots(normal, normal))


def _normals(table: TriangleTable, pairs: _Pairs, area: Array) -> Array:
    """Return unit normals, shape (T, 3): those of the thinnest triangles are taken from beyond their longest sides.

    Args:
        table: triangles of the surface.
        pairs: their neighbours.
        area: twice the area of each triangle [m^2], shape (T,).
    """
    normals, lengths = table.bounds[3:6].T, np.sqrt(np.maximum(table.rows[[9, 11, 10]].T, 0.0))
    size = float(np.abs(table.rows[:3]).max(initial=0.0))
    left = table.usable & (area * FLAT < ROUNDING * size * lengths.max(axis=1))
    if not left.any():
        return normals
    normals = normals.copy()
    triangle, edge, other, _, _ = pairs.some(left[pairs.triangle])
    order = np.lexsort((-lengths[triangle, edge], triangle))
    triangle, other = triangle[order], other[order]
    while len(found := (left[triangle] & ~left[other]).nonzero()[0]):
        found = found[np.unique(triangle[found], return_index=True)[1]]
        normals[triangle[found]] = normals[other[found]]
        left[triangle[found]] = False
    return normals


def _widths(
    table: TriangleTable, normals: Array, area: Array, face: Indices, triangle: Indices, edge: Indices
) -> Array:
    """Return how far flat faces reach from their edges [m], shape (n,).

    Args:
        table: triangles of the surface.
        normals: their unit normals, shape (T, 3). area: twice the area of each [m^2], shape (T,).
        face: index of each triangle's face, shape (T,).
        triangle, edge: all edges of the faces, each by a triangle and its edge, shape (n,).
    """
    a, ab, ac = (table.rows[k : k + 3].T for k in (0, 3, 6))
    widths: Array = area[triangle] / np.sqrt(np.maximum(table.rows[[9, 11, 10]].T[triangle, edge], 1e-300))
    more = (np.bincount(face)[face[triangle]] > 1).nonzero()[0]  # of faces that are not one triangle
    if not len(more):
        return widths
    triangle, edge = triangle[more], edge[more]
    corners = np.stack([a, a + ab, a + ac], axis=1)
    start, along = corners[triangle, edge], corners[triangle, (edge + 1) % 3] - corners[triangle, edge]
    inward = np.cross(normals[triangle], along)
    inward /= np.sqrt(np.maximum((inward**2).sum(axis=1), 1e-300))[:, None]
    rim = np.unique(triangle)  # a face's farthest corner is on its rim
    rim = rim[np.argsort(face[rim], kind="stable")]
    first, after = (np.searchsorted(face[rim], face[triangle], side) for side in ("left", "right"))
    many, out = after - first, np.empty(len(triangle))
    ends = np.cumsum(many)
    low = 0
    while low < len(out):
        high = max(low + 1, int(np.searchsorted(ends, (ends[low - 1] if low else 0) + ONCE, "right")))
        some = slice(low, high)
        begin = ends[some] - many[some] - (ends[low] - many[low])
        edges = np.repeat(np.arange(low, high), many[some])
        others = rim[np.arange(len(edges)) - np.repeat(begin - first[some], many[some])]
        reach = np.einsum("nci,ni->nc", corners[others] - start[edges][:, None], inward[edges]).max(axis=1)
        out[some] = np.maximum.reduceat(reach, begin)
        low = high
    widths[more] = out
    return widths

"""TriangleTree: triangles in groups of groups, each in a flat shape, so that a point meets few of them.

Skin presses on surfaces, and of a surface seen from close above the spheres and boxes of many parts come as near as
what is right below does. A disc in the plane of a part does not: its distance grows with the way along the surface.
A part is therefore bounded by a disc across its mean normal, as thick as the part is, and where it is much longer
than wide, moved along a line. A level of groups is one array operation for all points.

Bounds are in single precision about the middle of the surface, and give way by more than its rounding: which
triangles are left is never too few.
"""

from __future__ import annotations

import weakref

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from .topology import Topology
from .triangles import TriangleTable

Single = NDArray[np.float32]

# Triangles in a group, and halvings of a group into those of the next level, at most.
LEAF, HALVINGS = 10, 5
# What is so many times longer than wide is bounded by a disc that moves.
LONG = 3.0
# Rounding of squared distances and of places in single precision, as shares of them: more than all of it together.
ROUNDED_SQUARE, ROUNDED = np.float32(4e-6), 2e-6

_GROUPS: weakref.WeakKeyDictionary[Topology, Indices] = weakref.WeakKeyDictionary()


class TriangleTree:
    """The groups of one surface's usable triangles; there must be one at least.

    Args:
        table: the triangles.
        topology: groups are kept with it: another shape of the same triangles only measures them anew.

    Attributes:
        deep: there is more than one group.
    """

    def __init__(self, table: TriangleTable, topology: Topology) -> None:
        usable = np.flatnonzero(table.usable)
        groups = _GROUPS.get(topology)
        if groups is None or groups.max() + 1 != usable.size:
            groups = _GROUPS[topology] = _split(table.bounds[0:3].take(usable, axis=1))
        self._triangles = usable[groups].reshape(-1)
        rows, bounds = (part.take(self._triangles, axis=1) for part in (table.rows, table.bounds))
        self._middle = (bounds[0:3].min(axis=1) + bounds[0:3].max(axis=1))[:, None] / 2.0
        a = rows[0:3] - self._middle
        corners = np.stack([a, a + rows[3:6], a + rows[6:9]], axis=2)
        facing = bounds[3:6] / np.sqrt(rows[13])
        # of each group's members together; most triangles are in the disc about their centroid
        level = np.concatenate([bounds[0:6], np.zeros((1, len(facing[0]))), bounds[6:7], np.zeros((4, len(facing[0])))])
        level[0:3] -= self._middle
        long = (rows[9:12].max(axis=0) * np.sqrt(rows[13]) > LONG).nonzero()[0]
        if long.size:
            level[:, long] = _about(corners[:, long], facing[:, long, None])
        levels = [level.reshape(12, *groups.shape)]
        for fan in _fans(len(groups)):
            shape = 3, levels[-1].shape[1], -1
            levels.append(_about(corners.reshape(shape), facing.reshape(shape)).reshape(12, -1, fan))
        self._levels: list[Single] = [
            (level if level[11].any() else level[:8]).astype(np.float32) for level in reversed(levels)
        ]
        self._extent = float(np.abs(corners).max())
        self.deep = len(levels) > 1

    def places(self, points: Array) -> Single:
        """Return points [m], shape (n, 3), about the middle of the surface, shape (3, n)."""
        return np.ascontiguousarray(points.T - self._middle, dtype=np.float32)

    def some(self, x: Single) -> Indices:
        """Return a triangle near each of some `places`, mostly the closest or its neighbour, shape (n,)."""
        node = np.zeros(x.shape[1], dtype=np.int64)
        for level in self._levels:
            away = x[:, :, None] - _of(level, node, 0, 3)
            square = np.add.reduce(away * away)
            if len(level) > 8:
                _along(square, away, _of(level, node, 8, 12))
            node *= level.shape[2]
            node += square.argmin(axis=1)
        return self._triangles.take(node)

    def within(self, x: Single, limit: Array, most: int) -> tuple[Indices, Indices] | None:
        """Return all pairs (place, triangle) within each place's limit, and some beyond; places rise.

        Args:
            x: see `places`, shape (3, n). limit: [m], shape (n,).
            most: None is returned where more pairs would have to be looked at.
        """
        rounded = limit * (1.0 + ROUNDED) + ROUNDED * (self._extent + float(np.abs(x).max()))
        bound = np.square(rounded, dtype=np.float32)
        owner = row = np.arange(x.shape[1])
        node = np.zeros(x.shape[1], dtype=np.int64)
        for level in self._levels:
            fan = level.shape[2]
            if owner.size * fan > most:
                return None
            if level.shape[1] > 1:
                x, bound = x.take(row, axis=1), bound.take(row)
            near = (_square_below(x, _of(level, node, 0, 12)) <= bound[:, None]).reshape(-1).nonzero()[0]
            row = near // fan
            node = (node.take(row) - row) * fan + near
            owner = owner.take(row)
        return owner, self._triangles.take(node)


def _of(level: Single, node: Indices, first: int, last: int) -> Single:
    """Return some columns of the members of each node, shape (last - first, n, fan), or n = 1 for the same of all."""
    part = level[first:last]
    return part if level.shape[1] == 1 else part.take(node, axis=1)


def _square_below(x: Single, shapes: Single) -> Single:
    """Return lower bounds of squared distances to shapes [m^2], shape (n, fan).

    Args:
        x: shape (3, n). shapes: of each place, or the same for all, shape (8 or 12, n or 1, fan).
    """
    away = x[:, :, None] - shapes[:3]
    height = np.add.reduce(away * shapes[3:6])
    square = np.add.reduce(away * away)
    across = square - height * height
    if len(shapes) > 8:
        _along(across, away, shapes[8:])
    np.maximum(across, 0.0, out=across)
    np.sqrt(across, out=across)
    across -= shapes[7]
    np.maximum(across, 0.0, out=across)
    across *= across
    np.abs(height, out=height)
    height -= shapes[6]
    np.maximum(height, 0.0, out=height)
    height *= height
    across += height
    square *= ROUNDED_SQUARE
    across -= square
    return across


def _along(square: Single, away: Single, lines: Single) -> None:
    """Make squared distances to points, in place, those to lines through them: directions (3) and half lengths."""
    along = np.add.reduce(away * lines[:3])
    square -= along * along
    np.abs(along, out=along)
    along -= lines[3]
    np.maximum(along, 0.0, out=along)
    along *= along
    square += along


def _fans(count: int) -> list[int]:
    """Return how many groups make one of the next level, from the lowest to the highest: about as many at each."""
    halvings = count.bit_length() - 1
    levels = -(-halvings // HALVINGS)
    return [2 ** ((halvings + k) // levels) for k in range(levels)]


def _split(places: Array) -> Indices:
    """Return groups of neighbouring places, shape (groups, members): halves of halves along the longest side.

    Groups are as large as each other; where that does not come out even, some places are in one twice.

    Args:
        places: shape (3, n).
    """
    count = places.shape[1]
    halvings = max(int(np.ceil(np.log2(count / LEAF))), 0)
    size = -(-count // 2**halvings) * 2**halvings
    index = np.arange(size)[None] * count // size
    for _ in range(halvings):
        axis = np.ptp(places.take(index, axis=1), axis=2).argmax(axis=0)
        order = np.argpartition(places[axis[:, None], index], index.shape[1] // 2, axis=1)
        index = np.take_along_axis(index, order, axis=1).reshape(2 * len(index), -1)
    return index


def _about(corners: Array, facing: Array) -> Array:
    """Return shapes about groups of corners, shape (12, groups).

    Those are centre (3), axis (3), half the thickness, radius of the disc; direction (3) and half length of the line
    that its middle moves along.

    Args:
        corners: shape (3, groups, n). facing: normals of their faces times areas, shape (3, groups, m).
    """
    axis = facing.sum(axis=2)
    axis[:, ~axis.any(axis=0)] = 1.0
    axis /= np.sqrt((axis * axis).sum(axis=0))
    centre = (corners.min(axis=2) + corners.max(axis=2)) / 2.0
    away = corners - centre[:, :, None]
    height, square = np.einsum("ijk,ij->jk", away, axis), np.einsum("ijk,ijk->jk", away, away)
    square -= height * height
    each, farthest = np.arange(len(square)), square.argmax(axis=1)
    line = away[:, each, farthest] - height[each, farthest] * axis
    line /= np.maximum(np.sqrt((line * line).sum(axis=0)), 1e-300)
    along = np.einsum("ijk,ij->jk", away, line)
    length = (along.max(axis=1) - along.min(axis=1)) / 2.0
    middle = (along.max(axis=1) + along.min(axis=1)) / 2.0
    width = np.sqrt(np.maximum((square - along * along).max(axis=1), 0.0))
    long = length > LONG * width
    radius = np.where(long, width, np.sqrt(np.maximum(square.max(axis=1), 0.0)))
    low, high = height.min(axis=1), height.max(axis=1)
    centre += (low + high) / 2.0 * axis + np.where(long, middle, 0.0) * line
    return np.concatenate([centre, axis, [(high - low) / 2.0, radius], line, [np.where(long, length, 0.0)]])

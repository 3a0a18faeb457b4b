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
ROUNDED_SQUARE, ROUNDED, ROUNDED_PRODUCT = np.float32(4e-6), 2e-6, 3e-6
# Points are measured at once to so many groups about their place, all in all; the place reaches beyond them by so much
# of its size; so many places are remembered.
AT_ONCE, AROUND, PLACES = 100_000, 0.1, 8
# A pair of a point and a group that is measured by itself costs so many times as much; at the most so many are at once.
GATHER, AT_MOST = 7, 400_000
# Of so many groups or more at once most are left out by the way to their middle alone, if they are about as large.
MANY = 50

_GROUPS: weakref.WeakKeyDictionary[Topology, Indices] = weakref.WeakKeyDictionary()


class TriangleTree:
    """The groups of one surface's usable triangles; there must be one at least.

    Args:
        table: the triangles.
        topology: groups are kept with it: another shape of the same triangles only measures them anew.
    """

    def __init__(self, table: TriangleTable, topology: Topology) -> None:
        self._table = table
        self._places: list[_Place] = []  # looked at last
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

    def candidates(self, points: Array, limit: float, most: int) -> tuple[Indices, Indices] | None:
        """Return all pairs of a point and a triangle that may be its closest, and some more; points rise.

        Args:
            points: [m], shape (n, 3). limit: largest distance of interest [m], may be inf.
            most: None is returned where more pairs would have to be looked at.
        """
        x = np.ascontiguousarray(points.T - self._middle, dtype=np.float32)
        place = self._place(x, limit)
        if x.shape[1] * place.nodes.size > most:
            return None
        square, height, slack = place.measured(x)
        upper = np.full(len(points), limit)
        if place.nodes.size > 1:
            some = self._some(x, place.nodes.take(square.argmin(axis=1)), place.depth)
            np.minimum(upper, np.sqrt(self._table.within(np.ascontiguousarray(points.T), some)), out=upper)
        upper *= 1.0 + ROUNDED
        upper += ROUNDED * (self._extent + float(np.abs(x).max()))
        bound = np.square(upper, dtype=np.float32)
        owner, part = place.close(square, height, upper, bound + slack, np.sqrt(slack))
        node = place.nodes.take(part)
        deeper = self._levels[place.depth + 1 :]
        if deeper and owner.size * GATHER > square.size:  # groups tell little apart: measure to their members at once
            place.coarse = square.size * deeper[0].shape[2] <= AT_MOST
        for level in deeper:
            fan = level.shape[2]
            if owner.size * fan > most:
                return None
            shapes = level.take(node, axis=1)
            square, height, rounded = _measured(x.take(owner, axis=1), shapes)
            below = _below(square, height, shapes)
            below -= rounded
            near = (below <= bound.take(owner)[:, None]).reshape(-1).nonzero()[0]
            row = near // fan
            node = (node.take(row) - row) * fan + near
            owner = owner.take(row)
        return owner, self._triangles.take(node)

    def _some(self, x: Single, node: Indices, depth: int) -> Indices:
        """Return a triangle near each point, of a group at a depth, mostly the closest or its neighbour, shape (n,)."""
        for level in self._levels[depth + 1 :]:
            node = node * level.shape[2] + _measured(x, level.take(node, axis=1))[0].argmin(axis=1)
        return self._triangles.take(node)

    def _place(self, x: Single, limit: float) -> _Place:
        """Return the groups about points, shape (3, n): the finest that are few enough, as a rule from last time."""
        count = 1 << x.shape[1].bit_length()
        low, high = x.min(axis=1), x.max(axis=1)
        for k, place in enumerate(self._places):
            if (
                place.count == count
                and place.limit == limit
                and (low >= place.low).all()
                and (high <= place.high).all()
            ):
                found = self._places.pop(k)
                if found.coarse:
                    found = self._about(found.middle, found.half, limit, count, found.depth + 1)
                self._places.insert(0, found)
                return found
        margin = np.float32(AROUND * float((high - low).max())) + np.float32(0.1 * limit)
        found = self._about((low + high) / 2, (high - low) / 2 + margin, limit, count)
        self._places = [found, *self._places[: PLACES - 1]]
        return found

    def _about(self, middle: Single, half: Single, limit: float, count: int, least: int = 0) -> _Place:
        """Return the groups about a place, of the level that is asked for at least, or there are too many."""
        rounded = ROUNDED * (self._extent + float((np.abs(middle) + half).max()))
        nodes, found = np.zeros(1, dtype=np.int64), None
        for depth, level in enumerate(self._levels):
            every = (nodes[:, None] * level.shape[2] + np.arange(level.shape[2])).reshape(-1)
            shapes = level.take(nodes, axis=1).reshape(len(level), -1)
            size = np.sqrt(shapes[6] ** 2 + shapes[7] ** 2) + (shapes[11] if len(shapes) > 8 else 0.0)
            away = np.maximum(np.abs(shapes[:3] - middle[:, None]) - half[:, None], 0.0)
            near = (np.sqrt((away * away).sum(axis=0)) <= (limit + size) * (1.0 + ROUNDED) + rounded).nonzero()[0]
            if found is not None and depth > least and near.size * count > AT_ONCE:
                break
            nodes = every.take(near)
            found = _Place(depth, nodes, shapes.take(near, axis=1), middle, half, limit, count)
        assert found is not None  # there is a level
        return found


class _Place:
    """Groups of one level about a place, which every point there is measured to, in products of matrices.

    Args:
        depth: of the level. nodes: which of its groups, shape (k,). shapes: of those, shape (8 or 12, k).
        middle, half: of the place and its size [m]. limit: distance of interest there [m]. count: of points, about.

    Attributes:
        slack: by how much squared distances to each shape may be rounded, for where it is [m^2], shape (k,).
        sizes: how far from its middle a shape may seem to reach [m], shape (k,).
        told: whether the ways to their middles leave few shapes.
    """

    def __init__(
        self, depth: int, nodes: Indices, shapes: Single, middle: Single, half: Single, limit: float, count: int
    ) -> None:
        self.depth, self.nodes, self.shapes = depth, nodes, shapes
        self.middle, self.half, self.limit, self.count = middle, half, limit, count
        self.low, self.high, self.coarse = middle - half, middle + half, False
        self._middle = middle[:, None]
        centre = shapes[:3] - self._middle
        away = (centre * centre).sum(axis=0)
        # how far squared distances may be rounded [m^2], by each shape's part: what is near is told apart most finely
        self.slack = (ROUNDED_PRODUCT * away).astype(np.float32)
        sizes = np.sqrt(shapes[6] ** 2 + shapes[7] ** 2) + np.sqrt(self.slack)
        self.sizes = (sizes * (1.0 + ROUNDED)).astype(np.float32)
        self.told = len(nodes) >= MANY
        rows = [[*(-2.0 * centre), away, np.ones_like(away)]]
        rows += [
            [*axis, -(centre * axis).sum(axis=0), np.zeros_like(centre[0])]
            for axis in (shapes[3:6], shapes[8:11])
            if len(axis)
        ]
        self._matrices = np.array(rows, dtype=np.float32)

    def measured(self, x: Single) -> tuple[Single, Single, Single]:
        """Return squared distances of points (3, n) to the middles of the shapes, and heights above, shape (n, k).

        With by how much squared distances may be rounded besides `slack`, by each point's part [m^2], shape (n,).
        """
        columns = np.ones((5, x.shape[1]), dtype=np.float32)
        away = np.subtract(x, self._middle, out=columns[:3])
        np.add.reduce(away * away, out=columns[4])
        square, height, *along = columns.T @ self._matrices
        if along:
            _beside(square, along[0], self.shapes[11])
        return square, height, columns[4] * np.float32(ROUNDED_PRODUCT)

    def close(
        self, square: Single, height: Single, upper: Array, bound: Single, rounded: Single
    ) -> tuple[Indices, Indices]:
        """Return all pairs of a point and a shape that may be as near as a bound, and some more; points rise.

        Args:
            square, height: as `measured` says, which are overwritten.
            upper: the bound [m], and `bound` its square with what the point's part is rounded by [m^2], shape (n,).
            rounded: the root of the latter [m], shape (n,).
        """
        count = len(self.nodes)
        if self.told:
            farthest = (upper + rounded).astype(np.float32)[:, None] + self.sizes
            farthest *= farthest
            near = (square <= farthest).reshape(-1).nonzero()[0]
            self.told = near.size * GATHER <= square.size
            owner = near // count
            part = near - owner * count
            below = _below(square.take(near), height.take(near), self.shapes.take(part, axis=1))
            below -= self.slack.take(part)
            near = (below <= bound.take(owner)).nonzero()[0]
            return owner.take(near), part.take(near)
        below = _below(square, height, self.shapes)
        below -= self.slack
        near = (below <= bound[:, None]).reshape(-1).nonzero()[0]
        owner = near // count
        return owner, near - owner * count


def _measured(x: Single, shapes: Single) -> tuple[Single, Single, Single]:
    """Return squared distances to the middles of shapes, heights above them, and how much those are rounded, (n, fan).

    Args:
        x: shape (3, n). shapes: of each place, shape (8 or 12, n, fan).
    """
    away = x[:, :, None] - shapes[:3]
    height = np.add.reduce(away * shapes[3:6])
    square = np.add.reduce(away * away)
    rounded = square * ROUNDED_SQUARE
    if len(shapes) > 8:
        _beside(square, np.add.reduce(away * shapes[8:11]), shapes[11])
    return square, height, rounded


def _beside(square: Single, along: Single, length: Single) -> None:
    """Make squared distances to points, in place, those to lines through them, so far along them, of half lengths."""
    square -= along * along
    np.abs(along, out=along)
    along -= length
    np.maximum(along, 0.0, out=along)
    along *= along
    square += along


def _below(square: Single, height: Single, shapes: Single) -> Single:
    """Return lower bounds of squared distances to shapes [m^2], but for rounding; what is given is overwritten.

    Args:
        square: distances to their middles. height: above their planes.
    """
    square -= height * height
    np.maximum(square, 0.0, out=square)
    np.sqrt(square, out=square)
    square -= shapes[7]
    np.maximum(square, 0.0, out=square)
    square *= square
    np.abs(height, out=height)
    height -= shapes[6]
    np.maximum(height, 0.0, out=height)
    height *= height
    square += height
    return square


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

"""TriangleTree: a tree of boxes over triangles, and the compiled search for the closest of them.

Which triangle is closest does not depend on the tree, the order of points or hints: of triangles equally close, within
a relative squared distance of 1e-12, the lowest number is taken. `core/kernels/tree.c` and `closest.c` have the method.
"""

from __future__ import annotations

import weakref
from ctypes import addressof, byref
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..errors import DermisError
from ..kernels import records
from ..kernels.library import kernels
from .topology import Topology
from .triangles import TriangleTable

_ORDERS: weakref.WeakKeyDictionary[Topology, Indices] = weakref.WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Nearest:
    """The closest triangles of points, and the closest points on them.

    Attributes:
        triangle: -1 where nothing is within the limit, shape (n,).
        weights: barycentric, of its three corners, 0 without one, shape (n, 3).
        point: the closest point [m], NaN without one, shape (n, 3).
        square: squared distance [m^2], inf without one, shape (n,).
        feature: 0 within the face, 1 + k on the edge from corner k to the next, 4 + k on corner k, shape (n,).
    """

    triangle: Indices
    weights: Array
    point: Array
    square: Array
    feature: NDArray[np.int8]

    @classmethod
    def nothing(cls, n: int) -> Nearest:
        """Return that nothing is near any of so many points."""
        far = np.full(n, np.inf)
        return cls(np.full(n, -1), np.zeros((n, 3)), np.full((n, 3), np.nan), far, np.zeros(n, np.int8))

    def take(self, which: Indices) -> Nearest:
        """Return the rows of some of the points."""
        rows = self.triangle[which], self.weights[which], self.point[which], self.square[which], self.feature[which]
        return Nearest(*rows)

    def put(self, which: Indices, other: Nearest) -> None:
        """Replace the rows of some of the points."""
        self.triangle[which], self.weights[which], self.point[which] = other.triangle, other.weights, other.point
        self.square[which], self.feature[which] = other.square, other.feature


class TriangleTree:
    """The usable triangles of one surface; there must be one at least.

    Args:
        table: the triangles.
        topology: the order of triangles in leaves is kept with it: another shape of the same triangles only measures
            the boxes anew. None: no tree is made, and every triangle is looked at; for a few points.

    Raises:
        DermisError: there are no compiled kernels, or the triangles have numbers beyond measure.
    """

    def __init__(self, table: TriangleTable, topology: Topology | None) -> None:
        self._kernels = kernels()
        self._table, self._topology = table, topology
        usable = np.flatnonzero(table.usable)
        count, total = usable.size, table.usable.size
        kept = None if topology is None else _ORDERS.get(topology)
        order = usable if kept is None or kept.size != count else usable[kept]
        blocks = -(-count // records.LANES)
        depth = next(k for k in range(16) if blocks >> 2 * k <= 2)  # a leaf holds one or two blocks, as a rule
        self._record = record = records.TreeRecord(total=total, count=count, depth=depth, order=_address(order))
        record.rows, record.bounds = _address(table.rows), _address(table.bounds)
        if table.slivers is not None:
            record.slivers = _address(table.slivers)
        self._arrays = [table.rows, table.bounds, table.slivers, order]  # which the record points to
        self._find = self._kernels.closest_of_all
        if topology is None:
            return
        self._find = self._kernels.closest
        packed = np.empty((count, records.ROW))
        boxes = np.empty(((4**depth - 1) // 3 + blocks, records.BOXES), dtype=np.float32)
        record.packed, record.boxes = _address(packed), _address(boxes)
        self._arrays += [packed, boxes]
        if order is usable:
            order = usable.copy()
            record.order = _address(order)
            self._arrays.append(order)
            self._done(self._kernels.split(byref(record)), record.wrong)
            _ORDERS[topology] = np.searchsorted(usable, order)
        self._done(self._kernels.fit(byref(record)), record.wrong)

    def __reduce__(self) -> tuple[type[TriangleTree], tuple[TriangleTable, Topology | None]]:
        return type(self), (self._table, self._topology)  # records hold addresses: a copy makes its own

    def nearest(self, points: Array, limit: float, hints: Indices | None = None) -> Nearest:
        """Return the closest triangle of each point.

        Args:
            points: [m], shape (n, 3). limit: largest distance of interest [m], may be inf.
            hints: triangles that are likely close, -1 for none, shape (n,): they change the time it takes alone.

        Raises:
            DermisError: points that are not finite numbers, or wrong shapes.
        """
        n, points = len(points), np.ascontiguousarray(points, dtype=np.float64)
        if points.shape != (n, 3) or (hints is not None and np.shape(hints) != (n,)):
            shapes = f"{points.shape} and {np.shape(hints)}" if hints is not None else str(points.shape)
            raise DermisError("points must have the shape (n, 3), and hints (n,)", value=shapes)
        triangle, feature = np.empty(n, np.int64), np.empty(n, np.int8)
        weights, point, square = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
        query = records.QueryRecord(
            addressof(self._record),
            n,
            limit,
            _address(points),
            None,
            _address(triangle),
            _address(weights),
            _address(point),
            _address(square),
            _address(feature),
        )
        if hints is not None:
            hints = np.ascontiguousarray(hints, dtype=np.int64)
            query.hints = _address(hints)
        status = self._find(byref(query))
        if status == records.NOT_FINITE and query.wrong >= 0:
            raise DermisError("points to measure from are not finite numbers", value=points[query.wrong].tolist())
        self._done(status, -1 - query.wrong)
        return Nearest(triangle, weights, point, square, feature)

    def _done(self, status: int, triangle: int) -> None:
        if status == records.NOT_FINITE:
            a, ab, ac = self._table.rows[:9, triangle].reshape(3, 3)
            raise DermisError(
                "a triangle is too large or too small to measure",
                where=f"triangle {triangle}",
                value=f"edges of {np.linalg.norm(ab):.3g} m and {np.linalg.norm(ac):.3g} m at {a.tolist()} m",
                limit="an area whose square is a finite number above zero",
            )
        if status != records.DONE:
            raise DermisError("a record for the kernels is damaged", where=self._kernels.path.name, value=status)


def _address(array: NDArray[np.generic]) -> int:
    """Return where an array begins; it is contiguous and must be kept for as long as a record points to it."""
    return int(array.__array_interface__["data"][0])

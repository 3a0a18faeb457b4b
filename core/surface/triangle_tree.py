"""TriangleTree: tree of boxes around triangles, which kernels search.

`core/kernels/tree.c` describes the method.
"""

from __future__ import annotations

import weakref
from ctypes import byref

import numpy as np

from ..arrays import Indices
from ..errors import DermisError
from ..kernels import records
from ..kernels.library import kernels
from ..kernels.records import address
from .topology import Topology
from .triangles import TriangleTable

_ORDERS: weakref.WeakKeyDictionary[Topology, Indices] = weakref.WeakKeyDictionary()


class TriangleTree:
    """Search tree of the usable triangles of one surface, at least one.

    Args:
        table: the triangles.
        topology: topology of the triangles. The order of triangles in the tree is kept for it, so another shape of the
            same triangles only needs new boxes. None for no tree: a search then visits every triangle, which is fast
            for a few points.
        among: indices of the usable triangles that belong to the tree, shape (k,); None for all.

    Raises:
        DermisError: there are no compiled kernels, or a triangle is too large or too small for floating-point numbers.
    """

    def __init__(self, table: TriangleTable, topology: Topology | None, among: Indices | None = None) -> None:
        self._kernels = kernels()
        self._table, self._topology, self._among = table, topology, among
        usable = np.flatnonzero(table.usable) if among is None else np.array(among, dtype=np.int64)
        count, total = usable.size, table.usable.size
        kept = None if topology is None or among is not None else _ORDERS.get(topology)
        order = usable if kept is None or kept.size != count else usable[kept]
        blocks = -(-count // records.LANES)
        depth = next(k for k in range(16) if blocks >> 2 * k <= 2)  # a leaf usually has one or two blocks
        self.record = record = records.TreeRecord(total=total, count=count, depth=depth, order=address(order))
        record.rows, record.bounds = address(table.rows), address(table.bounds)
        if table.slivers is not None:
            record.slivers = address(table.slivers)
        self.order = order
        self._arrays = [table.rows, table.bounds, table.slivers, order]  # the record has pointers to them
        if topology is None:
            record.largest = np.abs(table.rows[0:3]).max() + np.abs(table.rows[3:9]).max()
            return
        packed = np.empty((count, records.ROW))
        boxes = np.empty(((4**depth - 1) // 3 + blocks, records.BOXES), dtype=np.float32)
        record.packed, record.boxes = address(packed), address(boxes)
        self._arrays += [packed, boxes]
        if order is usable:
            order = usable.copy()
            record.order = address(order)
            self.order = order
            self.done(self._kernels.split(byref(record)), record.wrong)
            if among is None:
                _ORDERS[topology] = np.searchsorted(usable, order)
        self.done(self._kernels.fit(byref(record)), record.wrong)

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self._table, self._topology, self._among)  # records hold addresses: a copy makes its own

    def neighbours(self, topology: Topology) -> Indices:
        """Return the slot of the neighbour at each edge of each triangle, in the order of slots; -1 for none.

        Returns:
            Indices of slots, shape (count, 3).
        """
        slots = np.full(self.record.total + 1, -1)  # the last one is for edges without a neighbour
        slots[self.order] = np.arange(len(self.order))
        return slots[topology.across[self.order]]

    def done(self, status: int, triangle: int) -> None:
        """Raise an error if a kernel has found a number that is not finite.

        Args:
            status: status that the kernel returned.
            triangle: index of the triangle whose numbers are not finite, for the error.
        """
        if status == records.NOT_FINITE:
            a, ab, ac = self._table.rows[:9, triangle].reshape(3, 3)
            raise DermisError(
                "a triangle is too large or too small to measure",
                where=f"triangle {triangle}",
                value=f"edges of {np.linalg.norm(ab):.3g} m and {np.linalg.norm(ac):.3g} m at {a.tolist()} m",
                limit="an area whose square is a finite number above zero",
            )

"""KernelBody: a surface for the kernels, and signed distances to it.

`core/kernels/distance.c` describes the method.
"""

from __future__ import annotations

from ctypes import addressof, byref

import numpy as np

from ..arrays import Array, Indices
from ..errors import DermisError
from ..kernels import records
from ..kernels.library import kernels
from ..kernels.records import address
from .gap_query import GapQuery
from .topology import Topology
from .triangle_tree import TriangleTree

# Convexity is found out for at most this many triangles: it takes 3 us for each.
MOST = 20_000


class KernelBody:
    """Surface in a record for the kernels.

    Args:
        tree: search tree of its triangles.
        rays: search tree of all triangles of the surface, for rays that determine sides; None if no rays are cast.
        topology: adjacency of the triangles.
        slabs: directions, and the extent of the surface along them, shape (k, 5).
        outside: winding number of points outside.
        by_rays: initial value of the attribute.
        other: a solid that intersects this one; both together are the body. None for a single solid.

    Attributes:
        by_rays: whether rays determine the side of all points; otherwise the closest triangle does if it can.
    """

    def __init__(
        self,
        tree: TriangleTree,
        rays: TriangleTree | None,
        topology: Topology,
        slabs: Array,
        outside: int,
        by_rays: bool,
        other: KernelBody | None = None,
    ) -> None:
        self._kernels, self._given, self._other = kernels(), (tree, rays, topology, slabs, outside), other
        self._tree = tree
        vertices = len(topology.vertex_kind)
        self.record = record = records.BodyRecord(None, addressof(tree.record), None, vertices)
        record.closed, record.by_rays = topology.closed, by_rays
        record.hollow = bool(topology.parts.max(initial=0))
        if rays is not None:
            record.all = addressof(rays.record)
        if other is not None:
            record.next = addressof(other.record)
        record.outside, record.slabs, record.weld = outside, len(slabs), topology.weld
        fixed = topology.corners, topology.across, topology.edge_kind, topology.vertex_kind, slabs
        self._arrays = [np.ascontiguousarray(array) for array in fixed]
        record.corners, record.across, record.edge_kind, record.vertex_kind, record.slab = map(address, self._arrays)
        if tree.record.packed:
            normals = np.empty((vertices, 3))
            record.normals = address(normals)
            self._arrays.append(normals)
        tree.done(self._kernels.fit_body(byref(record)), -1)

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (*self._given, self.by_rays, self._other)  # records hold addresses: a copy makes its own

    @property
    def by_rays(self) -> bool:
        return bool(self.record.by_rays)

    @by_rays.setter
    def by_rays(self, value: bool) -> None:
        self.record.by_rays = value

    def find_convexity(self) -> None:
        """Find out whether the body is convex, so that its closest triangle is found without the tree.

        It changes the run time only. It takes as long as some ten thousand points do.
        """
        tree, topology = self._tree, self._given[2]
        if (
            tree.record.packed
            and len(tree.order) <= MOST
            and not topology.weld
            and not np.ptp(topology.parts[tree.order])
        ):
            beside, facing = tree.neighbours(topology), np.empty((len(tree.order), 4))
            convex = records.ConvexRecord(address(beside), address(facing))
            own = records.BodyRecord.from_buffer_copy(self.record)
            own.convex = addressof(convex)
            tree.done(self._kernels.find_bulge(byref(own)), -1)
            if np.isfinite(convex.bulge):
                self._convex = convex, beside, facing
                self.record.convex = own.convex
        if self._other is not None:
            self._other.find_convexity()

    def tangled(self, parts: Indices) -> bool:
        """Return whether rays must determine sides.

        They must if the surface intersects itself, or if a part of it is inside the solid of another part.

        Args:
            parts: index of one triangle of each part, shape (k,).
        """
        parts = np.ascontiguousarray(parts, dtype=np.int64)
        own = records.BodyRecord.from_buffer_copy(self.record)
        own.part, own.parts = address(parts), len(parts)
        self._tree.done(self._kernels.judge(byref(own)), -1)
        return bool(own.by_rays)

    def query(self, points: Array, limit: float) -> GapQuery:
        """Return the signed gap, closest point and normal of each point.

        Args:
            points: points [m], shape (n, 3).
            limit: largest distance outside that is measured [m], or inf.

        Raises:
            DermisError: a point is not finite, or the shape is wrong.
        """
        n, points = len(points), np.ascontiguousarray(points, dtype=np.float64)
        if points.shape != (n, 3):
            raise DermisError("points must have the shape (n, 3)", value=points.shape)
        gap, normal, point, weights = np.empty(n), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
        triangle, feature, beside = np.empty(n, np.int64), np.empty(n, np.int8), np.empty(n, np.bool_)
        out = [address(array) for array in (points, gap, normal, point, weights, triangle, feature, beside)]
        query = records.QueryRecord(addressof(self.record), n, limit, *out)
        self.done(self._kernels.distances(byref(query)), query.wrong, points)
        return GapQuery(gap, normal, point, triangle, weights, beside)

    def done(self, status: int, wrong: int, points: Array) -> None:
        """Raise an error unless a kernel that measured points [m], shape (n, 3), has done so.

        Args:
            status: its status.
            wrong: index of a point, or -1 - index of a triangle, that it refused.

        Raises:
            DermisError: a point is not finite.
        """
        if status == records.NOT_FINITE and wrong >= 0:
            raise DermisError("points to measure from are not finite numbers", value=points[wrong].tolist())
        self._tree.done(status, -1 - wrong)

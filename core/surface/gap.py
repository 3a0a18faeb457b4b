"""Signed gap between points and an object's surface: exact, for any triangle mesh.

Which side a point is on:

* At a closed mesh that does not run through itself the angle-weighted pseudonormal of the closest face, edge or corner
  tells inside from outside, which is proved (Baerentzen and Aanaes 2005). Concave and thin meshes need nothing more.
* A closed mesh of solids that run through each other, such as balls that were joined, is their union: the smallest of
  their gaps counts, and walls inside are not felt.
* At a closed mesh that runs through itself in another way, or has folded faces, rays count how often it winds round the
  point. Rays also tell the side in three other cases: more than two faces share an edge, faces disagree about the
  outside, or two sheets touch in a single point. The distance is still that to the closest triangle, even if this
  triangle lies inside.
* At an open mesh (a plane, a cup of one layer) the gap is negative behind the faces. A queried point lies
  beside the sheet if its closest point is on the rim and it is not straight above or below that closest point. It
  then counts as outside, and its gap is positive.
  `Surface.side_of` tells on which side of a sheet a finger's bone is, so that a sheet can be touched from both.

`Surface.findings` reports meshes that are open or not manifold.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..errors import DermisError, Finding
from ..kernels.library import have_kernels
from ..scene.tactile_scene import Mesh
from . import shapes
from .gap_query import GapQuery
from .kernel_body import KernelBody
from .pieces import pieces
from .plain_triangles import PlainTriangles
from .roundness import Roundness, roundness
from .sharp_places import SharpPlaces, sharp_places
from .surface_normals import SurfaceNormals
from .topology import Topology, topology_of
from .triangle_tree import TriangleTree
from .triangles import TriangleTable
from .winding import winding

__all__ = ["GapQuery", "Surface"]

# Up to this many points in all are measured against every triangle, and no tree is built: a deforming object has a new
# shape each frame, and some of these shapes are only measured from the centre of a pad.
FEW = 16
# Testing whether a triangle runs through others takes a sixth of the time of a ray. Once the number of
# queried points exceeds PAYS times the number of triangles of a closed surface, all its triangles are tested; if the
# surface is not `tangled`, no more rays are cast. This changes the run time only.
PAYS = 1 / 6
# The eighth time that kernels take a surface, it is tested for convexity. The test takes as long as a few frames of
# contact, so it does not pay for a shape that lasts for one frame. This changes the run time only.
OFTEN = 8
# A surface of more solids than this is measured as a whole, because measuring every solid would take longer than a ray.
MOST_SOLIDS = 64
# Sizes that come of a wrong unit rather than of things that fingers touch [m]. A thing of 20 mm is LARGE where its
# millimetres are taken for metres. Beyond FAR from the origin a rounding step of single precision is 8 um. The finest
# cells of the skin are 100 um wide.
TINY, LARGE, FAR = 100e-6, 20.0, 100.0
# Unit vectors towards the faces, edges and corners of a cube, one of each opposite pair, shape (13, 3).
DIRECTIONS = np.array(list(np.ndindex(3, 3, 3)), dtype=np.float64)[:13:-1] - 1.0
DIRECTIONS = DIRECTIONS[np.argsort(np.abs(DIRECTIONS).sum(axis=1), kind="stable")]  # the axes x, y, z first
DIRECTIONS /= np.sqrt((DIRECTIONS * DIRECTIONS).sum(axis=1))[:, None]


class Surface:
    """A triangle surface to measure distances from. Points and results are in the same space as its vertices.

    `sphere`, `block` and `edge` make surfaces to press on, `build` makes one of any mesh.

    >>> import numpy as np
    >>> from dermis import Surface
    >>> block = Surface.block(width=0.05, length=0.05, height=0.02)  # its top is at z = 0
    >>> block.query(np.array([[0.0, 0.0, 0.003], [0.0, 0.0, -0.001]])).gap  # [m], negative inside
    array([ 0.003, -0.001])
    """

    _asked = 0  # number of points measured so far
    _taken = 0  # how often kernels have taken the surface

    def __init__(self, vertices: Array, triangles: NDArray[np.int64], topology: Topology) -> None:
        self.vertices = vertices
        self.triangles = triangles
        self.topology = topology
        self.table = TriangleTable.build(vertices, triangles)
        if topology.doubled is not None:
            self.table = self.table.without(topology.doubled)

    @classmethod
    def build(cls, vertices: NDArray[np.floating], triangles: NDArray[np.integer]) -> Surface:
        """Prepare a surface.

        Args:
            vertices: [m], shape (V, 3).
            triangles: vertex indices, counter-clockwise seen from outside, shape (T, 3). Those without area, and those
                that lie on others, are ignored and counted.

        Raises:
            DermisError: no triangle, wrong shapes, values that are not finite, or indices outside the vertices.
        """
        points = np.array(vertices, dtype=np.float64, order="C")  # a copy: the caller may change theirs
        corners = np.asarray(triangles)
        if points.ndim != 2 or points.shape[1:] != (3,) or corners.ndim != 2 or corners.shape[1:] != (3,):
            raise DermisError(
                "a surface needs vertices (V, 3) and triangles (T, 3)", value=f"{points.shape} and {corners.shape}"
            )
        if corners.shape[0] == 0:
            raise DermisError("a surface needs at least one triangle")
        if not np.isfinite(points).all():
            raise DermisError("a surface has vertices that are not finite numbers")
        if corners.min() < 0 or corners.max() >= points.shape[0]:
            wrong = corners[(corners < 0) | (corners >= points.shape[0])][0]
            limit = f"0 to {points.shape[0] - 1}"
            raise DermisError("a triangle uses a vertex that does not exist", value=int(wrong), limit=limit)
        if corners.dtype.kind not in "iu":
            raise DermisError("triangles must be indices of vertices", value=str(corners.dtype), limit="integers")
        return cls(points, corners, topology_of(points, corners))

    @classmethod
    def sphere(cls, radius: float, facets: int = 20_000) -> Surface:
        """Return a ball of a radius [m], of at least `facets` triangles; its top is the origin.

        >>> from dermis import Surface
        >>> print(f"{1e9 * Surface.sphere(5e-3).volume:.1f} mm^3")
        523.6 mm^3

        Raises:
            DermisError: a radius that is not above zero.
        """
        return cls.build(*shapes.sphere(radius, facets))

    @classmethod
    def block(cls, width: float = 0.05, length: float = 0.05, height: float = 0.02) -> Surface:
        """Return a block [m], X, Y and Z; the middle of its level top is the origin.

        Raises:
            DermisError: a length that is not above zero.
        """
        return cls.build(*shapes.block(width, length, height))

    @classmethod
    def edge(cls, angle: float = np.pi / 2, rounding: float = 0.2e-3) -> Surface:
        """Return a wedge whose edge points up and runs along Y, 50 mm long; its middle is the origin.

        Args:
            angle: between its faces [rad]. rounding: radius of the edge [m].

        >>> from dermis import Surface
        >>> Surface.edge()
        Surface(128 triangles, 40.2 x 50 x 20 mm, closed)

        Raises:
            DermisError: an angle that no wedge can have, or a rounding that is not above zero.
        """
        return cls.build(*shapes.edge(angle, rounding))

    def __repr__(self) -> str:
        size = " x ".join(f"{1e3 * s:.3g}" for s in np.ptp(self.vertices, axis=0))
        return f"Surface({len(self.triangles)} triangles, {size} mm, {'closed' if self.closed else 'open'})"

    @property
    def closed(self) -> bool:
        """Whether the surface encloses a solid."""
        return self.topology.closed

    @property
    def mesh(self) -> Mesh:
        """The same triangles as the mesh of a scene's body."""
        return Mesh(self.vertices, self.triangles.astype(np.int32))

    @cached_property
    def degenerate(self) -> int:
        """Number of triangles without area, which are ignored."""
        return int((~self.table.usable).sum()) - self.doubled

    @property
    def doubled(self) -> int:
        """Number of triangles that lie on others, which are ignored."""
        return 0 if self.topology.doubled is None else int(self.topology.doubled.sum())

    @cached_property
    def roundness(self) -> Roundness:
        """Radius of the sharpest convex bend of each part."""
        return roundness(self.table, self.topology)

    @cached_property
    def sharp_places(self) -> SharpPlaces:
        """Corners and open rims."""
        return sharp_places(self.vertices, self.table, self.topology)

    @cached_property
    def box(self) -> Array:
        """Lower and upper corner of the bounding box [m], shape (2, 3)."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @cached_property
    def volume(self) -> float:
        """Enclosed volume [m^3]; negative where a closed surface is inside out."""
        return float(self._volumes.sum())

    @cached_property
    def _volumes(self) -> Array:
        """Volume of each triangle's tetrahedron with the origin [m^3], shape (T,)."""
        a, ab, ac = (self.table.rows[k : k + 3] for k in (0, 3, 6))
        return np.asarray((a * np.cross(ab, ac, axis=0)).sum(axis=0) / 6.0)

    def findings(self, where: str = "") -> tuple[Finding, ...]:
        """Return findings about doubtful parts of the surface, for the panel."""
        found = [*self._size_findings(where)]
        if self.degenerate:
            found.append(
                Finding(
                    "info", "degenerate-triangles", "triangles without area are ignored", where, count=self.degenerate
                )
            )
        if self.doubled:
            found.append(
                Finding(
                    "info",
                    "doubled-triangles",
                    "triangles that lie on other triangles are ignored",
                    where,
                    count=self.doubled,
                )
            )
        if self.topology.irregular_edges:
            found.append(
                Finding(
                    "warning",
                    "non-manifold",
                    "edges with more than two faces, or faces that disagree about the outside",
                    where,
                    remedy="Recalculate normals outside, or make the mesh manifold",
                    count=self.topology.irregular_edges,
                )
            )
        if not self.closed:
            found.append(
                Finding(
                    "info",
                    "open-surface",
                    "the surface is open: its front is the side of its normals",
                    where,
                    count=self.topology.boundary_edges,
                )
            )
        elif self.volume < 0.0:
            found.append(
                Finding(
                    "warning",
                    "inside-out",
                    "the normals of a closed surface point inwards",
                    where,
                    remedy="Flip the normals, unless the object is a room",
                )
            )
        return tuple(found)

    def _size_findings(self, where: str) -> Iterator[Finding]:
        """Yield findings about a size or a place that comes of a wrong unit or of a vertex that lies apart."""
        corners = self.vertices[self.triangles.ravel()]
        size, far = float(np.ptp(corners, axis=0).max()), float(np.abs(corners).max())
        units = "Check the unit and the scale: lengths are in metres"
        if far > FAR:
            yield Finding(
                "warning",
                "far-from-origin",
                "the surface reaches so far from the object's origin that it is felt inexactly",
                where,
                value=f"{far:.3g} m",
                limit=f"<= {FAR:g} m",
                remedy=f"Remove vertices that lie apart, or move the origin to the surface. {units}",
            )
        elif size > LARGE:
            what = "the surface is very large for a finger"
            yield Finding("info", "large-surface", what, where, f"{size:.3g} m", f"<= {LARGE:g} m", units)
        if size < TINY:
            what = "the surface is too small to be felt"
            value, limit = f"{1e3 * size:.3g} mm", f">= {1e3 * TINY:g} mm"
            yield Finding("warning", "tiny-surface", what, where, value, limit, units)

    def query(self, points: Array, search_radius: float = np.inf) -> GapQuery:
        """Return the signed gap, closest point and normal of each point.

        Args:
            points: [m], shape (n, 3).
            search_radius: distance beyond which a point outside is of no interest [m]. Points inside a closed surface
                are always answered, however deep.

        Raises:
            DermisError: points of a wrong shape or not finite, or a search radius below 0.
        """
        points = np.ascontiguousarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1:] != (3,):
            raise DermisError("points must have the shape (n, 3)", value=points.shape)
        if not np.isfinite(points).all():
            raise DermisError("points to measure from are not finite numbers")
        if not search_radius >= 0.0:
            raise DermisError(
                "the search radius is not a distance",
                value=search_radius,
                limit="0 m or more, or inf",
                remedy="Leave it out to measure all points",
            )
        if not self.table.usable.any():
            n = len(points)
            far, nowhere = np.full(n, np.inf), np.full((n, 3), np.nan)
            none = np.zeros((n, 3))
            return GapQuery(far, none, nowhere, np.full(n, -1), none.copy(), np.zeros(n, dtype=np.bool_))
        return self._measurer(len(points)).query(points, search_radius)

    def side_of(self, point: Array) -> int:
        """Return +1 where a point [m], shape (3,), is in front of the closest faces, -1 where it is behind.

        For open surfaces this decides from which side a finger touches: pass a point inside its bone.
        """
        found = self.query(np.asarray(point, dtype=np.float64).reshape(1, 3))
        if found.triangle[0] < 0:
            return 1
        normal = self.query(found.point).normal[0]
        return -1 if float((np.asarray(point) - found.point[0]) @ normal) < 0.0 else 1

    def winding(self, points: Array) -> Array:
        """Return how often the surface encloses each point (1 inside a closed one), shape (n,)."""
        return winding(self.vertices[self.triangles], points)

    def smooth_normals(self, triangle: Indices, weights: Array) -> Array:
        """Return the normals of the curved surface that the faces stand for, see `SurfaceNormals.smooth`."""
        return self._normals.smooth(triangle, weights)

    @cached_property
    def pieces(self) -> Indices:
        """Number of each triangle's piece, shape (T,). Creases lie between pieces."""
        return pieces(self.table, self.topology)

    @cached_property
    def _normals(self) -> SurfaceNormals:
        return SurfaceNormals(self.table, self.topology, self.vertices.shape[0])

    # -- distance ------------------------------------------------------------------------------------------------

    @cached_property
    def tangled(self) -> bool:
        """Whether a closed surface runs through itself, is folded, or has parts within others."""
        if not self.closed or not self.table.usable.any():
            return False
        if self.topology.irregular:
            return True
        return self._whole.tangled(self._first_of_parts(np.flatnonzero(self.table.usable)))

    @cached_property
    def solids(self) -> tuple[Indices, ...]:
        """The triangles of each solid if the surface is several solids that run through each other; else none."""
        topology, usable = self.topology, np.flatnonzero(self.table.usable)
        if not self.closed or topology.irregular or topology.parts.max() == 0:
            return ()
        names, part = np.unique(topology.parts[usable], return_inverse=True)
        if not 1 < len(names) <= MOST_SOLIDS:
            return ()
        solids = [usable[part == k] for k in range(len(names))]
        corners = [self.vertices[self.triangles[own]].reshape(-1, 3) for own in solids]
        low, high = (np.array([end(points, axis=0) for points in corners]) for end in (np.min, np.max))
        meet = (low[:, None] <= high).all(axis=2)
        if not np.triu(meet & meet.T, 1).any() or not self.tangled:
            return ()
        hollow = int((self._volumes[usable] @ (part[:, None] == np.arange(len(names))) < 0.0).sum())
        return tuple(solids) if hollow == (self.volume < 0.0) else ()

    def _measurer(self, count: int) -> KernelBody | PlainTriangles:
        """Return the object that measures the gaps of `count` more points."""
        if have_kernels():
            return self.kernel_body_for(count)
        return PlainTriangles(self.table, self.topology, self.vertices[self.triangles])

    def kernel_body_for(self, count: int) -> KernelBody:
        """Return the surface as a record for the kernels, which measure `count` more points."""
        self._asked += count
        if self._asked <= FEW and not self.built and not self.solids:
            return self._kernel_body(TriangleTree(self.table, None), self._slabs)
        body = self._body
        if body.by_rays and not self.solids and self._asked > PAYS * len(self.triangles):
            body.by_rays = self.tangled
        return body

    @property
    def built(self) -> bool:
        """Whether the search tree has been built."""
        return "_body" in self.__dict__

    @property
    def kernel_body(self) -> KernelBody:
        """The surface as a record for the kernels, for any number of points."""
        body, self._taken = self._body, self._taken + 1
        if self._taken == OFTEN:
            body.find_convexity()
        if body.by_rays and not self.solids:
            body.by_rays = self.tangled
        return body

    @cached_property
    def _body(self) -> KernelBody:
        body = None
        for own in self.solids:
            tree = TriangleTree(self.table, self.topology, own)
            slabs = _slabs_of(self.vertices[np.unique(self.triangles[own])])
            body = self._kernel_body(tree, slabs, bool(self._volumes[own].sum() < 0.0), body)
            body.by_rays = body.by_rays and body.tangled(self._first_of_parts(own))
        return self._whole if body is None else body

    @cached_property
    def _whole(self) -> KernelBody:
        return self._kernel_body(TriangleTree(self.table, self.topology), self._slabs)

    def _kernel_body(
        self, tree: TriangleTree, slabs: Array, room: bool | None = None, other: KernelBody | None = None
    ) -> KernelBody:
        """Return the record of some triangles for the kernels.

        In a closed surface rays tell the sides, until a test shows that no rays are needed.

        Args:
            room: whether these triangles are inside out. None takes the answer for the whole surface.
            other: a solid that runs through these triangles; None for no other.
        """
        rays, room = self._rays(tree), self.volume < 0.0 if room is None else room
        by_rays = self.closed and rays is not None
        return KernelBody(tree, rays, self.topology, slabs, -1 if self.closed and room else 0, by_rays, other)

    def _first_of_parts(self, triangles: Indices) -> Indices:
        """Group some triangles by the part that they belong to, and return the first of each group."""
        return triangles[np.unique(self.topology.parts[triangles], return_index=True)[1]]

    def _rays(self, tree: TriangleTree) -> TriangleTree | None:
        """Return the tree of the triangles against which rays are tested.

        Here the same tree also finds the closest triangle.

        `NearSurface` searches only the triangles near the skin. For rays it returns the tree of all triangles of the
        shape, or None if no rays are needed.
        """
        return tree

    @cached_property
    def _slabs(self) -> Array:
        return _slabs_of(self.vertices)


def _slabs_of(points: Array) -> Array:
    """Return the `DIRECTIONS`, and the lowest and highest position of the points along each [m], shape (13, 5)."""
    along = DIRECTIONS @ points.T
    return np.column_stack([DIRECTIONS, along.min(axis=1), along.max(axis=1)])

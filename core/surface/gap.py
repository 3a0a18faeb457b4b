"""Signed gap between points and an object's surface: exact, for any triangle mesh.

Which side a point is on:

* At a closed, consistently oriented mesh the sign follows the angle-weighted pseudonormal of the closest face, edge
  or corner, which is provably the inside (Baerentzen and Aanaes 2005). Concave and thin meshes need nothing more.
* An open mesh (a plane, a cup of one layer) is negative behind its faces. A point whose closest point lies on the
  rim, and that is not straight above or below it, has passed beside the sheet: it is outside, and its gap positive.
  `Surface.side_of` tells on which side of a sheet a finger's bone is, so that a sheet can be touched from both.
* Where more than two faces share an edge, faces disagree about the outside, or two sheets touch in a single point,
  no normal decides: a closed mesh then asks for its winding number there, an open one takes the mean normal.
  `Surface.findings` reports such meshes.
* Self-intersecting parts: the closest face decides, also where it lies inside another part. Where faces are folded
  over, a point that would lie deep inside by one of them asks for its winding number.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..errors import DermisError, Finding
from ..kernels.library import have_kernels
from ..scene.tactile_scene import Mesh
from . import shapes
from .gap_query import GapQuery
from .nearest import PlainTriangles
from .normals import SurfaceNormals
from .pieces import pieces
from .planes import Planes
from .topology import BOUNDARY, IRREGULAR, REGULAR, Topology, topology_of
from .tree import Nearest, TriangleTree
from .triangles import TriangleTable
from .winding import winding

__all__ = ["GapQuery", "Surface"]

# A corner whose weight is above this is of the feature that a closest point lies on.
ON_FEATURE = 1e-9
# A point is straight above a rim if it is off by less than this fraction of its distance.
STRAIGHT = 1e-6
# So many points are measured to all triangles where these are in no tree yet: one shape of an object that deforms may
# be asked about a pad's centre only.
FEW = 4
# Deeper than this a point is asked twice whether it is inside, if faces are folded over where it is closest [m].
DEEP = 0.2e-3
# Nearer than this to a surface the way to its closest point has no direction to speak of [m].
ON_SURFACE = 1e-9
# Towards the faces, edges and corners of a cube, and not their opposites; unit length, shape (13, 3).
DIRECTIONS = np.array(list(np.ndindex(3, 3, 3)), dtype=np.float64)[14:] - 1.0
DIRECTIONS /= np.sqrt((DIRECTIONS * DIRECTIONS).sum(axis=1))[:, None]


class Surface:
    """A triangle surface to measure distances from, in the space of the vertices it was given.

    `sphere`, `block` and `edge` make surfaces to press on, `build` makes one of any mesh.

    >>> import numpy as np
    >>> from dermis import Surface
    >>> block = Surface.block(width=0.05, length=0.05, height=0.02)  # its top is at z = 0
    >>> block.query(np.array([[0.0, 0.0, 0.003], [0.0, 0.0, -0.001]])).gap  # [m], negative inside
    array([ 0.003, -0.001])
    """

    def __init__(self, vertices: Array, triangles: NDArray[np.int64], topology: Topology) -> None:
        self.vertices = vertices
        self.triangles = triangles
        self.topology = topology
        self.table = TriangleTable.build(vertices, triangles)

    @classmethod
    def build(cls, vertices: NDArray[np.floating], triangles: NDArray[np.integer]) -> Surface:
        """Prepare a surface.

        Args:
            vertices: [m], shape (V, 3).
            triangles: vertex indices, counter-clockwise seen from outside, shape (T, 3). Those without area
                are ignored and counted.

        Raises:
            DermisError: no triangle, wrong shapes, values that are not finite, or indices outside the vertices.
        """
        points = np.ascontiguousarray(vertices, dtype=np.float64)
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
            raise DermisError("triangles are whole numbers of vertices", value=str(corners.dtype), limit="integers")
        return cls(points, corners, topology_of(points, corners))

    @classmethod
    def sphere(cls, radius: float, facets: int = 20_000) -> Surface:
        """Return a ball of a radius [m], of at least so many triangles; its top is the origin.

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
            DermisError: an angle that is none of a wedge, or a rounding that is not above zero.
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
        return int((~self.table.usable).sum())

    @cached_property
    def box(self) -> Array:
        """Lower and upper corner of the bounding box [m], shape (2, 3)."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @cached_property
    def volume(self) -> float:
        """Enclosed volume [m^3]; negative where a closed surface is inside out."""
        a, ab, ac = (self.table.rows[k : k + 3] for k in (0, 3, 6))
        return float((a * np.cross(ab, ac, axis=0)).sum() / 6.0)

    def findings(self, where: str = "") -> tuple[Finding, ...]:
        """Return what is doubtful about the surface, for the panel."""
        found = []
        if self.degenerate:
            found.append(
                Finding(
                    "info", "degenerate-triangles", "triangles without area are ignored", where, count=self.degenerate
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
                "a search radius is no distance",
                value=search_radius,
                limit="0 m or more, or inf",
                remedy="Leave it out to measure all points",
            )
        return self._signed(points, self._search(points, search_radius))

    def side_of(self, point: Array) -> int:
        """Return +1 where a point [m], shape (3,), is in front of the closest faces, -1 where it is behind.

        For open surfaces this decides from which side a finger touches: ask for its bone.
        """
        found = self._search(np.ascontiguousarray(point, dtype=np.float64).reshape(1, 3), np.inf)
        if found.triangle[0] < 0:
            return 1
        _, normal = self._features(found)
        return -1 if float((np.asarray(point) - found.point[0]) @ normal[0]) < 0.0 else 1

    def winding(self, points: Array) -> Array:
        """Return how often the surface encloses each point (1 inside a closed one), shape (n,)."""
        return winding(self.vertices[self.triangles], points)

    def smooth_normals(self, triangle: Indices, weights: Array) -> Array:
        """Return the normals of the curved surface that the faces stand for, see `SurfaceNormals.smooth`."""
        return self._normals.smooth(triangle, weights)

    @cached_property
    def planes(self) -> Planes:
        """Its planes and their rims."""
        return Planes.of(self.table, self.topology)

    @cached_property
    def pieces(self) -> Indices:
        """Which piece without a crease each triangle belongs to, shape (T,)."""
        return pieces(self.table, self.topology)

    @cached_property
    def _normals(self) -> SurfaceNormals:
        return SurfaceNormals(self.table, self.topology, self.vertices.shape[0])

    # -- distance ------------------------------------------------------------------------------------------------

    @cached_property
    def _tree(self) -> TriangleTree:
        return TriangleTree(self.table, self.topology)

    def _finder(self, count: int) -> TriangleTree | PlainTriangles:
        """Return what finds the closest triangles of so many points: a tree is not worth growing for a few."""
        if not have_kernels():
            return PlainTriangles(self.table)
        return TriangleTree(self.table, None) if count <= FEW and "_tree" not in self.__dict__ else self._tree

    @cached_property
    def _slabs(self) -> tuple[Array, Array]:
        """How far the surface extends along the `DIRECTIONS`, down and up [m], shape (13, 1) each."""
        along = DIRECTIONS @ self.vertices.T
        return along.min(axis=1, keepdims=True), along.max(axis=1, keepdims=True)

    def _search(self, points: Array, search_radius: float) -> Nearest:
        if len(points) == 0 or not self.table.usable.any():
            return Nearest.nothing(len(points))
        found = self._finder(len(points)).nearest(points, search_radius)
        if not self.closed or not np.isfinite(search_radius):
            return found
        lost = (found.triangle < 0).nonzero()[0]
        if lost.size:  # where the way out of the slabs is shorter than the one to the surface, it leads outside
            along = DIRECTIONS @ points[lost].T
            low, high = self._slabs
            lost = lost[np.maximum((along - high).max(axis=0), (low - along).max(axis=0)) <= -search_radius]
        if lost.size:
            deep = self._finder(lost.size).nearest(points[lost], np.inf)
            inside = (self._signed(points[lost], deep).gap < 0.0).nonzero()[0]
            found.put(lost[inside], deep.take(inside))
        return found

    # -- sign and normal -----------------------------------------------------------------------------------------

    def _features(self, found: Nearest) -> tuple[NDArray[np.int8], Array]:
        """Return kind and pseudonormal (not normalised) of the closest features."""
        triangle, feature = found.triangle, found.feature
        kind = np.zeros(triangle.size, dtype=np.int8)
        normal = self.table.bounds[3:6].take(triangle, axis=1).T
        v = (feature >= 4).nonzero()[0]
        if v.size:
            vertex = self.topology.corners[triangle[v], feature[v] - 4]
            normal[v] = self._normals.of_vertices[vertex]
            kind[v] = self.topology.vertex_kind[vertex]
        e = ((feature > 0) & (feature < 4)).nonzero()[0]
        if e.size:
            on_triangle, edge = triangle.take(e), feature[e] - 1
            other = self.topology.across[on_triangle, edge]
            beyond = self.table.bounds[3:6].take(other, axis=1)
            beyond *= other >= 0
            normal[e] += beyond.T
            of_edge = self.topology.edge_kind[on_triangle, edge]
            of_edge[(of_edge == REGULAR) & (other >= 0) & ~self.table.usable.take(other)] = IRREGULAR
            kind[e] = of_edge
        return kind, normal

    def _signed(self, points: Array, found: Nearest) -> GapQuery:
        n, near = len(points), (found.triangle >= 0).nonzero()[0]
        if near.size == n:
            gap, normal, beside = self._sides(points, found)
            return GapQuery(gap, normal, found.point, found.triangle, found.weights, beside)
        gap, normal, beside = np.full(n, np.inf), np.zeros((n, 3)), np.zeros(n, dtype=bool)
        if near.size:
            gap[near], normal[near], beside[near] = self._sides(points[near], found.take(near))
        return GapQuery(gap, normal, found.point, found.triangle, found.weights, beside)

    def _sides(self, points: Array, found: Nearest) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return gap, normal and `beside` of a `GapQuery` for points whose closest triangles are known."""
        kind, pseudo = self._features(found)
        offset = points - found.point
        distance = np.sqrt(_dot(offset, offset))
        along = _dot(offset, pseudo)
        sign = np.where(along < 0.0, -1.0, 1.0)
        beside = np.zeros(len(points), dtype=bool)
        if kind.any():
            beside[self._special_sides(points, np.flatnonzero(kind), kind, distance, along, pseudo, sign)] = True
        if self.closed:
            self._unfold(points, sign, distance, found.triangle, found.weights)
        return sign * distance, self._directions(offset, distance, sign, pseudo, found.triangle), beside

    def _special_sides(
        self,
        points: Array,
        special: Indices,
        kind: NDArray[np.int8],
        distance: Array,
        along: Array,
        pseudo: Array,
        sign: Array,
    ) -> Indices:
        """Decide the side at rims and at edges that no normal decides, in place; return which are beside a rim."""
        rim = special[kind[special] == BOUNDARY]
        length = np.maximum(np.sqrt(np.einsum("ij,ij->i", pseudo[rim], pseudo[rim])), 1e-300)
        height = along[rim] / length
        across = np.sqrt(np.maximum(distance[rim] ** 2 - height**2, 0.0))
        rim = rim[across > STRAIGHT * distance[rim]]
        sign[rim] = 1.0
        odd = special[kind[special] == IRREGULAR]
        if odd.size and self.closed:
            sign[odd] = np.where(self.winding(points[odd]) > 0.5, -1.0, 1.0)
        return rim

    def _unfold(self, points: Array, sign: Array, distance: Array, triangle: Indices, weights: Array) -> None:
        """Put points that lie inside only by faces folded over outside, in place."""
        deep = ((sign < 0.0) & (distance > DEEP)).nonzero()[0]
        if deep.size == 0:
            return
        folded = self._normals.folded[self.topology.corners[triangle[deep]]] & (weights[deep] > ON_FEATURE)
        odd = deep[folded.any(axis=1)]
        if odd.size:
            sign[odd] = np.where(self.winding(points[odd]) > 0.5, -1.0, 1.0)

    def _directions(self, offset: Array, distance: Array, sign: Array, pseudo: Array, triangle: Indices) -> Array:
        """Gradient of the gap; so near the surface that rounding would turn it, the pseudonormal."""
        tiny = distance <= ON_SURFACE
        if not tiny.any():
            return offset * (sign / distance)[:, None]
        normal = offset * (sign / np.where(tiny, 1.0, distance))[:, None]
        length = np.sqrt(_dot(pseudo[tiny], pseudo[tiny]))
        unit = pseudo[tiny] / np.maximum(length, 1e-300)[:, None]
        face = self.table.bounds[3:6].take(triangle[tiny], axis=1).T
        normal[tiny] = np.where((length > 1e-9)[:, None], unit, face)
        return normal


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("ij,ij->i", a, b)

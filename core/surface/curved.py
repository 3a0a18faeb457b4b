"""CurvedMesh: a triangle mesh refined to follow a curved surface.

The vertices and normals of a mesh define a curved patch over each of its triangles, see `patches`. Triangles are split
where an edge is too far from its patch, and nowhere else. The given vertices do not move, flat faces with straight
edges stay whole, and a mesh without bent edges is returned unchanged.

The new vertices, and the patch of each, are found once. `CurvedMesh.moved` keeps them while the mesh deforms, unless
the mesh bends more than twice as much somewhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..components import components
from ..errors import DermisError, Finding
from ..scene.tactile_scene import Mesh, check_mesh
from .patches import Patches, bends, weights
from .topology import Topology

# [m] Default tolerance. The force of a ball of 6 mm is then off by up to 0.3 %; made of 320 flat faces, by up to 5 %.
TOLERANCE = 10e-6
MOST = 100_000  # largest number of triangles of a curved surface; a mesh that has more at first keeps them
_LOOKS = (1 / 3, 2 / 3)  # places along an edge at which it is compared with its patch, 0 to 1
_PEAK = 9 / 8  # error of a parabola at its middle, divided by its error at `_LOOKS`
_SURE = 4.0  # an estimate above this many times the allowed number of triangles is surely too many
# Triangles that replace one with 1, 2 and 3 split edges. Indices 0 to 2 are its corners, 3 to 5 the edges' middles.
_PARTS: tuple[tuple[tuple[int, int, int], ...], ...] = (
    ((0, 3, 2), (3, 1, 2)),
    ((3, 1, 4), (0, 3, 4), (0, 4, 2)),
    ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
)


@dataclass(frozen=True, eq=False)
class CurvedMesh:
    """Triangle mesh on the curved surface that a flat mesh approximates.

    Attributes:
        mesh: the vertices of the flat mesh, then the new ones; the flat mesh itself if no triangle was split.
        offset: largest distance from a flat face to the curved surface [m], at the new vertices and the faces' middles.
        left: largest distance that remains between the triangles and the curved surface [m].
        tolerance: distance allowed when the mesh was made [m]. `left` exceeds it if it needed too many triangles.
    """

    mesh: Mesh
    offset: float
    left: float
    tolerance: float
    _patches: Patches
    _patch: NDArray[np.int64]
    _weights: Array
    _bends: Array
    _most: int

    def __repr__(self) -> str:
        return f"CurvedMesh({len(self.mesh.triangles)} triangles, {1e3 * self.offset:.3g} mm from flat)"

    def moved(self, vertices: Array, normals: Array) -> CurvedMesh:
        """Return the curved mesh of another shape of the same triangles.

        Triangles, `offset` and `left` are those of this mesh. If the shape bends more than twice as much somewhere, a
        new curved mesh is made instead.

        Args:
            vertices: vertices of the flat mesh in that shape [m], shape (V, 3).
            normals: unit normals at the corners of each flat triangle, shape (T, 3, 3).
        """
        net = self._patches.net(vertices, normals)
        if (bends(net) > 2.0 * np.maximum(self._bends, self.tolerance)).any():
            flat = Mesh(vertices, self._patches.triangles)
            return curved_mesh(flat, normals, tolerance=self.tolerance, most=self._most)
        new = _points(net, self._patch, self._weights)
        return replace(self, mesh=Mesh(np.vstack([vertices, new]), self.mesh.triangles))

    def findings(self, where: str, scale: float = 1.0) -> tuple[Finding, ...]:
        """Report the distance to the flat faces, and a tolerance that was not met.

        Args:
            where: object that the findings name.
            scale: scale of the object that carries the surface.
        """
        found = []
        if len(self._patch):
            found.append(
                Finding(
                    "info",
                    "curved",
                    "it is felt as the curved surface that its faces stand for, this far from them at most",
                    where=where,
                    value=f"{1e3 * self.offset * scale:.3g} mm",
                )
            )
        if self.left > self.tolerance:
            found.append(
                Finding(
                    "info",
                    "curved-coarsely",
                    "its curved surface would need more triangles than are allowed, so its flat faces are used",
                    where=where,
                    value=f"{1e6 * self.left * scale:.3g} um off",
                    limit=f"{1e6 * self.tolerance * scale:.3g} um, {self._most} triangles",
                    remedy="Delete the parts that no finger reaches",
                )
            )
        return tuple(found)


def curved_mesh(
    mesh: Mesh,
    normals: NDArray[np.floating] | None = None,
    *,
    tolerance: float = TOLERANCE,
    most: int = MOST,
    where: str = "mesh",
) -> CurvedMesh:
    """Return a mesh on the curved surface that triangles and normals define.

    >>> from dermis import Surface, curved_mesh
    >>> curved_mesh(Surface.sphere(6e-3, 320).mesh)
    CurvedMesh(5120 triangles, 0.101 mm from flat)

    Args:
        mesh: the flat mesh, with V vertices and T triangles.
        normals: normals of the surface at each triangle's corners, shape (T, 3, 3), or at each vertex, shape (V, 3).
            They need not be of unit length. None for those of `corner_normals`.
        tolerance: distance allowed between the triangles and the curved surface [m].
        most: largest number of triangles. If it is too small, the tolerance is doubled until it suffices.
            `CurvedMesh.left` has the distance that remains.
        where: mesh that errors name.

    Raises:
        DermisError: the tolerance is not above zero, triangles use vertices that the mesh does not have, or the normals
            do not fit the mesh or are not finite numbers.
    """
    if not tolerance > 0:
        raise DermisError("the tolerance must be above zero", where=where, value=tolerance, limit="> 0 m")
    # Sampled scenes have meshes without triangles, or with vertices that are not finite. These are not checked.
    if len(mesh.triangles) and np.isfinite(mesh.vertices).all():
        check_mesh(mesh, where)
    corners = _corner_normals(mesh, normals, where)
    patches = Patches(mesh.vertices, corners, mesh.triangles)
    net = patches.net(mesh.vertices, corners)
    refined = _Refined(mesh, patches)
    if (bends(net) > tolerance).any():
        many = max(most, len(mesh.triangles))
        allowed = refined.first_hope(net, tolerance, many)
        while not refined.reach(net, allowed, many):
            allowed *= 2.0
            refined = _Refined(mesh, patches)
    new = slice(len(mesh.vertices), None)
    patch, table = refined.patch[new], weights(refined.place[new])
    if not len(patch):
        return CurvedMesh(mesh, 0.0, refined.left, tolerance, patches, patch, table, bends(net), most)
    points = _points(net, patch, table)
    flat = np.einsum("nc,nci->ni", refined.place[new], mesh.vertices[mesh.triangles[patch]])
    amid = np.einsum("c,tci->ti", weights(np.full((1, 3), 1 / 3))[0], net) - net[:, :3].mean(axis=1)
    offset = float(max(np.linalg.norm(way, axis=1).max() for way in (points - flat, amid)))
    made = Mesh(np.vstack([mesh.vertices, points]), refined.triangles.astype(np.int32))
    return CurvedMesh(made, offset, refined.left, tolerance, patches, patch, table, bends(net), most)


def stretch_of(pose: Array) -> float:
    """Return the largest stretch of a mesh by its object's pose, shape (4, 4).

    It is 1 for a pose that is zero or not finite.
    """
    most = float(np.linalg.norm(pose[:3, :3], ord=2))
    return most if np.isfinite(most) and most > 0.0 else 1.0


class _Refined:
    """Triangles on patches, split in rounds.

    Attributes:
        triangles: indices of vertices, shape (t, 3).
        patch: index of the patch of each vertex, shape (v,); 0 for the given vertices.
        place: barycentric coordinates of each vertex on its patch, shape (v, 3); zero for the given vertices.
        left: largest distance between the triangles and their patches [m].
    """

    def __init__(self, mesh: Mesh, patches: Patches) -> None:
        count = len(mesh.vertices)
        self.triangles = mesh.triangles.astype(np.int64)
        self.patch, self.place = np.zeros(count, np.int64), np.zeros((count, 3))
        self.left = 0.0
        self._on = np.arange(len(self.triangles))  # the patch of each triangle
        self._at = np.tile(np.eye(3), (len(self.triangles), 1, 1))  # barycentric, of its corners on that patch
        self._merged = patches.topology.merged

    def first_hope(self, net: Array, tolerance: float, most: int) -> float:
        """Return the tolerance, doubled until `most` triangles may be enough.

        A smaller tolerance would need too many triangles, in the first round of splits or surely in later ones. Each
        half of a split edge has a quarter of its error. A triangle whose edges each end in n pieces ends in n x n.
        """
        edge, number = self._edges()
        off = np.zeros(len(number))
        np.maximum.at(off, edge, self._off(net))
        worst = off[edge].reshape(-1, 3) * (4.0 / 3.0)
        parts = np.sqrt(worst.min(axis=1) * worst.max(axis=1))  # divided by the tolerance: pieces of each triangle
        with np.errstate(over="ignore", invalid="ignore"):
            while (worst > tolerance).sum() + len(worst) > most or (
                np.maximum(parts / tolerance, 1.0).sum() > _SURE * most
            ):
                tolerance *= 2.0
        return tolerance

    def reach(self, net: Array, tolerance: float, most: int) -> bool:
        """Split triangles until the tolerance is met.

        Returns:
            Whether `most` triangles were enough.
        """
        while True:
            edge, number = self._edges()
            off = np.zeros(len(number))
            np.maximum.at(off, edge, self._off(net))
            # The error at the middle of a triangle is 4/3 of its edges' error.
            self.left = float(off.max(initial=0.0)) * 4.0 / 3.0
            split = off * (4.0 / 3.0) > tolerance
            if not split.any():
                return True
            if len(self.triangles) + int(split[edge].sum()) > most:
                return False
            self._split(split[edge].reshape(-1, 3), edge, split, number)

    def _edges(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return indices of the triangles' edges, (3 t,), and their first places.

        Triangles that share an edge have the same index for it. The second array has, for each index, its first place
        in the first array.
        """
        ends = self._merged[self.triangles]
        pair = np.sort(np.stack([ends, ends[:, [1, 2, 0]]], axis=2).reshape(-1, 2), axis=1)
        key = pair[:, 0] * np.int64(len(self._merged)) + pair[:, 1]
        _, first, number = np.unique(key, return_index=True, return_inverse=True)
        return number.reshape(-1), first

    def _off(self, net: Array) -> Array:
        """Return the distance of each edge from its patch [m], shape (3 t,).

        It is measured along the normal of the triangle that has the edge.
        """
        corners = np.stack([_points(net, self._on, weights(self._at[:, k])) for k in range(3)], axis=1)
        chord = corners[:, [1, 2, 0]] - corners
        normal = np.cross(chord[:, 0], chord[:, 1])
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        following = self._at[:, [1, 2, 0]]
        worst = np.zeros((len(self._on), 3))
        for part, k in ((part, k) for part in _LOOKS for k in range(3)):
            way = _points(net, self._on, weights((1 - part) * self._at[:, k] + part * following[:, k])) - corners[:, k]
            worst[:, k] = np.maximum(worst[:, k], np.abs(np.einsum("ti,ti->t", way, normal)))
        return worst.reshape(-1) * _PEAK

    def _split(
        self, marked: NDArray[np.bool_], edge: NDArray[np.int64], split: NDArray[np.bool_], first: NDArray[np.int64]
    ) -> None:
        """Split edges in their middles, and the triangles that have these edges.

        Args:
            marked: whether to split the edges of each triangle, shape (t, 3).
            edge: index of each triangle's edges, see `_edges`, shape (3 t,).
            split: whether to split the edge of each index, shape (e,).
            first: first place of each index in `edge`, shape (e,).
        """
        chosen = first[split]
        number = np.full(len(split), -1)
        number[split] = len(self.patch) + np.arange(len(chosen))
        middle = 0.5 * (self._at + self._at[:, [1, 2, 0]])
        self.patch = np.concatenate([self.patch, self._on[chosen // 3]])
        self.place = np.vstack([self.place, middle.reshape(-1, 3)[chosen]])
        self._merged = np.concatenate([self._merged, number[split]])
        corners = np.hstack([self.triangles, number[edge].reshape(-1, 3)])
        places = np.concatenate([self._at, middle], axis=1)
        count = marked.sum(axis=1)
        kept = count == 0
        triangles, at, on = [self.triangles[kept]], [self._at[kept]], [self._on[kept]]
        for many, parts in enumerate(_PARTS, start=1):
            rows = np.flatnonzero(count == many)
            # Triangles are turned: a single split edge comes first; if two edges are split, the whole edge comes last.
            turn = marked[rows].argmax(axis=1) if many == 1 else ((~marked[rows]).argmax(axis=1) + 1) % 3
            order = (np.arange(3) + turn[:, None]) % 3
            order = np.hstack([order, order + 3])
            for part in parts:
                use = order[:, part]
                triangles.append(corners[rows[:, None], use])
                at.append(places[rows[:, None], use])
                on.append(self._on[rows])
        self.triangles, self._at, self._on = np.vstack(triangles), np.concatenate(at), np.concatenate(on)


def _points(net: Array, patch: NDArray[np.int64], table: Array) -> Array:
    """Return points on patches [m], shape (n, 3).

    Args:
        net: control points of all patches, see `Patches.net`.
        patch: patch of each point, shape (n,).
        table: weights of the control points, see `patches.weights`, shape (n, 10).
    """
    out = np.zeros((len(patch), 3))
    for control in range(10):  # one by one: to gather all ten for each point would take ten times the memory
        out += table[:, control, None] * net[patch, control]
    return out


def _corner_normals(mesh: Mesh, normals: NDArray[np.floating] | None, where: str) -> Array:
    if normals is None:
        return corner_normals(mesh)
    try:
        given = np.asarray(normals, np.float64)
    except (TypeError, ValueError) as error:  # text, or rows of differing length
        raise DermisError("the normals are not numbers", where=where) from error
    if given.shape == mesh.vertices.shape:
        given = given[mesh.triangles]
    if given.shape != (len(mesh.triangles), 3, 3) or not np.isfinite(given).all():
        limit = f"finite, {(len(mesh.triangles), 3, 3)} or {mesh.vertices.shape}"
        raise DermisError("the normals do not fit the mesh", where=where, value=given.shape, limit=limit)
    return np.asarray(given / np.maximum(np.linalg.norm(given, axis=2), 1e-300)[..., None])


SHARP = np.pi / 6  # [rad] least angle of a sharp edge: 30 degrees, as in Blender's Shade Auto Smooth


def corner_normals(mesh: Mesh, sharp: float = SHARP) -> Array:
    """Return unit normals of each triangle's corners, shape (T, 3, 3).

    Faces around a vertex that are connected by edges that are not sharp have one normal there. It is the mean of their
    normals, weighted by their angles at the vertex. On a smooth surface it is exact to second order.

    Args:
        mesh: the mesh, with T triangles.
        sharp: angle between two faces [rad]. At this angle or more the edge between them is sharp.
    """
    topology = Topology.build(mesh.vertices, mesh.triangles)
    corners, across = topology.corners, topology.across
    points = mesh.vertices[mesh.triangles]
    edges = points[:, [1, 2, 0]] - points
    edges /= np.maximum(np.linalg.norm(edges, axis=2), 1e-300)[..., None]
    face = np.cross(edges[:, 0], edges[:, 1])
    face /= np.maximum(np.linalg.norm(face, axis=1), 1e-300)[:, None]
    cosine = -np.einsum("tki,tki->tk", edges, edges[:, [2, 0, 1]])
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    triangle, edge = np.nonzero(across >= 0)
    other = across[triangle, edge]
    smooth = np.einsum("ni,ni->n", face[triangle], face[other]) > np.cos(sharp)
    triangle, edge, other = triangle[smooth], edge[smooth], other[smooth]
    here, there = [], []
    for corner in (edge, (edge + 1) % 3):
        match = corners[other] == corners[triangle, corner][:, None]
        here.append(3 * triangle + corner)
        there.append(3 * other + match.argmax(axis=1))
    group = components(corners.size, np.concatenate(here), np.concatenate(there))
    count = 1 + int(group.max(initial=-1))
    summed = np.zeros((count, 3))
    weighted = (angle[..., None] * face[:, None, :]).reshape(-1, 3)
    for axis in range(3):
        summed[:, axis] = np.bincount(group, weighted[:, axis], minlength=count)
    summed /= np.maximum(np.linalg.norm(summed, axis=1), 1e-300)[:, None]
    return np.asarray(summed[group].reshape(-1, 3, 3))

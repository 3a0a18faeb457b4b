"""CurvedMesh: a mesh whose triangles follow the curved surface that it stands for, as finely as wanted.

Triangles are split where an edge leaves its patch, and nowhere else: corners stay where they are, flat faces stay
whole, and a mesh that is flat all over is handed back as it came. Which points are new, and on which patch each lies,
is found once; a mesh that deforms has the same ones from then on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError, Finding
from ..scene.tactile_scene import Mesh, check_mesh
from .patches import Patches, bends, weights
from .topology import Topology

TOLERANCE = 10e-6  # [m] a ball of 6 mm pushes back within 0.3 %; in 320 flat faces it is up to 5 % off
MOST = 100_000  # triangles that a curved surface may have; a mesh that comes with more keeps them
_LOOKS = (1 / 3, 2 / 3)  # along an edge, where it is compared with its patch
_PEAK = 9 / 8  # error of a parabola at its middle, over that at these places
_SURE = 4.0  # times as many triangles as are allowed are too many, however roughly they are foretold
_PARTS: tuple[tuple[tuple[int, int, int], ...], ...] = (  # by corners 0-2 and middles 3-5, for 1, 2 and 3 split edges
    ((0, 3, 2), (3, 1, 2)),
    ((3, 1, 4), (0, 3, 4), (0, 4, 2)),
    ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
)


@dataclass(frozen=True, eq=False)
class CurvedMesh:
    """A mesh on the curved surface that another stands for.

    Attributes:
        mesh: the other's vertices first, then the new ones; the other itself where no triangle is split.
        offset: the longest way from the flat faces to the curved surface [m].
        left: how far its triangles are off the curved surface still [m].
        tolerance: how far they were allowed to be [m].
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
        """Return the curved mesh of another shape of the same flat triangles; `offset` and `left` stay as they were.

        Its triangles are the same ones, unless the shape bends more than twice as much somewhere: then it is made anew.

        Args:
            vertices: [m], shape (V, 3). normals: unit, of each triangle's corners, shape (T, 3, 3).
        """
        net = self._patches.net(vertices, normals)
        if (bends(net) > 2.0 * np.maximum(self._bends, self.tolerance)).any():
            flat = Mesh(vertices, self._patches.triangles)
            return curved_mesh(flat, normals, tolerance=self.tolerance, most=self._most)
        new = _points(net, self._patch, self._weights)
        return replace(self, mesh=Mesh(np.vstack([vertices, new]), self.mesh.triangles))

    def findings(self, where: str, scale: float = 1.0) -> tuple[Finding, ...]:
        """Return how far the curved surface is from the flat one, and whether its triangles follow it.

        Args:
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
                    "its curved surface would need more triangles than are allowed, and is felt in facets",
                    where=where,
                    value=f"{1e6 * self.left * scale:.3g} um off",
                    limit=f"{1e6 * self.tolerance * scale:.3g} um, {self._most} triangles",
                    remedy="Cut away what no finger reaches",
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
    """Return the mesh on the curved surface that another one's triangles and normals stand for.

    >>> from dermis import Surface, curved_mesh
    >>> curved_mesh(Surface.sphere(6e-3, 320).mesh)
    CurvedMesh(5120 triangles, 0.101 mm from flat)

    Args:
        normals: that the surface shall have, of each triangle's corners (T, 3, 3) or of each vertex (V, 3); those of
            `corner_normals` where left out. They need not be of unit length.
        tolerance: how far triangles may be off the curved surface [m].
        most: triangles; where they do not do, the tolerance is doubled until they do, and `CurvedMesh.left` tells.

    Raises:
        DermisError: a tolerance that is not above zero, triangles that are no vertices of the mesh, or normals that
            do not fit it or are no numbers.
    """
    if not tolerance > 0:
        raise DermisError("the tolerance must be above zero", where=where, value=tolerance, limit="> 0 m")
    if len(mesh.triangles) and np.isfinite(mesh.vertices).all():  # others come back as they are: samples have such
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
    """Return the most that an object's pose, shape (4, 4), stretches its mesh by; 1 where it says nothing."""
    most = float(np.linalg.norm(pose[:3, :3], ord=2))
    return most if np.isfinite(most) and most > 0.0 else 1.0


class _Refined:
    """Triangles on patches, split round after round.

    Attributes:
        triangles: shape (t, 3). patch: that each new point lies on, shape (v,). place: barycentric there, shape (v, 3).
        left: how far triangles are off their patches [m].
    """

    def __init__(self, mesh: Mesh, patches: Patches) -> None:
        count = len(mesh.vertices)
        self.triangles = mesh.triangles.astype(np.int64)
        self.patch, self.place = np.zeros(count, np.int64), np.zeros((count, 3))
        self.left = 0.0
        self._on = np.arange(len(self.triangles))  # the patch of each triangle
        self._at = np.tile(np.eye(3), (len(self.triangles), 1, 1))  # where its corners are there, shape (t, 3, 3)
        self._merged = patches.topology.merged

    def first_hope(self, net: Array, tolerance: float, most: int) -> float:
        """Return the first of the tolerance's doublings for which `most` triangles may be enough.

        Others are not worth a try: the first round of splits would be too many, or the rounds that follow surely, since
        an edge's halves are off by a quarter: a triangle whose edges need n splits each ends as n x n.
        """
        edge, number = self._edges()
        off = np.zeros(len(number))
        np.maximum.at(off, edge, self._off(net))
        worst = off[edge].reshape(-1, 3) * (4.0 / 3.0)
        parts = np.sqrt(worst.min(axis=1) * worst.max(axis=1))  # over the tolerance: of each triangle
        with np.errstate(over="ignore", invalid="ignore"):
            while (worst > tolerance).sum() + len(worst) > most or (
                np.maximum(parts / tolerance, 1.0).sum() > _SURE * most
            ):
                tolerance *= 2.0
        return tolerance

    def reach(self, net: Array, tolerance: float, most: int) -> bool:
        """Split until no edge is off its patch by more than so much; return whether `most` triangles were enough."""
        while True:
            edge, number = self._edges()
            off = np.zeros(len(number))
            np.maximum.at(off, edge, self._off(net))
            # the middle of a triangle is off by 4/3 of its edges' error
            self.left = float(off.max(initial=0.0)) * 4.0 / 3.0
            split = off * (4.0 / 3.0) > tolerance
            if not split.any():
                return True
            if len(self.triangles) + int(split[edge].sum()) > most:
                return False
            self._split(split[edge].reshape(-1, 3), edge, split, number)

    def _edges(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the number of each triangle's edges, shape (3 t,), and the first triangle edge of each number."""
        ends = self._merged[self.triangles]
        pair = np.sort(np.stack([ends, ends[:, [1, 2, 0]]], axis=2).reshape(-1, 2), axis=1)
        key = pair[:, 0] * np.int64(len(self._merged)) + pair[:, 1]
        _, first, number = np.unique(key, return_index=True, return_inverse=True)
        return number.reshape(-1), first

    def _off(self, net: Array) -> Array:
        """Return how far each triangle's edges are off their patches, square to it [m], shape (3 t,)."""
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
        """Split the marked edges, shape (t, 3), in their middles, and the triangles that have them."""
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
            # turned so that the first edge is split and, of two, the last one is not
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
    """Return points on patches [m], shape (n, 3)."""
    out = np.zeros((len(patch), 3))
    for control in range(10):  # not all at once: the control points of each would take ten times the memory
        out += table[:, control, None] * net[patch, control]
    return out


def _corner_normals(mesh: Mesh, normals: NDArray[np.floating] | None, where: str) -> Array:
    if normals is None:
        return corner_normals(mesh)
    try:
        given = np.asarray(normals, np.float64)
    except (TypeError, ValueError) as error:  # text, or rows of differing length
        raise DermisError("the normals are no numbers", where=where) from error
    if given.shape == mesh.vertices.shape:
        given = given[mesh.triangles]
    if given.shape != (len(mesh.triangles), 3, 3) or not np.isfinite(given).all():
        limit = f"finite, {(len(mesh.triangles), 3, 3)} or {mesh.vertices.shape}"
        raise DermisError("the normals do not fit the mesh", where=where, value=given.shape, limit=limit)
    return np.asarray(given / np.maximum(np.linalg.norm(given, axis=2), 1e-300)[..., None])


SHARP = np.pi / 6  # [rad] 30 degrees, where Blender's Shade Auto Smooth begins an edge


def corner_normals(mesh: Mesh, sharp: float = SHARP) -> Array:
    """Return unit normals of each triangle's corners, shape (T, 3, 3).

    Faces about a vertex that hang together by edges flatter than `sharp` have one normal there: the mean of theirs,
    weighted by their angles. A vertex normal is exact to second order on a smooth surface.

    Args:
        sharp: angle between faces from which on their edge is one [rad].
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

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
    ones = np.ones(2 * len(triangle), bool)
    joined = coo_array((ones, (np.concatenate(here), np.concatenate(there))), shape=(corners.size,) * 2)
    count, group = connected_components(joined, directed=False)
    summed = np.zeros((count, 3))
    weighted = (angle[..., None] * face[:, None, :]).reshape(-1, 3)
    for axis in range(3):
        summed[:, axis] = np.bincount(group, weighted[:, axis], minlength=count)
    summed /= np.maximum(np.linalg.norm(summed, axis=1), 1e-300)[:, None]
    return np.asarray(summed[group].reshape(-1, 3, 3))

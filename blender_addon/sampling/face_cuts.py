"""How Blender cuts faces into triangles while they bend; read again only for faces that may be cut otherwise now."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import bpy
import numpy as np
from numpy.typing import NDArray

ROUNDING = 32 * 2.0**-24
"""Of the products below: each is off by less than 11 roundings of single precision, here and in Blender."""

AT_ONCE = 8192
"""Faces that are looked at in one go: numpy's own price is shared by many, and processors keep them at hand."""


def triangle_loops(mesh: bpy.types.Mesh) -> NDArray[np.int32]:
    """Return Blender's triangulation by face corners, shape (T, 3)."""
    mesh.calc_loop_triangles()
    out = np.empty((len(mesh.loop_triangles), 3), np.int32)
    mesh.loop_triangles.foreach_get("loops", out.ravel())
    return out


class FaceCuts:
    """The triangles of a mesh whose vertices move, as Blender cuts its faces at each moment.

    Blender cuts a quad from its first corner to its third unless the normals of these triangles point against each
    other. It cuts a convex face of more corners always alike. Both can be told from the vertices, and much faster than
    Blender hands out its triangles. All other faces, and those where rounding decides, are read again each time.

    Args:
        mesh: evaluated. corners: vertices of the face corners, shape (loops,). positions: of vertices, shape (V, 3).

    Attributes:
        loops: the triangles by face corners, shape (T, 3); another array when one of them changes.
    """

    def __init__(self, mesh: bpy.types.Mesh, corners: NDArray[np.int32], positions: NDArray[np.float32]) -> None:
        self.loops = triangle_loops(mesh)
        self._corners = corners
        self._groups: list[NDArray[np.intp]] = []  # vertices of the faces of a size, shape (size, n)
        if len(corners) == 3 * len(mesh.polygons):
            return
        sizes, self._starts = (np.empty(len(mesh.polygons), np.int32) for _ in range(2))
        mesh.polygons.foreach_get("loop_total", sizes)
        mesh.polygons.foreach_get("loop_start", self._starts)
        first = np.cumsum(sizes - 2) - (sizes - 2)  # triangle of a face
        order = []
        for size in np.unique(sizes[sizes > 3]).tolist():
            own = np.flatnonzero(sizes == size)
            order.append(own)
            self._groups.append(corners[self._starts[own] + np.arange(size)[:, None]].astype(np.intp))
        faces = np.concatenate(order)
        self._first, self._count = first[faces], sizes[faces] - 2
        with np.errstate(all="ignore"):
            self._kinds = [_kinds(*turns)[0] for turns in self._turns([positions])]

    def vertices(self, loops: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return triangles by vertices that are given by face corners, shape (T, 3)."""
        return self._corners[loops]

    def follow(
        self, places: Sequence[NDArray[np.float32]], mesh: bpy.types.Mesh | None = None
    ) -> list[NDArray[np.int32]]:
        """Return the `loops` of the same faces at other positions, one after the other.

        Args:
            places: positions of the vertices, each of shape (V, 3).
            mesh: the evaluated one, where it is at the only one of the places; without it one is made where needed.
        """
        if not self._groups:
            return [self.loops] * len(places)
        out = []
        step = max(1, AT_ONCE // len(self._first))
        made = None
        try:
            for start in range(0, len(places), step):
                part = places[start : start + step]
                with np.errstate(all="ignore"):  # NaN is no known kind
                    turns = list(self._turns(part))
                    pairs = zip(self._kinds, turns, strict=True)
                    if all((kinds * turn > least).all() for kinds, (turn, least) in pairs):  # the usual case
                        out += [self.loops] * len(part)
                        continue
                    now = [_kinds(*each) for each in turns]
                series = np.concatenate([np.concatenate(self._kinds)[None], np.concatenate(now, axis=1)])
                self._kinds = [kinds[-1] for kinds in now]
                doubtful = (series[1:] != series[:-1]) | (series[1:] == 0)
                for k, any_here in enumerate(doubtful.any(axis=1).tolist()):
                    if any_here and mesh is None:
                        made = self._made(len(part[k])) if made is None else made
                        made.vertices.foreach_set("co", part[k].reshape(-1))
                        made.update()
                    if any_here:
                        self._read(doubtful[k], made if mesh is None else mesh)
                    out.append(self.loops)
        finally:
            if made is not None:
                bpy.data.meshes.remove(made)
        return out

    def _made(self, vertices: int) -> bpy.types.Mesh:
        """Return a new mesh of these faces and so many vertices, which the caller removes."""
        mesh = bpy.data.meshes.new("Dermis")
        mesh.vertices.add(vertices)
        mesh.loops.add(len(self._corners))
        mesh.polygons.add(len(self._starts))
        mesh.loops.foreach_set("vertex_index", self._corners)
        mesh.polygons.foreach_set("loop_start", self._starts)
        return mesh

    def _read(self, faces: NDArray[np.bool_], mesh: bpy.types.Mesh) -> None:
        """Take the triangles of some faces from a mesh."""
        first, count = self._first[faces], self._count[faces]
        rows = np.repeat(first - np.cumsum(count) + count, count) + np.arange(count.sum())
        if 3 * len(rows) > len(self.loops):  # one by one takes three times as long
            now = triangle_loops(mesh)[rows]
        else:
            mesh.calc_loop_triangles()
            now = np.array([mesh.loop_triangles[row].loops[:] for row in rows.tolist()], np.int32)
        if not np.array_equal(now, self.loops[rows]):
            self.loops = self.loops.copy()
            self.loops[rows] = now

    def _turns(
        self, places: Sequence[NDArray[np.float32]]
    ) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
        """Yield `_quads` or `_convex` of the faces of each size above 3, at each place."""
        axes = np.ascontiguousarray(np.concatenate(places).T).reshape(3, len(places), -1)
        for own in self._groups:
            yield (_quads if len(own) == 4 else _convex)(axes.take(own, axis=2, mode="wrap"))


def _kinds(turn: NDArray[np.float32], least: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a number for each face: while it is not 0 and stays, so does the cut."""
    return np.where(np.abs(turn) > least, np.sign(turn), np.float32(0))


def _quads(points: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return how much the halves of quads face the same way, negative for against each other, and the rounding bound.

    Args:
        points: shape (3, m, 4, n).

    Returns:
        The numbers, and from what size on their signs are sure, each of shape (m, n).
    """
    sides = points[:, :, 1:] - points[:, :, :1]
    normals = _cross(sides[:, :, :2], sides[:, :, 1:])  # of the halves
    lengths, heights = _lengths(sides), _lengths(normals)
    least = lengths[:, 0] * heights[:, 1] + lengths[:, 2] * heights[:, 0]
    return _dot(normals[:, :, 0], normals[:, :, 1]), ROUNDING * lengths[:, 1] * least


def _convex(points: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the least turn of faces along their normal, 0 for one backwards, and from what size on it is sure.

    Args:
        points: shape (3, m, size, n).
    """
    size = points.shape[2]
    spokes = points[:, :, 1:] - points[:, :, :1]
    halves = _cross(spokes[:, :, :-1], spokes[:, :, 1:])
    normal = halves.sum(axis=2, keepdims=True)
    normal = normal / _lengths(normal)
    sides = np.roll(points, -1, axis=2) - points
    turns = _dot(_cross(np.roll(sides, 1, axis=2), sides), normal)
    least = np.minimum(turns.min(axis=1), _dot(halves, normal).min(axis=1))
    reach = np.abs(spokes).max(axis=(0, 2))
    # Blender turns the points themselves into the plane of the face, so rounding grows with how far away they are.
    far = np.abs(points).max(axis=(0, 2))
    return np.maximum(least, 0), size * ROUNDING * reach * far


def _cross(a: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.float32]:
    out = np.empty_like(a)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(a[j], b[k], out=out[i])
        out[i] -= a[k] * b[j]
    return out


def _lengths(a: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(np.sqrt(_dot(a, a)))


def _dot(a: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.float32]:
    out = a[0] * b[0]
    out += a[1] * b[1]
    out += a[2] * b[2]
    return out

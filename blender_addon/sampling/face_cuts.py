"""Follow how Blender cuts faces into triangles while their vertices move.

Triangles are read again only of faces that may be cut differently.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import bpy
import numpy as np
from numpy.typing import NDArray

ROUNDING = 32 * 2.0**-24
"""[-] Relative rounding of the products below. Each is off by less than 11 roundings of single precision here, and as
much in Blender."""

AT_ONCE = 8192
"""[faces] Number checked in one call: it shares the cost of numpy calls, and still fits into the processor's cache."""


def triangle_loops(mesh: bpy.types.Mesh) -> NDArray[np.int32]:
    """Return Blender's triangulation by face corners, shape (T, 3)."""
    mesh.calc_loop_triangles()
    out = np.empty((len(mesh.loop_triangles), 3), np.int32)
    mesh.loop_triangles.foreach_get("loops", out.ravel())
    return out


class FaceCuts:
    """The triangles of a mesh with moving vertices, as Blender cuts its faces.

    Blender cuts a quad from its first corner to its third unless the normals of the two triangles point against each
    other. It always cuts a convex face of more corners in the same manner. Both conditions follow from the vertices, in
    much less time than Blender takes to return its triangles. All other faces, and those for which rounding decides,
    are read again each time.

    Args:
        mesh: the evaluated mesh. corners: vertices of the face corners, shape (loops,).
        positions: positions of the vertices, shape (V, 3).

    Attributes:
        loops: the triangles by face corners, shape (T, 3); another array when one of them changes.
    """

    def __init__(self, mesh: bpy.types.Mesh, corners: NDArray[np.int32], positions: NDArray[np.float32]) -> None:
        self.loops = triangle_loops(mesh)
        self._corners = corners
        self._groups: list[NDArray[np.intp]] = []  # for each size of face, the faces' vertices, shape (size, n)
        if len(corners) == 3 * len(mesh.polygons):
            return
        sizes, self._starts = (np.empty(len(mesh.polygons), np.int32) for _ in range(2))
        mesh.polygons.foreach_get("loop_total", sizes)
        mesh.polygons.foreach_get("loop_start", self._starts)
        first = np.cumsum(sizes - 2) - (sizes - 2)  # index of the first triangle of each face
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
        """Return the vertices of triangles that are given by face corners, (T, 3)."""
        return self._corners[loops]

    def follow(
        self, places: Sequence[NDArray[np.float32]], mesh: bpy.types.Mesh | None = None
    ) -> list[NDArray[np.int32]]:
        """Return the `loops` of the same faces at each of several positions.

        Args:
            places: positions of the vertices, each of shape (V, 3), in the order of time.
            mesh: the evaluated mesh if there is one place only, and it is at that place; without it, a temporary mesh
                is made where one is needed.
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
        """Return a new mesh of these faces with a number of vertices.

        The caller removes it.
        """
        mesh = bpy.data.meshes.new("Dermis")
        mesh.vertices.add(vertices)
        mesh.loops.add(len(self._corners))
        mesh.polygons.add(len(self._starts))
        mesh.loops.foreach_set("vertex_index", self._corners)
        mesh.polygons.foreach_set("loop_start", self._starts)
        return mesh

    def _read(self, faces: NDArray[np.bool_], mesh: bpy.types.Mesh) -> None:
        """Read the triangles of some faces from a mesh."""
        first, count = self._first[faces], self._count[faces]
        rows = np.repeat(first - np.cumsum(count) + count, count) + np.arange(count.sum())
        if 3 * len(rows) > len(self.loops):  # reading triangles singly takes three times as long each
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
        """Yield `_quads` or `_convex` of faces of each size above 3, at places."""
        axes = np.ascontiguousarray(np.concatenate(places).T).reshape(3, len(places), -1)
        for own in self._groups:
            yield (_quads if len(own) == 4 else _convex)(axes.take(own, axis=2, mode="wrap"))


def _kinds(turn: NDArray[np.float32], least: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a number for each face that decides its cut.

    While the number is not 0 and does not change, neither does the cut.
    """
    return np.where(np.abs(turn) > least, np.sign(turn), np.float32(0))


def _quads(points: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the dot products of the normals of quads' halves.

    A product is negative if the halves face against each other.

    Args:
        points: coordinates of the corners of n quads at m places, shape (3, m, 4, n).

    Returns:
        The products, and the rounding bounds above which their signs are certain, each of shape (m, n).
    """
    sides = points[:, :, 1:] - points[:, :, :1]
    normals = _cross(sides[:, :, :2], sides[:, :, 1:])  # of the halves
    lengths, heights = _lengths(sides), _lengths(normals)
    least = lengths[:, 0] * heights[:, 1] + lengths[:, 2] * heights[:, 0]
    return _dot(normals[:, :, 0], normals[:, :, 1]), ROUNDING * lengths[:, 1] * least


def _convex(points: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the least turn at the corners of faces about their normal.

    It is 0 for a face with a turn backwards. The second result is the bound above which the turn is certain. Both have
    shape (m, n).

    Args:
        points: coordinates of the corners of n faces at m places, shape (3, m, size, n).
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
    # Blender rotates the points themselves into the plane of the face, so rounding grows with their distance from the
    # origin.
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

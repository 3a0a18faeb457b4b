"""How Blender cuts faces into triangles while they bend; read again only for faces that may be cut otherwise now."""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

ROUNDING = 32 * 2.0**-24
"""Of the products below: single-precision numbers are multiplied and added at most 16 times here, and in Blender."""


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
        self._groups: list[NDArray[np.int32]] = []  # vertices of the faces of a size, shape (size, n)
        if len(corners) == 3 * len(mesh.polygons):
            return
        sizes, starts = (np.empty(len(mesh.polygons), np.int32) for _ in range(2))
        mesh.polygons.foreach_get("loop_total", sizes)
        mesh.polygons.foreach_get("loop_start", starts)
        first = np.cumsum(sizes - 2) - (sizes - 2)  # triangle of a face
        order = []
        for size in np.unique(sizes[sizes > 3]).tolist():
            own = np.flatnonzero(sizes == size)
            order.append(own)
            self._groups.append(np.ascontiguousarray(corners[starts[own] + np.arange(size)[:, None]]))
        faces = np.concatenate(order)
        self._first, self._count = first[faces], sizes[faces] - 2
        self._kinds = self._kinds_of(positions)

    @property
    def vertices(self) -> NDArray[np.int32]:
        """The triangles by vertices, shape (T, 3)."""
        return self._corners[self.loops]

    def follow(self, mesh: bpy.types.Mesh, positions: NDArray[np.float32]) -> bool:
        """Take the triangles of the same faces at other positions; return whether any has changed."""
        if not self._groups:
            return False
        kinds = self._kinds_of(positions)
        doubtful = (kinds != self._kinds) | (kinds == 0)
        self._kinds = kinds
        if not doubtful.any():
            return False
        first, count = self._first[doubtful], self._count[doubtful]
        rows = np.repeat(first - np.cumsum(count) + count, count) + np.arange(count.sum())
        if 3 * len(rows) > len(self.loops):  # one by one takes three times as long
            now = triangle_loops(mesh)[rows]
        else:
            mesh.calc_loop_triangles()
            now = np.array([mesh.loop_triangles[row].loops[:] for row in rows.tolist()], np.int32)
        if np.array_equal(now, self.loops[rows]):
            return False
        self.loops = self.loops.copy()
        self.loops[rows] = now
        return True

    def _kinds_of(self, positions: NDArray[np.float32]) -> NDArray[np.int8]:
        """Return a number for each face of more than three corners: while it is not 0 and stays, so does the cut."""
        axes = np.ascontiguousarray(positions.T)
        with np.errstate(all="ignore"):  # what is no number is no known kind
            each = [(_quads if len(own) == 4 else _convex)(axes.take(own, axis=1)) for own in self._groups]
        return np.concatenate(each)


def _quads(points: NDArray[np.float32]) -> NDArray[np.int8]:
    """Return 1 for quads whose halves face the same way, -1 for the others; points have shape (3, 4, n)."""
    a, b, c = (points[:, k] - points[:, 0] for k in (1, 2, 3))
    bb = _dot(b, b)
    same = _dot(a, b) * _dot(b, c) - _dot(a, c) * bb  # (a x b) . (b x c), by Binet and Cauchy
    sure = np.abs(same) > ROUNDING * np.sqrt(_dot(a, a) * _dot(c, c)) * bb
    return np.where(sure, np.sign(same), 0).astype(np.int8)


def _convex(points: NDArray[np.float32]) -> NDArray[np.int8]:
    """Return 1 for faces that are strictly convex along their normal; points have shape (3, size, n)."""
    size = points.shape[1]
    spokes = points[:, 1:] - points[:, :1]
    halves = _cross(spokes[:, :-1], spokes[:, 1:])
    normal = halves.sum(axis=1)
    normal = normal / np.sqrt(_dot(normal, normal))
    sides = np.roll(points, -1, axis=1) - points
    turns = _dot(_cross(np.roll(sides, 1, axis=1), sides), normal[:, None])
    least = np.minimum(turns.min(axis=0), _dot(halves, normal[:, None]).min(axis=0))
    reach = np.abs(spokes).max(axis=(0, 1))
    # Blender turns the points themselves into the plane of the face, so rounding grows with how far away they are.
    far = np.abs(points).max(axis=(0, 1))
    return (least > size * ROUNDING * reach * far).astype(np.int8)


def _cross(a: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _dot(a: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])

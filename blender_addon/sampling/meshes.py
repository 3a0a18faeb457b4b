"""Evaluated surfaces: read fast, in metres, and the same object again where nothing changed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .._core import Finding, core

SURFACE_TYPES = {"MESH", "CURVE", "SURFACE", "FONT", "META"}
"""Types of object that have a surface."""


@contextmanager
def evaluated_mesh(evaluated: bpy.types.Object) -> Iterator[bpy.types.Mesh | None]:
    """Give the mesh of an evaluated object of any type that has one; None for the others.

    A mesh in edit mode keeps no arrays, and a curve has no mesh at all: for those Blender makes one, freed here.
    """
    if evaluated.type not in SURFACE_TYPES:
        yield None
        return
    data = evaluated.data
    if isinstance(data, bpy.types.Mesh) and "position" in data.attributes:
        yield data
        return
    try:
        yield evaluated.to_mesh()
    finally:
        evaluated.to_mesh_clear()


def positions(mesh: bpy.types.Mesh) -> NDArray[np.float32]:
    """Return vertex positions in scene units, shape (V, 3)."""
    layer = mesh.attributes.get("position")
    if layer is None or len(layer.data) == 0:
        return np.zeros((0, 3), np.float32)
    raw = np.empty((len(layer.data), 3), np.float32)
    layer.data.foreach_get("vector", raw.ravel())
    return raw


def triangles(mesh: bpy.types.Mesh, of: str = "vertices") -> NDArray[np.int32]:
    """Return Blender's triangulation by vertices, or by 'loops' (face corners), shape (T, 3)."""
    mesh.calc_loop_triangles()
    out = np.empty((len(mesh.loop_triangles), 3), np.int32)
    mesh.loop_triangles.foreach_get(of, out.ravel())
    return out


def normals(mesh: bpy.types.Mesh) -> NDArray[np.float32]:
    """Return the normals that Blender shades face corners with: smooth, flat, sharp or custom, shape (loops, 3)."""
    out = np.empty((len(mesh.loops), 3), np.float32)
    mesh.corner_normals.foreach_get("vector", out.ravel())
    return out


@dataclass
class _Last:
    raw: NDArray[np.float32]
    corners: NDArray[np.int32]
    starts: int
    unit: float
    mesh: Any
    faces: NDArray[np.int32]
    shading: Shading | None


@dataclass
class Shading:
    """What a curved surface is made of, and the surface.

    Attributes:
        tolerance: that it was made with [m]. loops: of the triangles' corners, shape (T, 3).
        normals: of the loops, shape (loops, 3). curved: the surface.
    """

    tolerance: float
    loops: NDArray[np.int32]
    normals: NDArray[np.float32]
    curved: Any


class MeshReader:
    """Reads surfaces and hands out the same `Mesh` while positions stay, the same triangles while topology stays."""

    def __init__(self) -> None:
        self._last: dict[tuple[int, bool], _Last] = {}

    def read(
        self, evaluated: bpy.types.Object, unit: float, mirrored: bool = False, tolerance: float | None = None
    ) -> Any:
        """Return the evaluated surface of an object in its own space.

        Args:
            unit: metres in a scene unit.
            mirrored: reflect X, for objects of negative scale, whose matrices lose the reflection in turn.
            tolerance: how far it may be off the curved surface that its shading shows [m]; None for its flat faces.
        """
        with evaluated_mesh(evaluated) as mesh:
            if mesh is None:
                return core.scene.tactile_scene.Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))
            raw = positions(mesh)
            key = (evaluated.original.session_uid, mirrored)  # evaluated copies all have uid 0
            last = self._last.get(key)
            corners = _corners(mesh)
            same = (
                last is not None
                and last.unit == unit
                and last.starts == len(mesh.polygons)
                and len(last.raw) == len(raw)
                and np.array_equal(last.corners, corners)
            )
            known = last.shading if same else None  # type: ignore[union-attr]
            shown = None if tolerance is None or not np.isfinite(raw).all() else normals(mesh)
            if same and np.array_equal(last.raw, raw) and _alike(known, shown, tolerance):  # type: ignore[union-attr]
                return last.mesh  # type: ignore[union-attr]
            # The first triangulation holds while the faces do: Blender may split a bending quad along its other
            # diagonal from one frame to the next, which would look like a change of topology.
            faces = last.faces if same else _faces(mesh, mirrored)  # type: ignore[union-attr]
            made = core.scene.tactile_scene.Mesh(to_metres(raw, unit, mirrored), faces)
            shading = None
            if shown is not None and tolerance is not None and len(faces):
                loops = known.loops if known is not None else _faces(mesh, mirrored, "loops")
                shading = _curved(made, loops, shown, mirrored, tolerance, known)
                made = shading.curved.mesh
            self._last[key] = _Last(raw, corners, len(mesh.polygons), unit, made, faces, shading)
            return made

    def curved(self, evaluated: bpy.types.Object, mirrored: bool = False) -> Any | None:
        """Return the `CurvedMesh` that an object was read as last; None where it was read flat."""
        last = self._last.get((evaluated.original.session_uid, mirrored))
        return None if last is None or last.shading is None else last.shading.curved

    def clear(self) -> None:
        """Forget every surface."""
        self._last.clear()


def to_metres(raw: NDArray[Any], unit: float, mirrored: bool) -> NDArray[np.float64]:
    """Return positions in metres and, if asked, with X reflected."""
    out = raw.astype(np.float64)
    out *= unit
    if mirrored:
        out[:, 0] *= -1.0
    return out


def zero_area_finding(mesh: Any, name: str) -> Any | None:
    """Report faces without area, which cannot tell where outside is."""
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    longest = np.max(
        [np.linalg.norm(b - a, axis=1), np.linalg.norm(c - b, axis=1), np.linalg.norm(a - c, axis=1)], axis=0
    )
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    # Against the square of the longest edge, a face this thin is a line in single precision.
    bad = area <= 1e-7 * longest**2
    if not bad.any():
        return None
    return Finding(
        "warning",
        "zero-area",
        "faces without area",
        where=f"object '{name}'",
        value=int(bad.sum()),
        limit="none",
        remedy="Use Mesh > Clean Up > Degenerate Dissolve",
        count=int(bad.sum()),
    )


def _corners(mesh: bpy.types.Mesh) -> NDArray[np.int32]:
    out = np.empty(len(mesh.loops), np.int32)
    layer = mesh.attributes.get(".corner_vert")
    if layer is not None:
        layer.data.foreach_get("value", out)
    else:
        mesh.loops.foreach_get("vertex_index", out)
    return out


def _alike(known: Shading | None, shown: NDArray[np.float32] | None, tolerance: float | None) -> bool:
    """Return whether a kept surface is what the same vertices would be made to again."""
    if known is None or shown is None:
        return known is None and shown is None
    return known.tolerance == tolerance and np.array_equal(known.normals, shown)


def _curved(
    flat: Any,
    loops: NDArray[np.int32],
    shown: NDArray[np.float32],
    mirrored: bool,
    tolerance: float,
    known: Shading | None,
) -> Shading:
    """Curve a surface by its shading, with the triangles that it had where that was the same way."""
    each = to_metres(shown, 1.0, mirrored)[loops]
    if known is not None and known.tolerance == tolerance:
        made = known.curved.moved(flat.vertices, each)
    else:
        made = core.surface.curved.curved_mesh(flat, each, tolerance=tolerance)
    return Shading(tolerance, loops, shown, made)


def _faces(mesh: bpy.types.Mesh, mirrored: bool, of: str = "vertices") -> NDArray[np.int32]:
    faces = triangles(mesh, of)
    return np.ascontiguousarray(faces[:, ::-1]) if mirrored else faces

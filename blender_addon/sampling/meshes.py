"""Evaluated surfaces: read fast, in metres, and the same object again where nothing changed."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

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


@dataclass(frozen=True, eq=False)
class Topology:
    """The triangles of a surface; the same object while they stay."""

    faces: NDArray[np.int32]

    @cached_property
    def reflected(self) -> NDArray[np.int32]:
        """The triangles in the other sense, for vertices that were reflected."""
        return np.ascontiguousarray(self.faces[:, ::-1])


@dataclass(frozen=True, eq=False)
class Geometry:
    """A surface as Blender evaluated it, in scene units; the same object while nothing of it changes.

    Attributes:
        positions: of the vertices, shape (V, 3).
        topology: the triangles.
        normals: that Blender shades the triangles' corners with, shape (T, 3, 3); None where nobody asked.
        smooth: some of it shades smooth.
    """

    positions: NDArray[Any]
    topology: Topology
    normals: NDArray[np.float32] | None = None
    smooth: bool = False


@dataclass(frozen=True, eq=False)
class _Last:
    geometry: Geometry
    corners: NDArray[np.int32]
    polygons: int
    loops: NDArray[np.int32] | None


class MeshReader:
    """Reads surfaces and hands out the same `Mesh` while positions stay, the same triangles while topology stays."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget every surface."""
        self._last: dict[Hashable, _Last] = {}
        self._made: WeakKeyDictionary[Geometry, dict[tuple[Any, ...], tuple[Any, Any]]] = WeakKeyDictionary()
        self._curved: WeakKeyDictionary[Topology, dict[tuple[bool, float], Any]] = WeakKeyDictionary()

    def read(
        self, evaluated: bpy.types.Object, unit: float, mirrored: bool = False, tolerance: float | None = None
    ) -> Any:
        """Return the evaluated surface of an object in its own space, see `surface`."""
        geometry = self.geometry_of(evaluated, tolerance is not None)
        return self.surface(geometry, unit, mirrored, tolerance)

    def geometry_of(self, evaluated: bpy.types.Object, shaded: bool) -> Geometry | None:
        """Return what an object is evaluated to; None where its type has no surface.

        Args:
            shaded: with the normals that it is shaded with.
        """
        with evaluated_mesh(evaluated) as mesh:
            if mesh is None:
                return None
            return self.geometry(evaluated.original.session_uid, mesh, shaded)  # evaluated copies all have uid 0

    def geometry(self, key: Hashable, mesh: bpy.types.Mesh, shaded: bool) -> Geometry:
        """Return what an evaluated mesh holds: the same object as the last one of this key, where it is the same."""
        raw, corners, polygons = positions(mesh), _corners(mesh), len(mesh.polygons)
        last = self._last.get(key)
        if last is not None and not (
            last.polygons == polygons
            and len(last.geometry.positions) == len(raw)
            and np.array_equal(last.corners, corners)
        ):
            last = None
        # The first triangulation holds while the faces do: Blender may split a bending quad along its other
        # diagonal from one frame to the next, which would look like a change of topology.
        topology = Topology(triangles(mesh)) if last is None else last.geometry.topology
        loops = None if last is None else last.loops
        known = None if last is None else last.geometry
        shown = None
        if shaded:
            loops = triangles(mesh, "loops") if loops is None else loops
            shown = normals(mesh)[loops]
        if (
            known is not None
            and np.array_equal(known.positions, raw)
            and (shown is None or (known.normals is not None and np.array_equal(known.normals, shown)))
        ):
            return known
        made = Geometry(raw, topology, shown, mesh.normals_domain != "FACE")
        self._last[key] = _Last(made, corners, polygons, loops)
        return made

    def surface(
        self, geometry: Geometry | None, unit: float, mirrored: bool = False, tolerance: float | None = None
    ) -> Any:
        """Return a surface in its own space.

        Args:
            geometry: None where there is none.
            unit: metres in a scene unit.
            mirrored: reflect X, for objects of negative scale, whose matrices lose the reflection in turn.
            tolerance: how far it may be off the curved surface that its shading shows [m]; None for its flat faces.
        """
        return self._surface(geometry, unit, mirrored, tolerance)[0]

    def curved(
        self, geometry: Geometry | None, unit: float, mirrored: bool = False, tolerance: float | None = None
    ) -> Any | None:
        """Return the `CurvedMesh` that the `surface` of the same arguments is of; None where it is flat."""
        return self._surface(geometry, unit, mirrored, tolerance)[1]

    def _surface(
        self, geometry: Geometry | None, unit: float, mirrored: bool, tolerance: float | None
    ) -> tuple[Any, Any]:
        if geometry is None:
            return core.scene.tactile_scene.Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32)), None
        made = self._made.setdefault(geometry, {})
        key = (unit, mirrored, tolerance)
        if key not in made:
            made[key] = self._surface_anew(geometry, unit, mirrored, tolerance)
        return made[key]

    def _surface_anew(
        self, geometry: Geometry, unit: float, mirrored: bool, tolerance: float | None
    ) -> tuple[Any, Any]:
        topology = geometry.topology
        faces = topology.reflected if mirrored else topology.faces
        flat = core.scene.tactile_scene.Mesh(to_metres(geometry.positions, unit, mirrored), faces)
        if tolerance is None or geometry.normals is None or not len(faces) or not np.isfinite(flat.vertices).all():
            return flat, None
        each = to_metres(geometry.normals.reshape(-1, 3), 1.0, mirrored).reshape(-1, 3, 3)
        each = each[:, ::-1] if mirrored else each
        known = self._curved.setdefault(topology, {})
        last = known.get((mirrored, tolerance))
        if last is not None:
            made = last.moved(flat.vertices, each)
        else:
            made = core.surface.curved.curved_mesh(flat, each, tolerance=tolerance)
        known[mirrored, tolerance] = made
        return made.mesh, made


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

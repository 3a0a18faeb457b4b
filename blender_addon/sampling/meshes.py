"""Evaluated surfaces: read fast, in metres, and the same object again where nothing changed."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .._core import Finding, core
from .face_cuts import FaceCuts, triangle_loops

SURFACE_TYPES = {"MESH", "CURVE", "SURFACE", "FONT", "META"}
"""Types of object that have a surface."""


class EvaluatedMesh:
    """A context that gives the mesh of an evaluated object of any type that has one; None for the others.

    A mesh in edit mode keeps no arrays, and a curve has no mesh at all: for those Blender makes one, freed here.
    It is entered for every sample, and a generator would take five times as long.
    """

    def __init__(self, evaluated: bpy.types.Object) -> None:
        self._evaluated = evaluated
        self._made = False

    def __enter__(self) -> bpy.types.Mesh | None:
        data = self._evaluated.data
        if isinstance(data, bpy.types.Mesh) and "position" in data.attributes:
            return data
        if self._evaluated.type not in SURFACE_TYPES:
            return None
        self._made = True
        return self._evaluated.to_mesh()

    def __exit__(self, *_: object) -> None:
        if self._made:
            self._evaluated.to_mesh_clear()


def positions(mesh: bpy.types.Mesh) -> NDArray[np.float32]:
    """Return vertex positions in scene units, shape (V, 3)."""
    layer = mesh.attributes.get("position")
    values = None if layer is None else layer.data
    raw = np.empty(0 if values is None else 3 * len(values), np.float32)
    if values is not None and len(raw):
        values.foreach_get("vector", raw)
    return raw.reshape(-1, 3)


def triangles(mesh: bpy.types.Mesh) -> NDArray[np.int32]:
    """Return Blender's triangulation by vertices, shape (T, 3)."""
    return _corners(mesh, np.empty(len(mesh.loops), np.int32))[triangle_loops(mesh)]


def normals(mesh: bpy.types.Mesh) -> NDArray[np.float32]:
    """Return the normals that Blender shades face corners with: smooth, flat, sharp or custom, shape (loops, 3)."""
    out = np.empty((len(mesh.loops), 3), np.float32)
    mesh.corner_normals.foreach_get("vector", out.ravel())
    return out


@dataclass(frozen=True, eq=False)
class Topology:
    """The triangles of a surface; the same object while they stay.

    Attributes:
        faces: shape (T, 3).
        curved: the last curved surface of these triangles, for each reflection and tolerance.
    """

    faces: NDArray[np.int32]
    curved: dict[tuple[bool, float], Any] = field(default_factory=dict)

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
        smooth: some of it shades smooth; False where nobody asked.
        made: the surfaces in metres that were made of it, see `MeshReader.surface`.
    """

    positions: NDArray[Any]
    topology: Topology
    normals: NDArray[np.float32] | None = None
    smooth: bool = False
    made: dict[tuple[Any, ...], tuple[Any, Any]] = field(default_factory=dict)


@dataclass
class _Last:
    """What was read last of a key: while counts of vertices and faces and its form stay, so do its faces."""

    counts: tuple[int, int]
    form: tuple[NDArray[np.int32], ...]
    cuts: FaceCuts
    topology: Topology
    geometry: Geometry | None = None


class MeshReader:
    """Reads surfaces and hands out the same `Mesh` while positions stay, and the same triangles while Blender's do."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget every surface."""
        self._last: dict[Hashable, _Last] = {}
        self._buffers: dict[int, NDArray[np.int32]] = {}  # new memory would take longer than all of the comparison

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
        with EvaluatedMesh(evaluated) as mesh:
            if mesh is None:
                return None
            return self.geometry(evaluated.original.session_uid, mesh, shaded)  # evaluated copies all have uid 0

    def geometry(self, key: Hashable, mesh: bpy.types.Mesh, shaded: bool) -> Geometry:
        """Return what an evaluated mesh holds: the same object as the last one of this key, where it is the same."""
        raw = positions(mesh)
        counts, form = (len(raw), len(mesh.polygons)), self._form(mesh)
        last = self._last.get(key)
        if last is None or last.counts != counts or not _alike(last.form, form):
            form = [part.copy() for part in form]
            cuts = FaceCuts(mesh, form[0], raw)
            last = self._last[key] = _Last(counts, tuple(form), cuts, Topology(cuts.vertices))
        known, shown = last.geometry, None
        stays = known is not None and bool((known.positions == raw).all())
        if known is not None and not stays and last.cuts.follow(mesh, raw):
            last.topology = Topology(last.cuts.vertices)
        if shaded:
            shown = normals(mesh)[last.cuts.loops]
        if (
            known is not None
            and stays
            and (shown is None or (known.normals is not None and np.array_equal(known.normals, shown)))
        ):
            return known
        made = last.geometry = Geometry(raw, last.topology, shown, shaded and mesh.normals_domain != "FACE")
        return made

    def _form(self, mesh: bpy.types.Mesh) -> list[NDArray[np.int32]]:
        """Return what decides of which faces a mesh is made, to be compared: no other faces have the same.

        Face corners in a row may be faces of 3 and 5 or of 5 and 3 corners. The edge of each face's last corner leads
        back to its first one, so the edges tell where faces end. Blender hands these out in microseconds, and the
        faces' sizes 300 times as slowly. The arrays hold until the next mesh is read.
        """
        corners = [_corners(mesh, self._buffer(0, len(mesh.loops)))]
        if len(mesh.loops) == 3 * len(mesh.polygons):
            return corners
        own, edges = mesh.attributes.get(".corner_edge"), mesh.attributes.get(".edge_verts")
        if own is None or edges is None:
            sizes = self._buffer(1, len(mesh.polygons))
            mesh.polygons.foreach_get("loop_total", sizes)
            return [*corners, sizes]
        each, ends = self._buffer(1, len(own.data)), self._buffer(2, 2 * len(edges.data))
        own.data.foreach_get("value", each)
        edges.data.foreach_get("value", ends)
        return [*corners, each, ends]

    def _buffer(self, number: int, size: int) -> NDArray[np.int32]:
        kept = self._buffers.get(number)
        if kept is None or len(kept) < size:
            kept = self._buffers[number] = np.empty(size, np.int32)
        return kept[:size]

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
        key = (unit, mirrored, tolerance)
        made = geometry.made.get(key)
        if made is None:
            made = geometry.made[key] = self._surface_anew(geometry, unit, mirrored, tolerance)
        return made

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
        last = topology.curved.get((mirrored, tolerance))
        if last is not None:
            made = last.moved(flat.vertices, each)
        else:
            made = core.surface.curved.curved_mesh(flat, each, tolerance=tolerance)
        topology.curved[mirrored, tolerance] = made
        return made.mesh, made


def to_metres(raw: NDArray[Any], unit: float, mirrored: bool) -> NDArray[np.float64]:
    """Return positions in metres and, if asked, with X reflected."""
    out: NDArray[np.float64] = np.multiply(raw, unit, dtype=np.float64)
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


def _alike(one: Sequence[NDArray[np.int32]], other: Sequence[NDArray[np.int32]]) -> bool:
    return len(one) == len(other) and all(map(np.array_equal, one, other))


def _corners(mesh: bpy.types.Mesh, out: NDArray[np.int32]) -> NDArray[np.int32]:
    """Read the vertices of all face corners, shape (loops,)."""
    layer = mesh.attributes.get(".corner_vert")
    if layer is not None:
        layer.data.foreach_get("value", out)
    else:
        mesh.loops.foreach_get("vertex_index", out)
    return out

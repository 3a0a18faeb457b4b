"""Read evaluated surfaces in metres.

An unchanged surface is returned as the same object.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import groupby
from operator import attrgetter
from typing import Any, NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

from .._core import Finding, core
from .face_cuts import FaceCuts, triangle_loops

_FORM = (".corner_vert", ".corner_edge", ".edge_verts")

SURFACE_TYPES = {"MESH", "CURVE", "SURFACE", "FONT", "META"}
"""Types of object that have a surface."""


class EvaluatedMesh:
    """Context manager of the mesh of an evaluated object.

    It gives None for objects of a type without a surface. A mesh in edit mode has no arrays, and a curve has no mesh at
    all: Blender makes a mesh of them, which is freed on exit. The context is entered at every sample; as a generator
    it would take five times as long.
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
    return np.empty((0, 3), np.float32) if layer is None else _vectors(layer.data)


def vertices_of(evaluated: bpy.types.Object) -> NDArray[np.float32]:
    """Return vertex positions of an evaluated object of any type.

    They are in scene units, shape (V, 3).
    """
    data = evaluated.data
    layer = data.attributes.get("position") if isinstance(data, bpy.types.Mesh) else None
    if layer is not None:  # the usual case
        return _vectors(layer.data)
    with EvaluatedMesh(evaluated) as mesh:
        return np.empty((0, 3), np.float32) if mesh is None else positions(mesh)


def triangles(mesh: bpy.types.Mesh) -> NDArray[np.int32]:
    """Return Blender's triangulation by vertices, shape (T, 3)."""
    return _corners(mesh)[triangle_loops(mesh)]


def normals(mesh: bpy.types.Mesh) -> NDArray[np.float32]:
    """Return the normals that Blender shades face corners with.

    Their shape is (loops, 3). They may be smooth, flat, sharp or custom.
    """
    out = np.empty((len(mesh.loops), 3), np.float32)
    mesh.corner_normals.foreach_get("vector", out.ravel())
    return out


@dataclass(frozen=True, eq=False)
class Topology:
    """The triangles of a surface; the same object while they do not change.

    Attributes:
        faces: shape (T, 3).
        curved: the last curved surface of these triangles, for each reflection and tolerance.
    """

    faces: NDArray[np.int32]
    curved: dict[tuple[bool, float], Any] = field(default_factory=dict)

    @cached_property
    def reflected(self) -> NDArray[np.int32]:
        """The triangles in the opposite orientation, for reflected vertices."""
        return np.ascontiguousarray(self.faces[:, ::-1])


@dataclass(frozen=True, eq=False)
class Geometry:
    """A surface as Blender evaluated it, in scene units.

    It is the same object while nothing of it changes.

    Attributes:
        positions: positions of the vertices, shape (V, 3).
        topology: the triangles.
        normals: the normals that Blender shades the triangles' corners with, shape (T, 3, 3); None if not read.
        smooth: whether some of its faces shade smooth; False if normals were not read.
        made: the surfaces in metres that were made of it, see `MeshReader.surface`.
    """

    positions: NDArray[Any]
    topology: Topology
    normals: NDArray[np.float32] | None = None
    smooth: bool = False
    made: dict[tuple[Any, ...], tuple[Any, Any]] = field(default_factory=dict)


@dataclass(eq=False)
class _Form:
    """The faces of a mesh.

    They are unchanged while the counts of vertices, corners and faces, and the bytes `form`, are.
    """

    counts: tuple[int, int, int]
    form: bytes
    cuts: FaceCuts


class Look(NamedTuple):
    """The data read from a mesh at a moment.

    Attributes:
        positions: as those of a `Geometry`. form: its faces; the same object while they do not change.
        normals: the normals that Blender shades face corners with, shape (loops, 3); None if not read.
        smooth: as that of a `Geometry`.
    """

    key: Hashable
    positions: NDArray[np.float32]
    form: _Form
    normals: NDArray[np.float32] | None
    smooth: bool


class MeshReader:
    """Reader of evaluated surfaces.

    It returns the same `Mesh` while positions do not change, and the same triangles while Blender's do not. A `Look` is
    read while the object is evaluated. Geometries can be made of many looks at once, which is faster.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget every surface."""
        self._forms: dict[Hashable, _Form] = {}
        self._last: dict[Hashable, tuple[_Form, Geometry]] = {}
        self._buffer = np.empty(0, np.int32)  # kept, because new memory would take longer than the whole comparison

    def read(
        self, evaluated: bpy.types.Object, unit: float, mirrored: bool = False, tolerance: float | None = None
    ) -> Any:
        """Return an evaluated object's surface in its own space, see `surface`."""
        geometry = self.geometry_of(evaluated, tolerance is not None)
        return self.surface(geometry, unit, mirrored, tolerance)

    def geometry_of(self, evaluated: bpy.types.Object, shaded: bool) -> Geometry | None:
        """Return an object's evaluated geometry; None if its type has no surface.

        Args:
            shaded: whether to read the normals that it is shaded with.
        """
        with EvaluatedMesh(evaluated) as mesh:
            if mesh is None:
                return None
            return self.geometry(evaluated.original.session_uid, mesh, shaded)  # evaluated copies all have uid 0

    def look(self, evaluated: bpy.types.Object, shaded: bool) -> Look | None:
        """Return the look from which `geometries` makes an object's geometry."""
        with EvaluatedMesh(evaluated) as mesh:
            return None if mesh is None else self._look(evaluated.original.session_uid, mesh, shaded)

    def geometry(self, key: Hashable, mesh: bpy.types.Mesh, shaded: bool) -> Geometry:
        """Return the geometry of an evaluated mesh.

        It is the last `Geometry` of this key if nothing has changed.
        """
        return self.geometries([self._look(key, mesh, shaded)], mesh)[0]

    def geometries(self, looks: Sequence[Look], mesh: bpy.types.Mesh | None = None) -> list[Geometry]:
        """Return the geometries of one object, in the order of the looks.

        It is the same `Geometry` while nothing changes.

        Args:
            mesh: the mesh of the only look, if it is still evaluated; without it, a mesh is made where one is needed.
        """
        out = []
        for form, same in groupby(looks, key=attrgetter("form")):
            part = list(same)
            last, geometry = self._last.get(part[0].key, (None, None))
            if last is not form:
                geometry = None
            topology = Topology(form.cuts.vertices(form.cuts.loops)) if geometry is None else geometry.topology
            loops, places = form.cuts.loops, [look.positions for look in part]
            stays = geometry is not None and all((geometry.positions == own).all() for own in places)
            cuts = [loops] * len(part) if stays else form.cuts.follow(places, mesh)
            for look, now in zip(part, cuts, strict=True):
                if now is not loops:
                    loops, topology = now, Topology(form.cuts.vertices(now))
                shown = None if look.normals is None else look.normals[loops]
                if geometry is None or not _same(geometry, look.positions, topology, shown):
                    geometry = Geometry(look.positions, topology, shown, look.smooth)
                out.append(geometry)
            self._last[part[0].key] = form, out[-1]
        return out

    def _look(self, key: Hashable, mesh: bpy.types.Mesh, shaded: bool) -> Look:
        raw = positions(mesh)
        counts = len(raw), len(mesh.loops), len(mesh.polygons)
        form, last = self._form(mesh, *counts[1:]), self._forms.get(key)
        if last is None or last.counts != counts or last.form != form:
            cuts = FaceCuts(mesh, np.frombuffer(form, np.int32, counts[1]), raw)
            last = self._forms[key] = _Form(counts, form, cuts)
        if shaded:
            return Look(key, raw, last, normals(mesh), mesh.normals_domain != "FACE")
        return Look(key, raw, last, None, False)

    def _form(self, mesh: bpy.types.Mesh, corners: int, polygons: int) -> bytes:
        """Return bytes that identify the faces of a mesh.

        They begin with the vertices of the face corners. The same corners may belong to a triangle and a pentagon, or
        to a pentagon and a triangle. The edge of a face's last corner leads back to its first corner, so the edges show
        where faces end. Blender returns the edges in microseconds, but takes 300 times as long for the sizes of faces.
        """
        layers = list(map(mesh.attributes.get, _FORM[: 1 if corners == 3 * polygons else 3]))
        if None in layers:
            sizes = np.empty(polygons, np.int32)
            mesh.polygons.foreach_get("loop_total", sizes)
            return _corners(mesh).tobytes() + sizes.tobytes()
        parts = [layer.data for layer in layers]
        size = corners if len(parts) == 1 else 2 * (corners + len(parts[2]))
        if len(self._buffer) < size:
            self._buffer = np.empty(size, np.int32)
        start = 0
        for part, end in zip(parts, (corners, 2 * corners, size), strict=False):
            part.foreach_get("value", self._buffer[start:end])
            start = end
        return self._buffer[:size].tobytes()

    def surface(
        self, geometry: Geometry | None, unit: float, mirrored: bool = False, tolerance: float | None = None
    ) -> Any:
        """Return a surface in its own space.

        Args:
            geometry: the geometry; None gives an empty surface.
            unit: [m] length of a scene unit.
            mirrored: reflect X, for objects of negative scale; the reflection is taken out of their matrices.
            tolerance: [m] largest distance from the curved surface that the shading shows; None for flat faces.
        """
        return self._surface(geometry, unit, mirrored, tolerance)[0]

    def curved(
        self, geometry: Geometry | None, unit: float, mirrored: bool = False, tolerance: float | None = None
    ) -> Any | None:
        """Return the `CurvedMesh` behind the `surface` of the same arguments.

        It is None if that surface is flat.
        """
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


def _same(known: Geometry, places: NDArray[np.float32], topology: Topology, shown: NDArray[np.float32] | None) -> bool:
    """Return whether a surface is unchanged; normals count only where read."""
    return (
        known.topology is topology
        and bool((known.positions == places).all())
        and (shown is None or (known.normals is not None and np.array_equal(known.normals, shown)))
    )


def to_metres(raw: NDArray[Any], unit: float, mirrored: bool) -> NDArray[np.float64]:
    """Return positions in metres and, if asked, with X reflected."""
    out = raw.astype(np.float64)  # four times as fast as a product of this type
    if unit != 1.0:
        out *= unit
    if mirrored:
        out[:, 0] *= -1.0
    return out


def zero_area_finding(mesh: Any, name: str) -> Any | None:
    """Report faces without area: these have no outside."""
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    longest = np.max(
        [np.linalg.norm(b - a, axis=1), np.linalg.norm(c - b, axis=1), np.linalg.norm(a - c, axis=1)], axis=0
    )
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    # A face whose doubled area is this small against its longest edge squared is a line in single precision.
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


def _vectors(values: Any) -> NDArray[np.float32]:
    raw = np.empty(3 * len(values), np.float32)
    if len(raw):
        values.foreach_get("vector", raw)
    return raw.reshape(-1, 3)


def _corners(mesh: bpy.types.Mesh) -> NDArray[np.int32]:
    """Return the vertices of all face corners, shape (loops,)."""
    out = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", out)
    return out

"""Measure the distance between surfaces in the viewport and in renders.

Blender evaluates a scene for renders only while it renders or exports. An export changes neither the scene nor its
history, and runs no scripts of frame changes. Each object is therefore exported as evaluated for the viewport and for
renders, and the files are read.
"""

from __future__ import annotations

import ctypes
import io
import os
import sys
import tempfile
from collections.abc import Iterable, Iterator, Set
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .._core import Array, DermisError, core
from . import participants, render_settings

_MILLIMETRE = 1e-3  # [m] unit of exported files; their six decimals are nanometres
_MODES = {"viewport": "DAG_EVAL_VIEWPORT", "render": "DAG_EVAL_RENDER"}

Surface = tuple[Array, NDArray[np.int64]]  # vertices [m], shape (V, 3), and triangles, shape (T, 3)


class Pieces:
    """The shown instances at the current frame, and their sizes.

    Args:
        hosts: session uids of the objects that are felt with the instances that they show.
        instanced: session uids of the objects whose instances are felt.
    """

    def __init__(
        self, hosts: Set[int], instanced: Set[int], depsgraph: bpy.types.Depsgraph, scene: bpy.types.Scene
    ) -> None:
        self._depsgraph, self._scene = depsgraph, scene
        self._shown: dict[int, dict[int, bpy.types.Object]] = {}  # by host, by session uid
        self._triangles: dict[int, float] = {}  # of hosts
        self._enlarged: dict[int, float] = {}
        places: dict[int, list[Any]] = {}
        for item in depsgraph.object_instances if hosts or instanced else ():
            if not item.is_instance:
                continue
            host, shown = item.parent.original.session_uid, item.instance_object.original
            if host in hosts:
                self._shown.setdefault(host, {})[shown.session_uid] = shown
                self._triangles[host] = self._triangles.get(host, 0.0) + self._finest(shown, item.object)
            if shown.session_uid in instanced:
                places.setdefault(shown.session_uid, []).append(item.matrix_world.copy())
        for shown in participants.look_up(set(places)).values():
            moved = np.array(places[shown.session_uid]) @ np.linalg.pinv(np.array(shown.matrix_world))
            self._enlarged[shown.session_uid] = float(np.linalg.norm(moved[:, :3, :3], ord=2, axis=(1, 2)).max())

    def shown_by(self, host: bpy.types.Object) -> Iterable[bpy.types.Object]:
        """Return the objects that a host shows as instances."""
        return self._shown.get(host.session_uid, {}).values()

    def triangles(self, obj: bpy.types.Object) -> float:
        """Return about how many triangles an object has in a render.

        Its instances are included. The number is infinite for instances on vertices and faces: these show children,
        which are not exported with the object.
        """
        if obj.instance_type in ("VERTS", "FACES"):
            return np.inf
        return self._finest(obj, obj.evaluated_get(self._depsgraph)) + self._triangles.get(obj.session_uid, 0.0)

    def enlarged(self, obj: bpy.types.Object) -> float:
        """Return the largest scale of an object's instances relative to it.

        It is at least 1.
        """
        return max(1.0, self._enlarged.get(obj.session_uid, 0.0))

    def _finest(self, obj: bpy.types.Object, evaluated: bpy.types.Object) -> float:
        is_mesh = isinstance(evaluated.data, bpy.types.Mesh)
        return 2.0 * len(evaluated.data.polygons) * render_settings.finer(obj, self._scene) if is_mesh else 0.0


def distances(
    objects: list[bpy.types.Object], scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer
) -> list[float | None]:
    """Return the largest distance between the two surfaces of each object [m].

    It is None if Blender cannot export both, or if it cannot be measured.
    """
    if not objects:
        return []
    unit = float(scene.unit_settings.scale_length)
    out: list[float | None] = []
    with tempfile.TemporaryDirectory() as folder, _collections(objects) as names, _quiet():
        for i, name in enumerate(names):
            surfaces = []
            for mode, evaluation in _MODES.items():
                path = Path(folder, f"{i} {mode}.obj")
                with suppress(RuntimeError):  # for example, there is no window to export from
                    _export(path, evaluation, name, scene, view_layer, unit / _MILLIMETRE)
                if path.exists():  # an export of nothing writes no file
                    surfaces.append(_read(path))
                    path.unlink()
            out.append(_apart(*surfaces) if len(surfaces) == len(_MODES) else None)
    return out


@contextmanager
def _collections(objects: Iterable[bpy.types.Object]) -> Iterator[list[str]]:
    """Give the names of temporary collections, each with one object.

    They are in no scene, and are removed at the end.
    """
    made = [bpy.data.collections.new("Dermis") for _ in objects]
    try:
        for collection, obj in zip(made, objects, strict=True):
            collection.objects.link(obj)
        yield [collection.name for collection in made]
    finally:
        for collection in made:
            bpy.data.collections.remove(collection)


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress standard output, on which Blender reports every export."""
    _flush()
    try:
        kept = os.dup(1)
    except OSError:  # there is none
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        with redirect_stdout(io.StringIO()):
            yield
    finally:
        _flush()
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def _flush() -> None:
    """Write out the buffers of Python and Blender for standard output."""
    with suppress(ValueError, AttributeError):  # it is closed, or there is none
        sys.stdout.flush()
    with suppress(OSError, AttributeError):
        ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None).fflush(None)


@contextmanager
def _nothing_active(view_layer: bpy.types.ViewLayer) -> Iterator[None]:
    """Let no object be active.

    An export puts the active object into Object Mode, where its shape may differ.
    """
    active = view_layer.objects.active
    view_layer.objects.active = None
    try:
        yield
    finally:
        view_layer.objects.active = active


def _export(
    path: Path, evaluation: str, collection: str, scene: bpy.types.Scene, view_layer: Any, scale: float
) -> None:
    window = bpy.context.window or next(iter(bpy.context.window_manager.windows), None)
    with bpy.context.temp_override(window=window, scene=scene, view_layer=view_layer), _nothing_active(view_layer):
        bpy.ops.wm.obj_export(
            filepath=str(path),
            check_existing=False,
            export_animation=False,
            collection=collection,
            export_eval_mode=evaluation,
            global_scale=scale,
            forward_axis="Y",
            up_axis="Z",
            export_triangulated_mesh=True,
            export_normals=False,
            export_uv=False,
            export_materials=False,
        )


def _read(path: Path) -> Surface:
    """Return the vertices [m] and triangles of a file that was just exported."""
    vertices: list[str] = []
    faces: list[tuple[int, int, int]] = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        if line.startswith("v "):
            vertices.append(line[2:])
        elif line.startswith("f "):
            first, *rest = (int(corner.partition("/")[0]) - 1 for corner in line[2:].split())
            faces += [(first, a, b) for a, b in zip(rest, rest[1:], strict=False)]
    places = np.array(" ".join(vertices).split(), np.float64).reshape(-1, 3) * _MILLIMETRE
    return places, np.array(faces, np.int64).reshape(-1, 3)


def _apart(one: Surface, other: Surface) -> float | None:
    """Return the largest distance of two surfaces [m]; None if it is unknown.

    It is measured from the vertices and the centroids of each surface's triangles to the other surface.
    """
    if not len(one[1]) or not len(other[1]):
        return None
    try:
        surfaces = [core.surface.gap.Surface.build(*surface) for surface in (one, other)]
        found = []
        for (places, triangles), surface in zip((one, other), reversed(surfaces), strict=True):
            used = np.concatenate([places[np.unique(triangles)], places[triangles].mean(axis=1)])
            found.append(np.abs(surface.query(used).gap).max())
    except DermisError:  # all its faces are without area
        return None
    return float(max(found))

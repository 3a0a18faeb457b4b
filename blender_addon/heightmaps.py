"""The relief of a touch screen: from a Blender image, a file, a sequence, or any mesh, always heights to the viewer."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree
from numpy.typing import NDArray

from . import properties, sampling_meshes
from ._core import core

_errors = import_module(".errors", core.__name__)
DermisError, Finding = _errors.DermisError, _errors.Finding
Screen = import_module(".scene", core.__name__).Screen

LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)
"""Rec. 709 weights of red, green and blue."""

_kept: dict[int, tuple[Any, Any]] = {}


def forget() -> None:
    """Drop the reliefs kept for the live preview: an image or a mesh was edited."""
    _kept.clear()


def bounds(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return centre and size of a screen's mesh in its own X and Y, in scene units before its matrix.

    Raises:
        DermisError: it has no width or no height.
    """
    with sampling_meshes.evaluated_mesh(obj.evaluated_get(depsgraph)) as mesh:
        raw = np.zeros((0, 3)) if mesh is None else sampling_meshes.positions(mesh).astype(np.float64)
    low, high = (raw.min(axis=0), raw.max(axis=0)) if len(raw) else (np.zeros(3), np.zeros(3))
    size = high[:2] - low[:2]
    if not (size > 0).all():
        raise DermisError("the touch screen has no area", where=f"object '{obj.name_full}'",
                          value=f"{size[0]:g} x {size[1]:g}", limit="a mesh with width and height in its own XY",
                          remedy="Use a plane, or add a screen with Add > Dermis")  # fmt: skip
    return np.array([*(0.5 * (low[:2] + high[:2])), 0.0]), size


def build(
    obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, unit: float, *, mirrored: bool = False, keep: bool = False
) -> Any:
    """Return the engine's `Screen` of a touch screen object at the current frame.

    Args:
        unit: metres in a scene unit.
        mirrored: the object's matrix reflects X; the map is turned over instead.
        keep: use the relief again while the settings stay (for the live preview); `forget` ends that.

    Raises:
        DermisError: no relief to be had, with the reason.
    """
    settings = obj.dermis.screen
    _, size = bounds(obj, depsgraph)
    key = _key(obj) if keep else None
    kept = _kept.get(obj.session_uid)
    if keep and kept is not None and kept[0] == key:
        heights, height_unit, findings = kept[1]
    else:
        heights, height_unit, findings = _relief(obj, depsgraph, unit)
        if mirrored:
            heights = np.ascontiguousarray(heights[..., ::-1])
        if keep:
            _kept[obj.session_uid] = (key, (heights, height_unit, findings))
    parameters = {k: v for k, v in properties.parameters(settings).items() if k != "height"}
    if heights.ndim == 3:
        parameters["sequence_start"] = int(settings.sequence_start)
    width, height = (float(s) * unit for s in size)
    return Screen(obj.name_full, (width, height), heights, height_unit, parameters, tuple(findings))


def _relief(obj: bpy.types.Object, depsgraph: Any, unit: float) -> tuple[NDArray[np.float32], float, tuple[Any, ...]]:
    depth_map = import_module(".effects.depth_map", core.__name__)
    settings = obj.dermis.screen
    where = f"screen '{obj.name_full}'"
    meaning = "depth" if settings.invert else "height"
    full_scale = float(settings.height_mm) * 1e-3
    if settings.source == "MESH":
        heights, noticed = cast(obj, depsgraph, unit)
        # Steps in a mesh are edges of the model, not of the storage: they stay.
        made = depth_map.from_array(heights, steps="keep", where=where)
        return made.heights, 1.0, noticed + made.findings
    if settings.source == "IMAGE":
        values, noticed = pixels(settings.image, where)
        made = depth_map.from_array(values, meaning=meaning, where=where)
        return made.heights, full_scale, noticed + made.findings
    if not settings.filepath.strip():
        raise DermisError("no image file was chosen", where=where, remedy="Choose one in the Dermis tab under Screen")
    path = bpy.path.abspath(settings.filepath, library=obj.library)
    if settings.source == "SEQUENCE":
        images = import_module(".images", core.__name__)
        made = depth_map.read(images.sequence(path), meaning=meaning)
    else:
        made = depth_map.read(path, meaning=meaning)
    return made.heights, full_scale, made.findings


def pixels(image: bpy.types.Image | None, where: str) -> tuple[NDArray[np.float32], tuple[Any, ...]]:
    """Return an image's raw brightness, row 0 at the bottom, and what was noticed.

    Raises:
        DermisError: no image, or one without pixels.
    """
    if image is None:
        raise DermisError("the image is missing", where=where, remedy="Choose one in the Dermis tab under Screen")
    width, height = image.size
    if width == 0 or height == 0 or (len(image.pixels) == 0):
        raise DermisError("the image has no pixels", where=f"{where}, image '{image.name_full}'",
                          value=f"{width} x {height}", limit="at least 1 x 1",
                          remedy="Check that its file exists; a Viewer Node gives no pixels")  # fmt: skip
    raw = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(raw)
    planes = raw.reshape(height, width, image.channels)
    findings: tuple[Any, ...] = ()
    if image.is_float and not image.colorspace_settings.is_data and image.source == "FILE":
        findings = (
            Finding("warning", "colour-managed", "Blender has bent this image's values by its colour space",
                    where=f"{where}, image '{image.name_full}'", value=image.colorspace_settings.name,
                    limit="Non-Color", remedy="Set the image's Color Space to Non-Color, or read it as a file"),
        )  # fmt: skip
    values = planes[:, :, :3] @ LUMA if image.channels >= 3 else planes[:, :, 0]
    if image.channels >= 3:
        grey = (planes[:, :, 0] == planes[:, :, 1]) & (planes[:, :, 1] == planes[:, :, 2])
        values = np.where(grey, planes[:, :, 0], values)  # greys stay exactly what was stored
    return np.ascontiguousarray(values), findings


def cast(
    screen: bpy.types.Object, depsgraph: bpy.types.Depsgraph, unit: float
) -> tuple[NDArray[np.float64], tuple[Any, ...]]:
    """Cast rays against the screen's -Z onto its mesh object; return heights over the screen [m], NaN where none hit.

    Row 0 lies at the bottom; rays go through the middle of each pixel, in the current frame.

    Raises:
        DermisError: no mesh, or nothing of it over the screen.
    """
    settings = screen.dermis.screen
    target = settings.mesh_object
    where = f"screen '{screen.name_full}'"
    if target is None:
        raise DermisError(
            "no mesh was chosen for its relief", where=where, remedy="Choose an object under Screen > Mesh"
        )
    evaluated = target.evaluated_get(depsgraph)
    with sampling_meshes.evaluated_mesh(evaluated) as mesh:
        points = np.zeros((0, 3)) if mesh is None else sampling_meshes.positions(mesh).astype(np.float64)
        faces = np.zeros((0, 3), np.int32) if mesh is None else sampling_meshes.triangles(mesh)
    if len(faces) == 0:
        raise DermisError("the mesh has no faces", where=f"object '{target.name_full}'", remedy="Give it faces")
    matrix = np.array(screen.evaluated_get(depsgraph).matrix_world, np.float64)
    centre, size = bounds(screen, depsgraph)
    stretch = np.linalg.norm(matrix[:3, :3], axis=0)
    axes = matrix[:3, :3] / stretch
    origin = matrix[:3, :3] @ centre + matrix[:3, 3]
    to_world = np.array(evaluated.matrix_world, np.float64)
    local = ((points @ to_world[:3, :3].T + to_world[:3, 3]) - origin) @ np.linalg.inv(axes).T * unit
    extent = size * stretch[:2] * unit
    shape = grid(extent, settings.resolution)
    heights = _ray_grid(local, faces, extent, shape)
    missed = int(np.isnan(heights).sum())
    if missed == heights.size:
        raise DermisError("nothing of the mesh lies over the touch screen", where=where, value=target.name_full,
                          remedy="Move the mesh in front of the screen, along the screen's own Z")  # fmt: skip
    return heights, ()


def grid(extent: NDArray[np.float64], resolution: int) -> tuple[int, int]:
    """Return rows and columns with `resolution` points along the longer side and pixels as square as can be."""
    longer = float(extent.max())
    columns, rows = (max(1, round(resolution * float(e) / longer)) for e in extent)
    return rows, columns


def _ray_grid(
    points: NDArray[np.float64], faces: NDArray[np.int32], extent: NDArray[np.float64], shape: tuple[int, int]
) -> NDArray[np.float64]:
    rows, columns = shape
    # The tree works in single precision and has tolerances of its own: put the mesh into a box of size one.
    size = float(np.abs(points).max()) or 1.0
    tree = BVHTree.FromPolygons((points / size).tolist(), faces.tolist(), all_triangles=True)
    top = float(points[:, 2].max()) / size + 1.0
    xs = ((np.arange(columns) + 0.5) / columns - 0.5) * extent[0] / size
    ys = ((np.arange(rows) + 0.5) / rows - 0.5) * extent[1] / size
    heights = np.full(shape, np.nan)
    down = (0.0, 0.0, -1.0)
    for r, y in enumerate(ys.tolist()):
        row = heights[r]
        for c, x in enumerate(xs.tolist()):
            distance = tree.ray_cast((x, y, top), down)[3]
            if distance is not None:
                row[c] = (top - distance) * size
    return heights


def _key(obj: bpy.types.Object) -> Any:
    """Return what a kept relief depends on, as far as can be told without reading it."""
    s = obj.dermis.screen
    image, mesh = s.image, s.mesh_object
    return (
        s.source, s.invert, s.height_mm, s.filepath, s.resolution,
        None if image is None else (image.session_uid, tuple(image.size), image.filepath),
        None if mesh is None else (mesh.session_uid, tuple(map(tuple, mesh.matrix_world))),
        tuple(map(tuple, obj.matrix_world)) if s.source == "MESH" else None,
    )  # fmt: skip

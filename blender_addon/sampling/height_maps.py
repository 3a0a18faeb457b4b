"""Read the relief of a touch screen, as heights towards the viewer.

Its source is a Blender image, an image file, a sequence of files, or any mesh.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .._core import DermisError, Finding, core
from ..properties import object_properties
from ..properties.fields import value_of
from . import image_files, mesh_heights, meshes

LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)
"""[-] Rec. 709 weights of red, green and blue in brightness."""

NO_DATA = ("zeros-like-holes", "no-data-likely")
OFFERED = (*NO_DATA, "no-unit")
"""Codes of the findings on a map that the artist has to decide on."""
DIM, BEYOND = 0.05, 0.01
"""[share of white] DIM: a map that is nowhere this bright is likely a measure. BEYOND: so is one that goes this far
below black or above white."""

_kept: dict[int, tuple[Any, Any]] = {}
# By screen: the 'no data' setting when its map was last read, and the findings for the artist.
_offered: dict[int, tuple[str, tuple[Any, ...]]] = {}


def forget() -> None:
    """Drop the reliefs kept for the live preview.

    It must be called after an image or a mesh was edited.
    """
    _kept.clear()


def offered(obj: bpy.types.Object) -> tuple[Any, ...]:
    """Return the undecided findings on a screen's map.

    The artist must decide on them. They are from the last reading of the map.
    """
    settings = obj.dermis.screen
    said, found = _offered.get(obj.session_uid, ("", ()))
    decided = {**dict.fromkeys(NO_DATA, said != _no_data(settings)), "no-unit": settings.map_unit != "white"}
    return tuple(finding for finding in found if not decided[finding.code])


def look(obj: bpy.types.Object) -> tuple[Any, ...]:
    """Read the map file of a screen, and return the findings on it.

    Raises:
        DermisError: it cannot be read; if the artist must decide first, `offered` returns the finding as well.
    """
    found: tuple[Any, ...] = _file(obj, sequence=False).findings
    return found


def said_no_data(obj: bpy.types.Object) -> bool:
    """Return whether a screen's 'no data' setting has been made.

    It says which numbers of the map stand for 'no data', or that none does.
    """
    return bool(_no_data(obj.dermis.screen))


def words_on_no_data(obj: bpy.types.Object, *words: str) -> str:
    """Return the 'no data' setting of a screen with further words appended."""
    said = _no_data(obj.dermis.screen)
    return "; ".join(([said] if said else []) + list(words))


def say_no_data(obj: bpy.types.Object, *words: str) -> None:
    """Append words to the 'no data' setting of a screen."""
    obj.dermis.screen.no_data = words_on_no_data(obj, *words)


def unanswered(obj: bpy.types.Object) -> tuple[Any, ...]:
    """Return the undecided findings on numbers that may mean 'no data'.

    Raises:
        DermisError: the map cannot be read.
    """
    if obj.dermis.screen.source == "MESH" or not _chosen(obj.dermis.screen):
        return ()
    _read(obj, None, 1.0)
    return tuple(finding for finding in offered(obj) if finding.code in NO_DATA)


def bounds(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return centre and size of a screen's mesh in its own X and Y.

    The centre has shape (3,) with Z = 0, the size has shape (2,). Both are in the object's space, before its matrix is
    applied.

    Raises:
        DermisError: it has no width or no height.
    """
    low, high = extent(meshes.vertices_of(obj.evaluated_get(depsgraph)))
    size = high - low
    if not (size > 0).all():
        raise DermisError(
            "the touch screen has no area",
            where=f"object '{obj.name_full}'",
            value=f"{size[0]:g} x {size[1]:g}",
            limit="a mesh with width and height in its own XY",
            remedy="Use a plane, or add a screen with Add > Dermis",
        )
    return np.array([*(0.5 * (low + high)), 0.0]), size


def extent(places: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the lowest and the highest X and Y of vertices, shape (2, 2).

    Both are zero if there are no vertices.
    """
    if not len(places):
        return np.zeros((2, 2))
    return np.array([places.min(axis=0)[:2], places.max(axis=0)[:2]], np.float64)


def build(
    obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, unit: float, *, mirrored: bool = False, keep: bool = False
) -> Any:
    """Return the engine's `Screen` of an object at the current frame.

    Args:
        unit: [m] length of a scene unit.
        mirrored: the object's matrix reflects X; the map is mirrored instead.
        keep: cache the relief while the settings stay the same, for the live preview; `forget` drops it.

    Raises:
        DermisError: the relief cannot be made; the message gives the reason.
    """
    settings = obj.dermis.screen
    _, size = bounds(obj, depsgraph)
    key = _key(obj) if keep else None
    kept = _kept.get(obj.session_uid)
    if keep and kept is not None and kept[0] == key:
        made = kept[1]
    else:
        made = _relief(obj, depsgraph, unit)
        if mirrored:
            heights, holes = (
                None if a is None else np.ascontiguousarray(a[..., ::-1]) for a in (made.heights, made.holes)
            )
            made = replace(made, heights=heights, holes=holes)
        if keep and _chosen(settings):
            _kept[obj.session_uid] = (key, made)
    parameters = object_properties.parameters(settings)
    if made.heights.ndim == 3:
        parameters["sequence_start"] = int(settings.sequence_start)
    width, height = (float(s) * unit for s in size)
    return core.scene.tactile_scene.Screen(
        obj.name_full, (width, height), made.heights, made.height_unit, parameters, made.findings, made.holes
    )


def frozen(
    screens: Iterable[bpy.types.Object], depsgraph: bpy.types.Depsgraph, deforming: frozenset[int] | None
) -> list[mesh_heights.Frozen]:
    """Return the watchers of the reliefs that were cast from meshes.

    A screen has none where a device reads the surfaces over it instead of its map.

    Args:
        deforming: session uids of the objects whose shape may change; None if that of every object may.
    """
    out = []
    for obj in screens:
        settings = obj.dermis.screen
        if settings.source != "MESH" or settings.mesh_object is None or _felt_as_mesh(obj, depsgraph.scene):
            continue
        uids = {obj.session_uid, settings.mesh_object.session_uid}
        out.append(mesh_heights.Frozen(obj, depsgraph, deforming is None or not uids.isdisjoint(deforming)))
    return out


def _relief(obj: bpy.types.Object, depsgraph: Any, unit: float) -> Any:
    """Return the engine's `DepthMap` of a screen, flat if none is needed."""
    settings = obj.dermis.screen
    where = f"screen '{obj.name_full}'"
    if not _chosen(settings) and _felt_as_mesh(obj, depsgraph.scene):
        finding = Finding(
            "info", "no-map", "no relief was chosen, so the screen is flat to devices that read its map", where=where
        )
        return core.effects.depth_map.DepthMap(np.zeros((1, 1), np.float32), (finding,), 1.0)
    made = _read(obj, depsgraph, unit)
    if made.height_unit != 0.0:
        return made
    # The engine would read a height of 0 as a map without a unit, as high as the screen is wide.
    finding = Finding(
        "warning",
        "no-height",
        "its height is 0 mm, so the relief is flat",
        where=where,
        remedy="Set Height in the Dermis tab under Touch: Screen",
    )
    return replace(made, heights=np.zeros_like(made.heights), height_unit=1.0, findings=(*made.findings, finding))


def _chosen(settings: Any) -> bool:
    if settings.source == "MESH":
        return settings.mesh_object is not None
    return settings.image is not None if settings.source == "IMAGE" else bool(settings.filepath.strip())


def _felt_as_mesh(screen: bpy.types.Object, scene: bpy.types.Scene) -> bool:
    """Return whether a device reads the surfaces over a screen, not its map."""
    return any(
        device.enabled and device.relief == "mesh" and device.screen in (None, screen)
        for obj in scene.objects
        if obj.dermis.role == "FINGER"
        for device in obj.dermis.finger.devices
    )


def _read(obj: bpy.types.Object, depsgraph: Any, unit: float) -> Any:
    depth_map = core.effects.depth_map
    settings = obj.dermis.screen
    where = f"screen '{obj.name_full}'"
    if settings.source == "MESH":
        heights, noticed = mesh_heights.cast(obj, depsgraph, unit, *bounds(obj, depsgraph))
        # Steps in these heights are edges of the mesh, not an effect of number storage, so they are kept.
        made = depth_map.from_array(heights, no_data="none", levels=0, where=where)
        return replace(made, height_unit=1.0, findings=noticed + made.findings)
    if settings.source == "IMAGE":
        values, empty, noticed = pixels(settings.image, where)
        declared, more = image_files.declared(settings.image, values, where, said=bool(_no_data(settings)))
        noticed += more
        empty = empty if declared is None else empty | declared
        unit_ = core.parameters.screen.UNITS_OF_MAPS[settings.map_unit]
        found = image_files.largest(settings.image)
        if found is None and (unit_ is not None or _no_data(settings) not in ("", "0", "none")):
            raise DermisError(
                "Blender scales the numbers of this image to 0 to 1 by an unknown factor",
                where=f"{where}, image '{settings.image.name_full}'",
                value=settings.image.file_format,
                limit="PNG, OpenEXR, Radiance HDR; TIFF of one type of sample, whose file is there",
                remedy="Choose it as a file: Source in the Dermis tab under Touch: Screen; or save it as OpenEXR or "
                "PNG",
            )
        largest = found or 1
        made = depth_map.from_array(
            values,
            **_meant(settings),
            declared=empty,
            levels=largest + 1 if largest > 1 else 0,
            largest=largest,
            where=where,
        )
        height_unit = 0.0 if unit_ is None else unit_ * largest
        return _with_unit(obj, replace(made, findings=noticed + made.findings, height_unit=height_unit), where)
    if not settings.filepath.strip():
        raise DermisError(
            "no image file was chosen", where=where, remedy="Choose one in the Dermis tab under Touch: Screen"
        )
    return _file(obj, sequence=settings.source == "SEQUENCE")


def _file(obj: bpy.types.Object, *, sequence: bool) -> Any:
    settings = obj.dermis.screen
    path = bpy.path.abspath(settings.filepath, library=obj.library)
    unit = core.parameters.screen.UNITS_OF_MAPS[settings.map_unit]
    try:
        paths = core.images.sequence(path) if sequence else path
        made = core.effects.depth_map.read(paths, **_meant(settings), unit=unit)
    except DermisError as error:
        if error.code in OFFERED:
            found = (error.as_finding(code=error.code, remedy=error.remedy),)
            _offered[obj.session_uid] = _no_data(settings), found
        raise
    gap = core.images.gap_after(path) if sequence else None
    made = replace(made, findings=made.findings + (() if gap is None else (gap,)))
    return _with_unit(obj, made, f"screen '{obj.name_full}'")


def _meant(settings: Any) -> dict[str, Any]:
    """Return the artist's settings for reading a map, as keyword arguments."""
    no_data = core.effects.map_repair.no_data_of(_no_data(settings), f"screen '{settings.id_data.name_full}', No Data")
    return {"meaning": "depth" if settings.invert else "height", "no_data": no_data}


def _no_data(settings: Any) -> str:
    """Return the 'no data' setting of a screen; '' if it has not been made."""
    return str(settings.no_data).strip() or ("0" if settings.zero_is_hole else "")


def _with_unit(obj: bpy.types.Object, made: Any, where: str) -> Any:
    """Return a map with its height unit [m] and all findings.

    The findings that the artist has to decide on are kept for `offered`.
    """
    findings, height_unit = made.findings, made.height_unit
    if height_unit == 0.0:
        height_unit = value_of(obj.dermis.screen, core.parameters.screen.HEIGHT)
        findings += _doubtful(made.heights, obj.dermis.screen.invert, where)
    _offered[obj.session_uid] = _no_data(obj.dermis.screen), tuple(f for f in findings if f.code in OFFERED)
    return replace(made, height_unit=height_unit, findings=findings)


def _doubtful(heights: NDArray[np.float32], depth: bool, where: str) -> tuple[Any, ...]:
    """Return a finding if a map read as brightness looks like a measure."""
    low, high = float(heights.min()), float(heights.max())
    low, high = (-high, -low) if depth else (low, high)
    if low == high or (low >= -BEYOND and DIM <= high <= 1.0 + BEYOND):
        return ()
    return (
        Finding(
            "warning",
            "no-unit",
            "its numbers look like lengths, but were taken as brightness, in which 1 is white",
            where=where,
            value=f"{low:.4g} to {high:.4g}",
            remedy="Choose the unit in the field 'Values Are' of the Dermis tab under Touch: Screen; leave it if 1 "
            "has the height set as Height",
        ),
    )


def pixels(image: bpy.types.Image | None, where: str) -> tuple[NDArray[np.float32], NDArray[np.bool_], tuple[Any, ...]]:
    """Return an image's raw brightness, its empty pixels, and findings.

    Both arrays have shape (height, width), row 0 at the bottom. A pixel is empty where its alpha is 0.

    Raises:
        DermisError: no image, or one without pixels.
    """
    if image is None:
        raise DermisError(
            "the image is missing", where=where, remedy="Choose one in the Dermis tab under Touch: Screen"
        )
    width, height = image.size
    if width == 0 or height == 0 or (len(image.pixels) == 0):
        raise DermisError(
            "the image has no pixels",
            where=f"{where}, image '{image.name_full}'",
            value=f"{width} x {height}",
            limit="at least 1 x 1",
            remedy="Check that its file exists; a Viewer Node gives no pixels",
        )
    raw = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(raw)
    planes = raw.reshape(height, width, image.channels)
    findings: tuple[Any, ...] = ()
    if image.is_float and not image.colorspace_settings.is_data and image.source == "FILE":
        findings = (
            Finding(
                "warning",
                "colour-managed",
                "Blender has changed this image's values by its colour space",
                where=f"{where}, image '{image.name_full}'",
                value=image.colorspace_settings.name,
                limit="Non-Color",
                remedy="Set the image's Color Space to Non-Color, or read it as a file",
            ),
        )
    if image.source == "TILED" and len(image.tiles) > 1:
        findings += (
            Finding(
                "warning",
                "udim-first-tile",
                "only the first tile of the image is used, on the whole screen",
                where=f"{where}, image '{image.name_full}'",
                value=f"tile {image.tiles[0].number} of {', '.join(str(tile.number) for tile in image.tiles)}",
                limit="one tile",
                remedy="Save the tile as an image of its own, or join the tiles to one image",
            ),
        )
    values = planes[:, :, :3] @ LUMA if image.channels >= 3 else planes[:, :, 0]
    if image.channels >= 3:
        grey = (planes[:, :, 0] == planes[:, :, 1]) & (planes[:, :, 1] == planes[:, :, 2])
        values = np.where(grey, planes[:, :, 0], values)  # greys keep their stored values exactly
    transparent = image.channels in (2, 4) and image.alpha_mode in ("STRAIGHT", "PREMUL")
    empty = planes[:, :, -1] == 0.0 if transparent else np.zeros((height, width), bool)
    return np.ascontiguousarray(values), empty, findings


def _key(obj: bpy.types.Object) -> Any:
    """Return the key of a cached relief.

    It has all that the relief depends on, as far as that is known without reading the source.
    """
    s = obj.dermis.screen
    image, mesh = s.image, s.mesh_object
    return (
        s.source,
        s.invert,
        s.zero_is_hole,
        s.no_data,
        s.height_mm,
        s.map_unit,
        s.filepath,
        s.resolution,
        None if image is None else (image.session_uid, tuple(image.size), image.filepath),
        None if mesh is None else (mesh.session_uid, tuple(map(tuple, mesh.matrix_world))),
        tuple(map(tuple, obj.matrix_world)) if s.source == "MESH" else None,
    )

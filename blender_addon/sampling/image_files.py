"""Read the file behind a Blender image, and its tags on the pixels.

Blender itself keeps numbers from 0 to 1, and no tags.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .._core import DermisError, Finding, core

_FROM_FILES = ("FILE", "SEQUENCE", "TILED")


def largest(image: bpy.types.Image) -> int | None:
    """Return the stored number that Blender converts to 1.

    It is 1 for floating point, and None if it is unknown.
    """
    if not image.is_float:
        return 255
    kind = image.file_format
    if image.source not in _FROM_FILES or kind in ("OPEN_EXR", "OPEN_EXR_MULTILAYER", "HDR"):
        return 1
    if kind == "PNG":
        return 65535
    if kind != "TIFF":
        return None  # integers of 10 to 16 bits: JPEG 2000, Cineon, DPX and others
    try:
        stored = core.images.tiff_header.TiffHeader.of(_tiff(image), image.name_full).sample_type()
    except DermisError:
        return None
    found, _ = core.images.raster.largest_of(stored)
    return int(found)


def declared(
    image: bpy.types.Image, values: NDArray[np.float32], where: str, *, said: bool
) -> tuple[NDArray[np.bool_] | None, tuple[Finding, ...]]:
    """Return the pixels that a TIFF declares empty, and findings on its tags.

    Args:
        values: values of the pixels in Blender, row 0 at the bottom, shape (rows, columns).
        said: whether the artist has decided on 'no data'; then a file that cannot be read is not reported.

    Returns:
        Whether each pixel is empty, row 0 at the bottom, and findings. Instead of the pixels it has None for images of
        other kinds, and if the file cannot be read.
    """
    if image.source not in _FROM_FILES or image.file_format != "TIFF":
        return None, ()
    where = f"{where}, image '{image.name_full}'"
    try:
        raster = core.images.png_tiff.decode(_tiff(image), where)
        if not _agrees(raster, values, bent=image.is_float and not image.colorspace_settings.is_data):
            raise DermisError("its file has other pixels than Blender", value=image.filepath)
    except DermisError as error:
        unknown = Finding(
            "warning",
            "no-data-unknown",
            f"which pixels of the image its TIFF file declares to hold no data is not known: {error.what}",
            where=where,
            value=error.value,
            remedy="Put the file back and reload the image, choose it as a file, or set No Data in the Dermis tab",
        )
        return None, () if said else (unknown,)
    return raster.holes, tuple(raster.findings)


def _agrees(raster: Any, values: NDArray[np.float32], *, bent: bool) -> bool:
    """Return whether a file has the pixels that Blender has.

    The file may have been written anew, or the pixels painted over.

    Args:
        bent: whether Blender has converted the values by a colour space, so that only the size can be compared.
    """
    if raster.holes.shape != values.shape:
        return False
    there = ~raster.holes
    return bent or np.allclose(raster.values[there], values[there], rtol=1e-5, atol=1e-5, equal_nan=True)


def _tiff(image: bpy.types.Image) -> bytes:
    """Return the bytes of a TIFF, packed or from its file.

    Raises:
        DermisError: the file is missing, or is not a TIFF.
    """
    if image.packed_file is not None:
        data = bytes(image.packed_file.data)
    else:
        path = bpy.path.abspath(image.filepath_from_user(), library=image.library)
        if image.source == "TILED":
            number = image.tiles[0].number - 1001
            path = path.replace("<UDIM>", str(number + 1001))
            path = path.replace("<UVTILE>", f"u{number % 10 + 1}_v{number // 10 + 1}")
        data = core.files.read_bytes(path)
    if not data.startswith(core.images.tiff_header.MAGIC):
        raise DermisError("its file is no TIFF", where=image.name_full)
    return data

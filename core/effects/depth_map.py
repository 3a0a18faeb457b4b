"""Depth maps: heights over a touch screen, read and repaired.

Every repair is reported as a finding.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from .. import images
from ..errors import DermisError, Finding
from .map_repair import MapRepair, Meaning, NoData, Steps, number_of

FINEST_WHITE = 1 << 16  # levels of the finest format whose largest number is always white
SMALLEST_UNIT, LARGEST_UNIT = 1e-12, 1e3  # [m] bounds of the length that 1 in a file may stand for
# Numbers of formats finer than `FINEST_WHITE` are lengths if all are below the type's range divided by this.
LEAST_OF_RANGE = 256


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Heights towards the viewer for `core.scene.tactile_scene.Screen`.

    Attributes:
        heights: values for `Screen.height_map`, row 0 at the bottom, float32, shape (rows, columns), or (k, rows,
            columns) for a sequence.
        findings: repairs and warnings.
        height_unit: length of one unit of the heights [m], for `Screen.height_unit`; 0 if it is not known.
        holes: pixels whose heights were filled in, booleans, same shape as `heights`; None if there were no holes.
    """

    heights: NDArray[np.float32]
    findings: tuple[Finding, ...] = ()
    height_unit: float = 0.0
    holes: NDArray[np.bool_] | None = None


def read(
    source: str | Path | Sequence[str | Path],
    *,
    meaning: Meaning = "height",
    no_data: NoData = None,
    steps: Steps = "smooth",
    unit: float | None = None,
) -> DepthMap:
    """Read heights from an image file, or from a sequence of image files.

    Whole numbers are scaled, so that 0 is black and 1 is white. PFM and floating-point NPY files are taken as stored.
    Whole numbers of 32 or 64 bits that use less than 1/256 of their range are lengths. They need a unit.

    Args:
        source: a path, or the paths of a sequence in order (`core.images.sequence` finds the files of a sequence).
        meaning: 'height' towards the viewer, or 'depth' away from the viewer, which is negated.
        no_data: number in the file that stands for 'nothing measured', such as -9999; or several numbers, such as
            (65535, 0). With 'none', every number is a height; with (65535, 'none'), every number but 65535 is one.
            Without 'none', a finding reports any other number that seems to stand for 'nothing measured'. In any case,
            a pixel has no height if the file declares it as empty (alpha 0, a TIFF's tag 42113, the page of its mask)
            or if its value is not finite.
        steps: 'smooth' or 'keep', for the staircases of images with 256 levels or fewer. Finer formats are not changed.
        unit: length that 1 in the file stands for [m], 1e-12 to 1e3; 1e-3 for a depth camera that writes millimetres.
            `height_unit` is computed from it.

    Raises:
        DermisError: there is no image, an image cannot be read, the images differ in size, every pixel of an image is a
            hole, lengths have no unit, the unit is out of range, images with a unit differ in the type of their
            numbers, or `no_data` is no number.
    """
    paths = [source] if isinstance(source, str | Path) else list(source)
    if not paths:
        raise DermisError("no image", where="depth map", remedy="Choose an image for the touch screen")
    first = f"image '{Path(paths[0]).name}'"
    where = first if len(paths) == 1 else f"{first} and {len(paths) - 1} more"
    if unit is not None and not SMALLEST_UNIT <= number_of(unit, "unit", where) <= LARGEST_UNIT:
        limit = f"{SMALLEST_UNIT:g} to {LARGEST_UNIT:g} m"
        raise DermisError("the unit of the numbers is out of range", where=where, value=unit, limit=limit)
    noticed: list[Finding] = []
    work = MapRepair(meaning, no_data, steps, where)
    heights: NDArray[np.float32] | None = None
    holes = np.zeros((0, 0, 0), bool)
    largest = 1  # number in the file that became 1
    for index, path in enumerate(paths):  # read one by one: a sequence has hundreds of images
        raster = images.read(path)
        shape = raster.values.shape
        if heights is None:
            heights, largest = np.empty((len(paths), *shape), np.float32), raster.largest
            holes = np.zeros((len(paths), *shape), bool)
        if unit is None:
            _check_white(raster, path)
        elif raster.largest != largest:
            raise DermisError(
                "the images of a sequence differ in their numbers' type",
                where=f"image '{Path(path).name}'",
                value=f"up to {raster.largest}",
                limit=f"up to {largest}, as the first",
            )
        if heights.shape[1:] != shape:
            raise DermisError(
                "the images of a sequence differ in size",
                where=f"image '{Path(path).name}'",
                value=f"{shape[1]} x {shape[0]}",
                limit=f"{heights.shape[2]} x {heights.shape[1]}, as the first",
            )
        place = f"image '{Path(path).name}'"
        heights[index], holes[index] = work.repaired(
            raster.values, raster.holes, raster.levels, place, largest=raster.largest, signed=raster.signed
        )
        noticed += raster.findings
    assert heights is not None
    shown = heights if len(paths) > 1 else heights[0]
    filled = (holes if len(paths) > 1 else holes[0]) if holes.any() else None
    return DepthMap(shown, _merged(noticed) + work.findings(), (unit or 0.0) * largest, filled)


def from_array(
    values: NDArray[Any],
    *,
    meaning: Meaning = "height",
    first_row: Literal["bottom", "top"] = "bottom",
    no_data: NoData = None,
    steps: Steps = "smooth",
    declared: NDArray[np.bool_] | None = None,
    levels: int | None = None,
    largest: float = 1.0,
    where: str = "depth map",
) -> DepthMap:
    """Return a depth map from an array of heights, with repairs.

    The array has the pixels of an image in Blender, or heights of a mesh.

    Args:
        values: shape (rows, columns) or (k, rows, columns).
        first_row: edge of the screen at row 0, 'bottom' or 'top'; 'bottom' for images in Blender.
        declared: pixels that are known to be empty, booleans, same shape as `values`.
        levels: number of levels of the source; 0 for floating point and for heights of a mesh; None for 256 if the
            array's type has one byte, and 0 otherwise. Only heights with 256 levels or fewer can be staircases.
        largest: number in the file that a value of 1 stands for; 1 if the values are as in the file.
        no_data: as for `read`.
        meaning, steps: as for `read`.

    Raises:
        DermisError: the values are not real numbers, there are no pixels, a shape is wrong, every pixel of a map is a
            hole, or `first_row`, `meaning`, `no_data` or `steps` is invalid.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "buif":
        raise DermisError("the map does not hold real numbers", where=where, value=str(array.dtype))
    if array.ndim not in (2, 3) or array.size == 0:
        raise DermisError(
            "the map has no pixels",
            where=where,
            value=" x ".join(map(str, array.shape)) or "a number",
            limit="rows x columns, at least 1 x 1",
            remedy="Choose another image",
        )
    if first_row not in ("bottom", "top"):
        raise DermisError("unknown first row", where=where, value=first_row, limit="bottom, top")
    empty = None if declared is None else _declared(declared, array.shape, where)
    work = MapRepair(meaning, no_data, steps, where)
    known = levels if levels is not None else (1 << 8 if array.dtype.itemsize == 1 else 0)
    single = array.ndim == 2
    stack = array[None] if single else array
    gaps = [None] * len(stack) if empty is None else list(empty[None] if single else empty)
    heights, holes = np.empty(stack.shape, np.float32), np.zeros(stack.shape, bool)
    for index, (values_, gap) in enumerate(zip(stack, gaps, strict=True)):
        place = where if single else f"{where}, map {index + 1} of {len(stack)}"
        repaired, gap = work.repaired(values_, gap, known, place, largest=largest)
        upwards = slice(None) if first_row == "bottom" else slice(None, None, -1)
        heights[index], holes[index] = repaired[upwards], gap[upwards]
    filled = (holes[0] if single else holes) if holes.any() else None
    return DepthMap(heights[0] if single else heights, work.findings(), holes=filled)


def _declared(declared: Any, shape: tuple[int, ...], where: str) -> NDArray[np.bool_]:
    try:
        empty = np.asarray(declared)
    except ValueError:  # rows of differing length
        empty = np.zeros(0)
    if empty.shape != shape or empty.dtype.kind != "b":
        found = f"{empty.dtype} {empty.shape}"
        raise DermisError("the holes do not fit the map", where=where, value=found, limit=f"bool {shape}")
    return empty


def _check_white(raster: images.Raster, path: str | Path) -> None:
    """Raise an error for whole numbers that are lengths without a unit."""
    if raster.levels <= FINEST_WHITE:
        return
    found = np.array([raster.values.min(), raster.values.max()], np.float64) * raster.largest
    if np.abs(found).max() * LEAST_OF_RANGE < raster.levels:
        raise DermisError(
            "the map holds whole numbers as lengths, and their unit is not stated",
            where=f"image '{Path(path).name}'",
            value=f"{found[0]:.7g} to {found[1]:.7g} of {raster.levels - 1}",
            remedy="State the unit of the numbers: choose it in the field 'Values Are' of the Dermis tab under Touch: "
            "Screen, or give unit=1e-3 (mm) in a script",
            code="no-unit",
        )


def _merged(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return one finding for each code, with the counts added.

    A sequence has hundreds of images.
    """
    by_code: dict[str, Finding] = {}
    for finding in findings:
        known = by_code.get(finding.code)
        if known is not None:
            finding = replace(known, count=known.count + finding.count)
        by_code[finding.code] = finding
    return tuple(by_code.values())

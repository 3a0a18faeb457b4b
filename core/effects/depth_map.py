"""Depth maps: heights over a touch screen, read, repaired, and every repair reported."""

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

FINEST_WHITE = 1 << 16  # levels of the finest format whose largest number is white
SMALLEST_UNIT, LARGEST_UNIT = 1e-12, 1e3  # [m] of one stored number, atoms to hills
LEAST_OF_RANGE = 256  # numbers below this part of their type's range are not scaled to it


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Heights towards the viewer, ready for `core.scene.tactile_scene.Screen.height_map`.

    Attributes:
        heights: row 0 at the bottom, float32, shape (rows, columns), or (k, rows, columns) for a sequence.
        findings: repairs and warnings.
        height_unit: metres that one unit of the heights stands for, as `Screen.height_unit`; 0 where nobody said.
        holes: where heights were filled in, booleans of the same shape; None where there were no holes.
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
    """Read an image file, or several as a sequence in the order given.

    Whole-number formats run from 0 (black) to 1 (white); PFM and floating NPY are taken as stored. Whole numbers of 32
    or 64 bits that use next to nothing of their range are measures, with no white: they need a unit.

    Args:
        source: a path, or paths (`core.images.sequence` finds the numbered ones that follow one).
        meaning: 'height' towards the viewer, or 'depth' away from the viewer, which is negated.
        no_data: the number, as the file stores it, that stands for 'nothing measured', such as -9999; or several, such
            as (65535, 0); or 'none', where every number is a height, and (65535, 'none'), where every other one is.
            Without 'none', another number that looks so is told. Pixels that the file itself declares (alpha 0, a
            TIFF's tag 42113, the page of its mask), and values that are not finite, are no heights in any case.
        steps: treatment of the staircases of 8-bit images. Finer formats are exact and are not changed.
        unit: metres that one stored number stands for, 1e-12 to 1e3: 1e-3 of a depth camera's millimetres. It gives
            `height_unit`.

    Raises:
        DermisError: no image, one that cannot be read, images of differing size or kind, nothing but holes, measures
            without a unit, a unit that is out of range, a `no_data` that is no number.
    """
    paths = [source] if isinstance(source, str | Path) else list(source)
    if not paths:
        raise DermisError("no image", where="depth map", remedy="Choose an image for the touch screen")
    first = f"image '{Path(paths[0]).name}'"
    where = first if len(paths) == 1 else f"{first} and {len(paths) - 1} more"
    if unit is not None and not SMALLEST_UNIT <= number_of(unit, "unit", where) <= LARGEST_UNIT:
        limit = f"{SMALLEST_UNIT:g} to {LARGEST_UNIT:g} m"
        raise DermisError("the unit is no length that a number may stand for", where=where, value=unit, limit=limit)
    noticed: list[Finding] = []
    work = MapRepair(meaning, no_data, steps, where)
    heights: NDArray[np.float32] | None = None
    holes = np.zeros((0, 0, 0), bool)
    largest = 1  # the stored number that became 1
    for index, path in enumerate(paths):  # one image in memory at a time: a sequence has hundreds
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
    """Repair heights that are already numbers: a Blender image's pixels, or a bake of a mesh.

    Args:
        values: shape (rows, columns) or (k, rows, columns).
        first_row: which edge of the screen row 0 lies at (Blender's images: 'bottom').
        declared: pixels known to be empty, booleans, same shape as `values`.
        levels: how many values the numbers' source can tell apart, 0 for floating point and for measures of a mesh;
            left out, that of the array's type. Only 256 or fewer can be staircases.
        largest: the stored number that 1 of the values stands for, 1 where they are as stored.
        no_data: as for `read`.
        meaning, steps: as for `read`.

    Raises:
        DermisError: not numbers, no pixels, another shape, nothing but holes.
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
    """Refuse measures without a unit."""
    if raster.levels <= FINEST_WHITE:
        return
    found = np.array([raster.values.min(), raster.values.max()], np.float64) * raster.largest
    if np.abs(found).max() * LEAST_OF_RANGE < raster.levels:
        raise DermisError(
            "the map holds whole numbers as lengths, and their unit is not stated",
            where=f"image '{Path(path).name}'",
            value=f"{found[0]:.7g} to {found[1]:.7g} of {raster.levels - 1}",
            remedy="Say what one stands for: Values Are in the Dermis tab under Touch: Screen, or unit=1e-3 (mm) in a "
            "script",
            code="no-unit",
        )


def _merged(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return one finding a code, with the counts added: a sequence has hundreds of images."""
    by_code: dict[str, Finding] = {}
    for finding in findings:
        known = by_code.get(finding.code)
        if known is not None:
            finding = replace(known, count=known.count + finding.count)
        by_code[finding.code] = finding
    return tuple(by_code.values())

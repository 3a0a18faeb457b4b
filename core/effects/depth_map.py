"""Depth maps: heights over a touch screen, read, repaired, and every repair reported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from .. import images
from ..errors import DermisError, Finding
from .repair import FEWEST_LEVELS, filled, holes_in, smoothed, staircase

Meaning = Literal["height", "depth"]
Steps = Literal["smooth", "keep"]
MEANINGS: tuple[Meaning, ...] = ("height", "depth")


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Heights towards the viewer, ready for `core.scene.Screen.height_map`.

    Attributes:
        heights: row 0 at the bottom, float32, shape (rows, columns), or (k, rows, columns) for a sequence.
        findings: what was repaired or noticed.
    """

    heights: NDArray[np.float32]
    findings: tuple[Finding, ...] = ()


def read(
    source: str | Path | Sequence[str | Path],
    *,
    meaning: Meaning = "height",
    hole: float | None = None,
    steps: Steps = "smooth",
) -> DepthMap:
    """Read an image file, or several as a sequence in the order given.

    Whole-number formats run from 0 (black) to 1 (white); PFM and floating NPY are taken as stored.

    Args:
        source: a path, or paths (`core.images.sequence` finds the numbered siblings of one).
        meaning: 'height' towards the viewer, or 'depth' away from the viewer, which is negated.
        hole: a stored value that stands for 'nothing measured' (depth cameras write 0).
        steps: what to do with the staircases of 8-bit images.

    Raises:
        DermisError: no image, one that cannot be read, images of differing size, nothing but holes.
    """
    paths = [source] if isinstance(source, str | Path) else list(source)
    if not paths:
        raise DermisError("no image", where="depth map", remedy="Choose an image for the touch screen")
    rasters = [images.read(path) for path in paths]
    for raster, path in zip(rasters, paths, strict=True):
        if raster.values.shape != rasters[0].values.shape:
            raise DermisError(
                "the images of a sequence differ in size", where=f"image '{Path(path).name}'",
                value="{1} x {0}".format(*raster.values.shape), limit="{1} x {0}, as the first".format(*rasters[0].values.shape),
            )  # fmt: skip
    first = f"image '{Path(paths[0]).name}'"
    where = first if len(paths) == 1 else f"{first} and {len(paths) - 1} more"
    values, holes = np.stack([r.values for r in rasters]), np.stack([r.holes for r in rasters])
    if len(paths) == 1:
        values, holes = values[0], holes[0]
    noticed = tuple(f for r in rasters for f in r.findings)
    cleaned = from_array(values, meaning=meaning, hole=hole, steps=steps, declared=holes, where=where)
    return DepthMap(cleaned.heights, _merged(noticed) + cleaned.findings)


def from_array(
    values: NDArray[Any],
    *,
    meaning: Meaning = "height",
    first_row: Literal["bottom", "top"] = "bottom",
    hole: float | None = None,
    steps: Steps = "smooth",
    declared: NDArray[np.bool_] | None = None,
    where: str = "depth map",
) -> DepthMap:
    """Repair heights that are already numbers: a Blender image's pixels, or a bake of a mesh.

    Args:
        values: shape (rows, columns) or (k, rows, columns).
        first_row: which edge of the screen row 0 lies at (Blender's images: 'bottom').
        declared: pixels known to be empty, same shape as `values`.
        meaning, hole, steps: as for `read`.

    Raises:
        DermisError: not numbers, no pixels, another shape, nothing but holes.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "buif":
        raise DermisError("the map does not hold real numbers", where=where, value=str(array.dtype))
    if array.ndim not in (2, 3) or array.size == 0:
        raise DermisError("the map has no pixels", where=where, value=" x ".join(map(str, array.shape)) or "a number",
                          limit="rows x columns, at least 1 x 1", remedy="Choose another image")  # fmt: skip
    if meaning not in MEANINGS or first_row not in ("bottom", "top") or steps not in ("smooth", "keep"):
        raise DermisError("unknown way to read a map", where=where, value=f"{meaning}, {first_row}, {steps}",
                          limit="height or depth; bottom or top; smooth or keep")  # fmt: skip
    if declared is not None and declared.shape != array.shape:
        raise DermisError("the holes do not fit the map", where=where, value=declared.shape, limit=str(array.shape))
    heights = array.astype(np.float64)
    empty = holes_in(heights, declared)
    if hole is not None:
        empty |= heights == hole
    if first_row == "top":
        heights, empty = heights[..., ::-1, :], empty[..., ::-1, :]
    if meaning == "depth":
        heights = -heights
    stack, gaps = (heights, empty) if heights.ndim == 3 else (heights[None], empty[None])
    repaired, findings = _repaired(stack, gaps, steps, where)
    result = repaired.astype(np.float32).reshape(heights.shape)
    return DepthMap(np.ascontiguousarray(result), findings)


def _repaired(
    stack: NDArray[np.float64], gaps: NDArray[np.bool_], steps: Steps, where: str
) -> tuple[NDArray[np.float64], tuple[Finding, ...]]:
    findings: list[Finding] = []
    if gaps.all(axis=(1, 2)).any():
        index = int(np.flatnonzero(gaps.all(axis=(1, 2)))[0])
        raise DermisError("the map has no height anywhere: every pixel is a hole", where=where,
                          value=f"map {index + 1} of {len(stack)}", remedy="Check that the surface lies in view")  # fmt: skip
    holes = int(np.count_nonzero(gaps))
    # Looked for before holes are filled: the filling adds levels of its own.
    found = [staircase(np.where(g, v[~g].min(), v)) for v, g in zip(stack, gaps, strict=True)]
    result = np.empty_like(stack)
    stepped = 0
    for index, (heights, gap) in enumerate(zip(stack, gaps, strict=True)):
        whole = filled(np.where(gap, 0.0, heights), gap)
        if found[index].found and steps == "smooth":
            whole = smoothed(whole, found[index].step)
            stepped += 1
        result[index] = whole
    if holes:
        findings.append(Finding(
            "warning", "holes-filled", "pixels without a height were filled smoothly from their rims", where=where,
            value=f"{100.0 * holes / gaps.size:.3g} %", count=holes,
        ))  # fmt: skip
    if stepped:
        findings.append(Finding(
            "warning", "staircase-smoothed", "the heights are stored in few levels and were smoothed by up to half a level",
            where=where, value=f"{max(f.levels for f in found)} levels", limit="more than 256 levels",
            remedy="A 16-bit image keeps small slopes", count=stepped,
        ))  # fmt: skip
    elif any(f.found for f in found):
        findings.append(Finding(
            "warning", "staircase-kept", "the heights are stored in few levels, and each step will be felt", where=where,
            value=f"{max(f.levels for f in found)} levels", count=sum(f.found for f in found),
        ))  # fmt: skip
    flat = sum(1 for heights in result if heights.max() == heights.min())
    if flat:
        findings.append(Finding("warning", "flat-map", "the map is flat", where=where, count=flat,
                                remedy="Check that the right image was chosen"))  # fmt: skip
    few = sum(1 for f in found if 2 <= f.levels < FEWEST_LEVELS)
    if few:
        findings.append(Finding("info", "few-levels", "the map has only a few heights, which are kept as they are",
                                where=where, value=max(f.levels for f in found), count=few))  # fmt: skip
    return result, tuple(findings)


def _merged(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Return one finding a code, with the counts added: a sequence has hundreds of images."""
    by_code: dict[str, Finding] = {}
    for finding in findings:
        known = by_code.get(finding.code)
        if known is not None:
            finding = Finding(known.severity, known.code, known.what, known.where, known.value, known.limit,
                              known.remedy, known.frame, known.count + finding.count)  # fmt: skip
        by_code[finding.code] = finding
    return tuple(by_code.values())

"""MapRepair: map after map of a touch screen repaired, and every repair counted."""

from __future__ import annotations

from numbers import Real
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError, Finding, Severity
from .repair import FEWEST_LEVELS, MAX_LEVELS, filled, holds, holes_in, likely_holes, smoothed, staircase

Meaning = Literal["height", "depth"]
Steps = Literal["smooth", "keep"]
MEANINGS: tuple[Meaning, ...] = ("height", "depth")
STEPS: tuple[Steps, ...] = ("smooth", "keep")


class MapRepair:
    """Repairs map after map, and counts.

    Args:
        meaning, hole, steps, where: as for `depth_map.from_array`.

    Raises:
        DermisError: an unknown meaning or kind of steps, or a hole that is no number.
    """

    def __init__(self, meaning: Meaning, hole: float | None, steps: Steps, where: str) -> None:
        if meaning not in MEANINGS or steps not in STEPS:
            raise DermisError(
                "unknown way to read a map",
                where=where,
                value=f"{meaning}, {steps}",
                limit="height or depth; smooth or keep",
            )
        self._sign = -1.0 if meaning == "depth" else 1.0
        number = None if hole is None else number_of(hole, "hole", where)
        self._hole = None if number is None or np.isnan(number) else number  # no numbers are holes as it is
        self._smooth, self._where = steps == "smooth", where
        self._pixels = self._holes = self._smoothed = self._kept = self._flat = self._few = self._levels = 0
        self._zeros = self._asked = 0

    def repaired(
        self, values: NDArray[Any], declared: NDArray[np.bool_] | None, levels: int, where: str, white: int = 1
    ) -> NDArray[np.float64]:
        """Return one map's heights towards the viewer without holes and staircases, shape (rows, columns).

        Args:
            white: what the hole that was asked for is to be divided by.
        """
        with np.errstate(over="ignore"):  # beyond doubles is infinite, a hole
            heights = values.astype(np.float64)
        gaps = holes_in(heights, declared)
        if self._hole is not None:
            asked = holds(values, self._hole / white)
            self._asked += int(np.count_nonzero(asked))
            gaps |= asked
        elif self._sign < 0.0:
            self._zeros += likely_holes(heights[~gaps])
        known = ~gaps
        if not known.any():
            raise DermisError(
                "the map has no height anywhere: every pixel is a hole",
                where=where,
                remedy="Check that the surface lies in view",
            )
        self._pixels += gaps.size
        self._holes += int(np.count_nonzero(gaps))
        heights = np.where(known, self._sign * np.where(known, heights, 0.0), 0.0)
        # Looked for before holes are filled, because the filling adds levels of its own; and only where the format
        # has few levels: what floating point or a mesh climbs in steps was meant so.
        coarse = 0 < levels <= MAX_LEVELS
        found = staircase(np.where(known, heights, heights[known].min())) if coarse else None
        heights = filled(heights, gaps)
        if found is not None and found.found:
            self._levels = max(self._levels, found.levels)
            self._smoothed += self._smooth
            self._kept += not self._smooth
            heights = smoothed(heights, found.step) if self._smooth else heights
        self._few += found is not None and 2 <= found.levels < FEWEST_LEVELS
        self._flat += bool(heights.max() == heights.min())
        return heights

    def findings(self) -> tuple[Finding, ...]:
        """Return what was repaired and noticed, one finding a kind."""
        levels = f"{self._levels} levels"
        share, zeros = (f"{100.0 * n / max(self._pixels, 1):.3g} %" for n in (self._holes, self._zeros))
        rows: tuple[tuple[int, Severity, str, str, str | None, str], ...] = (
            (
                self._holes,
                "warning",
                "holes-filled",
                "pixels without a height were filled smoothly from their rims",
                share,
                "",
            ),
            (
                self._hole is not None and not self._asked,
                "warning" if self._hole else "info",  # a camera that missed nothing has no zeros
                "no-such-hole",
                "no pixel holds the value that stands for 'nothing measured'",
                None if self._hole is None else f"{self._hole:g}",
                "A file's whole numbers run from 0 to 1, unless a unit says what one of them stands for",
            ),
            (
                self._zeros,
                "warning",
                "zeros-like-holes",
                "pixels hold exactly 0, far from all others: depth cameras write 0 where they measured nothing, but "
                "here it is a depth, and cliffs",
                zeros,
                "Take them as holes: Zero Is a Hole in the Dermis tab under Screen, hole=0 in a script",
            ),
            (
                self._smoothed,
                "warning",
                "staircase-smoothed",
                "the heights are stored in few levels and were smoothed by up to half a level",
                levels,
                "A 16-bit image keeps small slopes",
            ),
            (
                self._kept,
                "warning",
                "staircase-kept",
                "the heights are stored in few levels: each step will be felt",
                levels,
                "A 16-bit image keeps small slopes",
            ),
            (self._flat, "warning", "flat-map", "the map is flat", None, "Check that the right image was chosen"),
            (
                self._few,
                "info",
                "few-levels",
                f"the map has fewer than {FEWEST_LEVELS} heights, which are kept",
                None,
                "",
            ),
        )
        return tuple(
            Finding(severity, code, what, self._where, value=value, remedy=remedy, count=count)
            for count, severity, code, what, value, remedy in rows
            if count
        )


def number_of(value: Any, name: str, where: str) -> float:
    """Return what somebody gave for a number.

    Raises:
        DermisError: it is none.
    """
    try:
        if isinstance(value, Real):
            return float(value)
    except OverflowError:  # a whole number beyond them all
        pass
    raise DermisError(f"the {name} must be a number", where=where, value=value)

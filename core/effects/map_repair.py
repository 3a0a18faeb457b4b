"""MapRepair: repairs of the height maps of a touch screen, with counts."""

from __future__ import annotations

import re
from collections.abc import Sequence
from numbers import Real
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError, Finding, Severity
from .repair import (
    CUSTOMARY,
    FEWEST_LEVELS,
    MAX_LEVELS,
    filled,
    holds,
    holes_in,
    likely_holes,
    likely_no_data,
    smoothed,
    staircase,
)

Meaning = Literal["height", "depth"]
Steps = Literal["smooth", "keep"]
NoData = float | Literal["none"] | Sequence[float | Literal["none"]] | None
MEANINGS: tuple[Meaning, ...] = ("height", "depth")
STEPS: tuple[Steps, ...] = ("smooth", "keep")


class MapRepair:
    """Repair the maps of a sequence one by one, and count the repairs.

    Args:
        meaning, no_data, steps, where: as for `depth_map.from_array`.

    Raises:
        DermisError: `meaning` or `steps` is unknown, or `no_data` has an entry that is neither a number nor 'none'.
    """

    def __init__(self, meaning: Meaning, no_data: NoData, steps: Steps, where: str) -> None:
        if meaning not in MEANINGS or steps not in STEPS:
            raise DermisError(
                "unknown kind of map or treatment of steps",
                where=where,
                value=f"{meaning}, {steps}",
                limit="height or depth; smooth or keep",
            )
        self._sign = -1.0 if meaning == "depth" else 1.0
        said = () if no_data is None else no_data if isinstance(no_data, list | tuple) else (no_data,)
        self._asks = "none" not in said
        numbers = [number_of(value, "no_data", where) for value in said if value != "none"]
        self._held = {number: 0 for number in numbers if not np.isnan(number)}  # NaN is a hole in any case
        self._smooth, self._where = steps == "smooth", where
        self._pixels = self._holes = self._smoothed = self._kept = self._flat = self._few = self._levels = 0
        self._zeros = 0
        self._likely: dict[float, int] = {}

    def repaired(
        self,
        values: NDArray[Any],
        declared: NDArray[np.bool_] | None,
        levels: int,
        where: str,
        *,
        largest: float = 1.0,
        signed: bool = False,
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the repaired heights of a map, and its holes.

        The heights are towards the viewer. Heights and holes have the shape (rows, columns).

        Args:
            values: heights or depths as read, shape (rows, columns).
            declared: pixels that are known to be empty, booleans, same shape; None if there are none.
            levels: number of levels of the file's format; 0 for floating point and for heights of a mesh.
            where: name of the map in an error.
            largest: number in the file that a value of 1 stands for.
            signed: whether the file's type has whole numbers below 0.

        Raises:
            DermisError: every pixel is a hole.
        """
        with np.errstate(over="ignore"):  # a number too large for float64 becomes infinite, which is a hole
            heights = values.astype(np.float64)
        gaps = holes_in(heights, declared)
        for number in self._held:
            asked = holds(values, number / largest)
            self._held[number] += int(np.count_nonzero(asked))
            gaps |= asked
        if self._asks and not gaps.all():  # search the other pixels: a stated number may hide more
            self._look(heights[~gaps] if gaps.any() else heights.ravel(), values.dtype, levels, largest, signed)
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
        # Staircases are found before holes are filled, because filling adds levels. They are found only in formats
        # with few levels, since steps in floating-point numbers or in heights of a mesh are intended.
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
        return heights, gaps

    def _look(self, heights: Array, kind: np.dtype, levels: int, largest: float, signed: bool) -> None:
        """Count the pixels that likely stand for 'no data'.

        Args:
            heights: values of the pixels that are no holes, shape (n,).
            kind: type in which they were read.
            levels, largest, signed: as for `repaired`.
        """
        coarse = 0 < levels <= MAX_LEVELS
        zeros = likely_holes(heights, coarse=coarse) if self._sign < 0.0 else 0
        self._zeros += zeros
        if zeros or coarse:  # few levels are brightness, so white and black are heights
            return
        stored = [*CUSTOMARY, *((largest,) if levels else ()), *((-largest - 1.0,) if levels and signed else ())]
        ends = np.array(stored) / largest
        ends = (ends.astype(kind) if kind.kind == "f" else ends).astype(np.float64)
        found = likely_no_data(heights, ends.tolist())
        if found is not None:
            number = stored[int(np.argmin(np.abs(ends - found[0])))]  # as stored, without single precision
            if found[0] not in ends:
                number = float(round(found[0] * largest)) if levels else found[0] * largest
            self._likely[number] = self._likely.get(number, 0) + found[1]

    def findings(self) -> tuple[Finding, ...]:
        """Return one finding for each kind of repair or warning."""
        levels = f"{self._levels} levels"
        share, zeros = (f"{100.0 * n / max(self._pixels, 1):.3g} %" for n in (self._holes, self._zeros))
        missing = [number for number, held in self._held.items() if not held]
        likely, count = max(self._likely.items(), key=lambda item: item[1], default=(0.0, 0))
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
                len(missing),
                "warning" if any(missing) else "info",  # 0 may be absent: a camera that measured every pixel has none
                "no-such-hole",
                "no pixel has the value that means 'not measured'",
                ", ".join(f"{number:.9g}" for number in missing),
                "Give the number as the file stores it, such as 65535",
            ),
            (
                self._zeros,
                "warning",
                "zeros-like-holes",
                "pixels hold exactly 0, far from all others: depth cameras write 0 where they measured nothing, but "
                "here it is a depth, and cliffs",
                zeros,
                say_no_data(0.0, tuple(self._held)),
            ),
            (
                count,
                "warning",
                "no-data-likely",
                "many pixels hold one number that stands apart from all others, as files write 'no data', but here it "
                "is a height, and cliffs",
                _words(likely),
                say_no_data(likely, tuple(self._held)),
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


def no_data_of(text: str, where: str) -> NoData:
    """Return the `no_data` of `depth_map.read` that a user's text states.

    The text is empty, which gives None, or has numbers and 'none', separated by spaces or semicolons.

    Raises:
        DermisError: the text has another word.
    """
    words = re.sub(r";|,(?=\s|$)", " ", text.lower()).split()
    try:
        said: list[float | Literal["none"]] = [
            "none" if word == "none" else float(word.replace(",", ".")) for word in words
        ]
    except ValueError as error:
        limit = "numbers as the file stores them, such as -9999 or '65535; 0'; or 'none'"
        raise DermisError("not a number that can mean 'no data'", where=where, value=text, limit=limit) from error
    return None if not said else said[0] if len(said) == 1 else tuple(said)


def say_no_data(number: float, said: Sequence[float]) -> str:
    """Return how a user can state whether a number stands for 'no data'.

    Args:
        number: the number, as the file stores it.
        said: numbers that the user has stated already.
    """
    answers = [[*map(_words, said), answer] for answer in (_words(number), "none")]
    field = " or ".join("; ".join(words) for words in answers)
    option = " or ".join(" ".join(f"--no-data {word}" for word in words) for words in answers)
    quoted = [", ".join(word if word != "none" else "'none'" for word in words) for words in answers]
    script = " or ".join(f"no_data=({words})" if said else f"no_data={words}" for words in quoted)
    return (
        f"Say which: No Data {field} in the Dermis tab under Touch: Screen; {option} on the command line; "
        f"{script} in a script"
    )


def _words(number: float) -> str:
    return str(int(number)) if abs(number) < 1e15 and number == round(number) else repr(number)


def number_of(value: Any, name: str, where: str) -> float:
    """Return a user's value as a float.

    Args:
        value: any value.
        name: name of the value in the error.

    Raises:
        DermisError: the value is no number, or is too large for a float.
    """
    try:
        if isinstance(value, Real):
            return float(value)
    except OverflowError:  # a whole number too large for a float
        pass
    raise DermisError(f"the {name} must be a number", where=where, value=value)

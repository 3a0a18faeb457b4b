"""Frequency response of one actuator, and its inverse for tracks.

At frequency f the actuator reaches `gain(f)` times its driven value, and lags by `-phase(f)`. The gain is relative
to slow movement, so it is 1 at 0 Hz. Slow movement itself is described by the other parts of `calibration.Entry`: zero,
gain and measured curve. The logarithm of the gain, and the phase, are linear between measured frequencies.

The whole of a track is known beforehand, so its spectrum can be divided by the response. The future of a live command
is not known, so live commands are not changed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..column_names import ANGLES
from ..errors import DermisError
from ..foreign import json_of
from ..number_rows import read_rows
from .gain_curve import gain_between
from .measured_day import age_of, check_day

Points = tuple[tuple[float, float, float], ...]  # frequency [Hz], gain [1], phase [rad]

FIELDS = ("points", "measured_on", "valid_days")
MOST_POINTS = 1000
WHERE = "frequency response"
# Smallest and largest gain that is accepted. The inverse multiplies the driven value, and each error of a reading, by
# 1 / gain.
LEAST_GAIN, MOST_GAIN = 0.1, 10.0
# [rad] Largest change of phase from one measured frequency to the next. Phases are known except for whole turns, so a
# larger change may lack a turn.
TURN = 0.5 * math.pi
# Largest share of a channel's movement (RMS) beyond the last measured frequency. There the response of that frequency
# is used. Even if its gain is wrong by the whole amount, the movement changes by no more than this share.
BEYOND = 0.05
# [s] Shortest and longest duration of each of the three parts that `_padded` appends to a track, so that the end of the
# track does not act on its start.
SHORTEST_PAD, LONGEST_PAD = 1.0, 10.0


@dataclass(frozen=True)
class FrequencyResponse:
    """Gain and phase of one actuator at each frequency.

    Attributes:
        points: points (frequency [Hz], gain [1], phase [rad]) of rising frequency. A negative phase is a lag.
        measured_on: day of the measurement, such as '2026-11-27'; '' if it is not known.
        valid_days: number of days for which the measurement may be used; 0 for no limit.

    Raises:
        DermisError: the points are no response of an actuator or cannot be inverted, or the day is invalid.
    """

    points: Points
    measured_on: str = ""
    valid_days: int = 0

    def __post_init__(self) -> None:
        _check_points(self.points)
        check_day(self.measured_on, self.valid_days, WHERE)

    @classmethod
    def of(cls, plain: Mapping[str, Any]) -> FrequencyResponse:
        """Read a response from the values that `plain` returned.

        Raises:
            DermisError: a field is missing or unknown, or the points are no response of an actuator.
        """
        if not isinstance(plain, dict) or set(plain) != set(FIELDS):
            raise DermisError("fields missing or unknown", where=WHERE, limit=", ".join(FIELDS))
        rows = plain["points"]
        if not isinstance(rows, list) or not all(isinstance(row, list) and len(row) == 3 for row in rows):
            raise DermisError("the points must be a list of frequency, gain, phase", where=WHERE)
        return cls(**{**plain, "points": tuple((row[0], row[1], row[2]) for row in rows)})

    @classmethod
    def loads(cls, text: str, *, where: str = WHERE) -> FrequencyResponse:
        """Read a response from the text that `dumps` returned.

        Raises:
            DermisError: the text is not JSON, or is no response of an actuator.
        """
        return cls.of(json_of(text, where))

    def dumps(self) -> str:
        """Return the response as JSON text; equal responses give equal text."""
        return json.dumps(self.plain(), allow_nan=False)

    def plain(self) -> dict[str, Any]:
        """Return the response as JSON values."""
        return {**{name: getattr(self, name) for name in FIELDS}, "points": [list(point) for point in self.points]}

    @property
    def span(self) -> tuple[float, float]:
        """Lowest and highest measured frequency [Hz]."""
        return self.points[0][0], self.points[-1][0]

    @property
    def peak(self) -> tuple[float, float]:
        """Frequency at which the gain is farthest from 1 [Hz], and the gain there."""
        hertz, gain, _ = max(self.points, key=lambda point: abs(math.log(point[1])))
        return hertz, gain

    def age(self, today: Any) -> int | None:
        """Return the days since the measurement; None if its day is unknown."""
        return age_of(self.measured_on, today)

    def at(self, hertz: Array) -> NDArray[np.complex128]:
        """Return the complex response at frequencies [Hz].

        Beyond the last measured frequency it is the response at that frequency.
        """
        grid, gain, phase = self._lines
        return gain_between(hertz, grid, gain) * np.exp(1j * np.interp(hertz, grid, phase))

    def beyond(self, values: Array, rate: float) -> float:
        """Return the share of a movement (RMS) beyond the last measured frequency.

        Args:
            values: values of the movement at equal steps of time, shape (n,).
            rate: values per second [Hz].
        """
        padded = self._padded(values, rate)
        power = np.abs(np.fft.rfft(padded - padded.mean())) ** 2
        past = np.fft.rfftfreq(len(padded), 1.0 / rate) > self.span[1]
        whole = float(power.sum())
        return math.sqrt(float(power[past].sum()) / whole) if whole > 0.0 else 0.0

    def inverted(self, values: Array, rate: float, late: float = 0.0) -> Array:
        """Return the values to drive so that the actuator makes a movement.

        Args:
            values: values of the movement at equal steps of time, shape (n,). The actuator is at rest before and after.
            rate: values per second [Hz].
            late: delay that the movement shall have [s].
        """
        if len(values) < 2 or not np.ptp(values) > 0.0:
            return values
        padded = self._padded(values, rate)
        hertz = np.fft.rfftfreq(len(padded), 1.0 / rate).astype(np.float64)
        spectrum = np.fft.rfft(padded - values[0]) * np.exp(-2j * math.pi * late * hertz) / self.at(hertz)
        return values[0] + np.fft.irfft(spectrum, len(padded))[: len(values)]

    @cached_property
    def _lines(self) -> tuple[Array, Array, Array]:
        """Frequencies from 0 Hz on, logarithms of the gain, and phases [rad].

        The phases have no jumps by whole turns.
        """
        table = np.array(((0.0, 1.0, 0.0), *self.points))
        return table[:, 0], np.log(table[:, 1]), np.unwrap(table[:, 2])

    def _padded(self, values: Array, rate: float) -> Array:
        """Return a movement that is followed by a slow return to its start.

        The Fourier transform joins the end of a movement to its start. A step there would disturb the inverse.
        """
        finest = float(np.diff(self._lines[0]).min())
        count = math.ceil(min(max(SHORTEST_PAD, 1.0 / finest), LONGEST_PAD) * rate)
        back = 0.5 + 0.5 * np.cos(np.pi * np.arange(1, count + 1) / (count + 1))
        hold = np.full(count, values[-1]), np.full(count, values[0])
        return np.concatenate([values, hold[0], values[0] + (values[-1] - values[0]) * back, hold[1]])


def of_text(text: str, **more: Any) -> FrequencyResponse:
    """Read a response from text such as '20 1.0 -5; 50 1.1 -20'.

    Args:
        text: frequency [Hz], gain and phase [degrees] of each point, with semicolons between points.
        more: the other attributes of `FrequencyResponse`: measured_on and valid_days.

    Raises:
        DermisError: a point is not three numbers, or the points are no response of an actuator.
    """
    rows = [row.replace(":", " ").split() for row in text.split(";") if row.strip()]
    try:
        numbers = [(float(a), float(b), float(c) * ANGLES["deg"]) for a, b, c in rows]
    except ValueError:
        raise DermisError(
            "each reading needs three numbers",
            where=WHERE,
            value=text[:80],
            limit="'frequency [Hz] gain phase [deg]; ...'",
        ) from None
    return FrequencyResponse(tuple(sorted(numbers)), **more)


def read_csv(path: Path, **more: Any) -> FrequencyResponse:
    """Read a response from a CSV file.

    The columns are 'frequency [Hz]', 'gain' (or 'gain [dB]') and 'phase [deg]' (or 'phase [rad]'), in any order. A gain
    without a unit is a ratio. The name of the phase must have a unit.

    Args:
        path: path of the file.
        more: as in `of_text`.

    Raises:
        DermisError: the file cannot be read, has no such columns, or its points are no response of an actuator.
    """
    rows = read_rows(path)
    columns = {}
    for what, units in (
        ("frequency", {"": 1.0, "hz": 1.0, "khz": 1e3}),
        ("gain", {"": 0.0, "1": 0.0, "db": math.log(10.0) / 20.0}),
        ("phase", {"deg": ANGLES["deg"], "rad": 1.0}),
    ):
        found = [k for k, name in enumerate(rows.names) if name.lower().lstrip("# ").startswith(what)]
        if len(found) != 1:
            raise DermisError(
                f"no column, or more than one, is called '{what}'",
                where=str(path),
                value=", ".join(rows.names)[:80] or "no line of names",
                limit="'frequency [Hz]', 'gain' or 'gain [dB]', 'phase [deg]'",
            )
        name = rows.names[found[0]].lower().lstrip("# ")
        unit = name.removeprefix(what).strip(" _[]()")
        if unit not in units:
            raise DermisError(
                f"the unit of the {what} is not known",
                where=f"{path}, column '{rows.names[found[0]]}'",
                value=unit or "none",
                limit=", ".join(u or "none" for u in units),
            )
        column, factor = rows.values[:, found[0]], units[unit]
        columns[what] = np.exp(factor * column) if what == "gain" and factor else column * (factor or 1.0)
        if bad := np.flatnonzero(~np.isfinite(columns[what])).tolist():
            raise DermisError("a reading is missing or not finite", where=rows.place(bad[0], found[0]))
    table = np.column_stack([columns[what] for what in ("frequency", "gain", "phase")])
    try:
        return FrequencyResponse(tuple(sorted((a, b, c) for a, b, c in table.tolist())), **more)
    except DermisError as error:
        raise error.changed(where=f"{path}: {error.where}") from error


def _check_points(points: Points) -> None:
    if not 2 <= len(points) <= MOST_POINTS:
        raise DermisError(
            "too few or too many frequencies", where=WHERE, value=len(points), limit=f"2 to {MOST_POINTS}"
        )
    before, turned = 0.0, 0.0
    for hertz, gain, phase in points:
        if not all(type(value) in (int, float) and abs(value) < 1e6 for value in (hertz, gain, phase)):
            raise DermisError("a point is not three finite numbers", where=WHERE, value=str((hertz, gain, phase))[:80])
        place = f"{WHERE}, {hertz:g} Hz"
        if not hertz > before:
            raise DermisError("frequencies do not rise above 0", where=place, value=hertz, limit=f"> {before:g} Hz")
        if not LEAST_GAIN <= gain <= MOST_GAIN:
            raise DermisError(
                "the gain is too small here, so the response cannot be inverted"
                if gain < LEAST_GAIN
                else "the gain is out of range",
                where=place,
                value=f"{gain:.4g}",
                limit=f"{LEAST_GAIN:g} to {MOST_GAIN:g} times slow movement",
                remedy="Leave that frequency out: tracks beyond the last frequency are then refused"
                if gain < LEAST_GAIN
                else "Write the ratio to slow movement, or name the column 'gain [dB]'",
            )
        step = (phase - turned + math.pi) % (2.0 * math.pi) - math.pi
        if abs(step) > TURN:
            raise DermisError(
                "the phase changes by so much that a turn may be missing",
                where=place,
                value=f"{math.degrees(step):.0f} degrees from {before:g} Hz",
                limit=f"{math.degrees(TURN):.0f} degrees",
                remedy="Measure frequencies between the two; slow movement has the phase 0",
            )
        before, turned = hertz, phase

"""Measured curves of one actuator: reached values over driven values.

An actuator with play, or with friction in its gear, reaches less on the way up than on the way down. After a reversal
it holds still at first. The model is a generalized play operator: the reached value lies between the rising and the
falling curve, and moves only if one of them pushes it (Krasnosel'skii and Pokrovskii, *Systems with Hysteresis*,
Springer 1989). Its inverse is exact: the rising curve gives the driven value on the way up, the falling curve on the
way down. While the wanted value does not change, the driven value does not change.
"""

from __future__ import annotations

import json
import math
from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from ..foreign import json_of
from .measured_day import age_of, check_day

Points = tuple[tuple[float, float], ...]  # driven, reached

FIELDS = ("rising", "falling", "scatter", "latency", "measured_on", "valid_days")
MOST_POINTS = 1000
# Largest ratio of a curve's mean slope to its least slope. The inverse multiplies an error of a reading by 1 / slope.
STEEPEST = 10.0
# Largest ratio of the reached to the driven range, and of the driven to the reached range. If it is larger, the values
# probably have different units.
FACTOR = 2.0
# [share of the reached range] Longest reversal that is ignored. Noise would otherwise make an actuator jump by its play
# again and again. It is half of the error that is allowed for an inverse.
REVERSAL = 5e-4
# [share of the reached range] The falling curve may be below the rising one by this, or by the scatter if it is larger.
CROSSING = 1e-3
LONGEST_LATENCY = 1.0  # [s] largest latency that is accepted


@dataclass(frozen=True)
class Response:
    """Measured curves of one actuator.

    Attributes:
        rising, falling: points (driven, reached) of the way up and of the way down [unit of the channel]. Both values
            rise from point to point. The two curves are equal if play was not measured.
        scatter: largest difference between repeated readings [unit]; 0 if none was repeated.
        latency: delay from a command to the movement [s].
        measured_on: day of the measurement, such as '2026-11-27'; '' if it is not known.
        valid_days: number of days for which the measurement may be used; 0 for no limit.

    Raises:
        DermisError: the points are no curve of an actuator, or another attribute is invalid.
    """

    rising: Points
    falling: Points
    scatter: float = 0.0
    latency: float = 0.0
    measured_on: str = ""
    valid_days: int = 0

    def __post_init__(self) -> None:
        for name in ("rising", "falling"):
            _check_points(getattr(self, name), name)
        for name, most in (("scatter", math.inf), ("latency", LONGEST_LATENCY)):
            value = getattr(self, name)
            if type(value) not in (int, float) or not 0.0 <= value <= most or value == math.inf:
                raise DermisError(f"'{name}' cannot be", where="measured curve", value=value, limit=f"0 to {most:g}")
        check_day(self.measured_on, self.valid_days, "measured curve")
        low, high = self.reach
        crossing = max(-gap for gap in self._apart())
        if crossing > max(CROSSING * (high - low), self.scatter):
            raise DermisError(
                "the curve on the way down lies below the one on the way up",
                where="measured curve",
                value=f"by {crossing:.4g}",
                remedy="Exchange them: an actuator with play reaches less on its way up",
            )

    @classmethod
    def of(cls, plain: Mapping[str, Any]) -> Response:
        """Read a response from the values that `plain` returned.

        Raises:
            DermisError: a field is missing or unknown, or the points are no curve of an actuator.
        """
        if not isinstance(plain, dict) or set(plain) != set(FIELDS):
            raise DermisError("fields missing or unknown", where="measured curve", limit=", ".join(FIELDS))
        curves = {}
        for name in ("rising", "falling"):
            rows = plain[name]
            if not isinstance(rows, list) or not all(isinstance(row, list) and len(row) == 2 for row in rows):
                raise DermisError("a curve is a list of pairs: driven, reached", where=f"measured curve, {name}")
            curves[name] = tuple((row[0], row[1]) for row in rows)
        return cls(**{**plain, **curves})

    @classmethod
    def loads(cls, text: str, *, where: str = "measured curve") -> Response:
        """Read a response from the text that `dumps` returned.

        Raises:
            DermisError: the text is not JSON, or is no curve of an actuator.
        """
        return cls.of(json_of(text, where))

    def dumps(self) -> str:
        """Return the response as JSON text; equal responses give equal text."""
        return json.dumps(self.plain(), allow_nan=False)

    def plain(self) -> dict[str, Any]:
        """Return the response as JSON values."""
        curves = {name: [list(point) for point in getattr(self, name)] for name in ("rising", "falling")}
        return {**{name: getattr(self, name) for name in FIELDS}, **curves}

    @cached_property
    def _up(self) -> _Line:
        return _Line.of(self.rising)

    @cached_property
    def _down(self) -> _Line:
        return _Line.of(self.falling)

    @cached_property
    def _middle(self) -> _Line:
        """Mean of both curves, with a point at each point of either."""
        driven = sorted({*self.span, *(point[0] for curve in (self.rising, self.falling) for point in curve)})
        return _Line.of(tuple((value, self.between(value)) for value in driven))

    @cached_property
    def span(self) -> tuple[float, float]:
        """Smallest and largest driven value that was measured [unit].

        Values beyond are never driven, because their reached values are unknown.
        """
        driven = [point[0] for curve in (self.rising, self.falling) for point in curve]
        return min(driven), max(driven)

    @cached_property
    def reach(self) -> tuple[float, float]:
        """Smallest and largest reached value that was measured [unit]."""
        reached = [point[1] for curve in (self.rising, self.falling) for point in curve]
        return min(reached), max(reached)

    @property
    def play(self) -> float:
        """Largest height of the falling curve above the rising one [unit]."""
        return max(*self._apart(), 0.0)

    def _apart(self) -> list[float]:
        """Return heights of the falling curve above the rising one [unit].

        They are at equal steps of the driven values at which both curves were measured.
        """
        low = max(self.rising[0][0], self.falling[0][0])
        high = min(self.rising[-1][0], self.falling[-1][0])
        if low >= high:
            raise DermisError(
                "the curves up and down cover different ranges",
                where="measured curve",
                value=f"{self.rising[0][0]:.4g} to {self.rising[-1][0]:.4g}, {self.falling[0][0]:.4g} to "
                f"{self.falling[-1][0]:.4g}",
                remedy="Measure both from one end to the other",
            )
        return [self.falls(driven) - self.rises(driven) for driven in np.linspace(low, high, 257).tolist()]

    def rises(self, driven: float) -> float:
        """Return the reached value on the way up [unit]."""
        return self._up.reached(driven)

    def falls(self, driven: float) -> float:
        """Return the reached value on the way down [unit]."""
        return self._down.reached(driven)

    def between(self, driven: float) -> float:
        """Return the reached value for an unknown direction [unit].

        It is the mean of both curves.
        """
        return 0.5 * (self.rises(driven) + self.falls(driven))

    def drives(self, wanted: float) -> float:
        """Return the value to drive if the direction is unknown [unit].

        The value that is then reached is off by at most half the play.
        """
        return min(max(self._middle.driven(wanted), self.span[0]), self.span[1])

    def follow(self, reached: float, driven: float) -> float:
        """Return the value reached by a driven value [unit].

        Args:
            reached: value reached before [unit]; NaN if it is unknown.
            driven: driven value [unit].
        """
        if math.isnan(reached):
            return self.between(driven)
        return min(max(reached, self.rises(driven)), self.falls(driven))

    def to_drive(self, wanted: float, reached: float, way: float, last: float) -> float:
        """Return the value to drive so that a wanted value is reached [unit].

        Args:
            wanted: value within `reach` [unit].
            reached: value reached now [unit].
            way: direction of the last movement: 1 up, -1 down, 0 unknown.
            last: value driven now [unit].
        """
        if wanted == reached:
            return last
        up = wanted > reached
        low, high = self.reach
        turned = way != (1.0 if up else -1.0) and self.rising != self.falling
        if turned and abs(wanted - reached) <= REVERSAL * (high - low):
            return last
        driven = (self._up if up else self._down).driven(wanted)
        return min(max(driven, self.span[0]), self.span[1])

    def age(self, today: date) -> int | None:
        """Return the days since the measurement; None if its day is unknown."""
        return age_of(self.measured_on, today)


class Believed(NamedTuple):
    """Estimate of where actuators are, from their driven values.

    Attributes:
        reached: reached values [units], shape (channels,); NaN for channels without a curve.
        way: directions of the last movements, shape (channels,): 1 up, -1 down, 0 unknown.
    """

    reached: Array
    way: Array


@dataclass(frozen=True)
class Responses:
    """The measured curves of a device's channels.

    Attributes:
        curves: curves by index of the channel; a channel may have none.
        lower, upper: limits of driven and of reached values [units], shape (channels,).
    """

    curves: Mapping[int, Response]
    lower: Array
    upper: Array

    def __bool__(self) -> bool:
        return bool(self.curves)

    @cached_property
    def reachable(self) -> tuple[Array, Array]:
        """Smallest and largest value that each channel can reach [units].

        They are within the limits and, if a channel has a curve, within the curve.
        """
        low, high = self.lower.copy(), self.upper.copy()
        for k, curve in self.curves.items():
            low[k], high[k] = max(low[k], curve.reach[0]), min(high[k], curve.reach[1])
        return low, high

    def believe(self, driven: Array, before: Believed | None = None) -> Believed:
        """Return an estimate of where the actuators are after values were driven.

        Args:
            driven: driven values [units], shape (channels,).
            before: estimate before that; None if it is unknown.
        """
        reached, way = np.full(len(driven), math.nan), np.zeros(len(driven))
        for k, curve in self.curves.items():
            old = math.nan if before is None else float(before.reached[k])
            reached[k] = curve.follow(old, float(driven[k]))
            moved = float(np.sign(reached[k] - old)) if not math.isnan(old) else 0.0
            way[k] = moved or (0.0 if before is None else float(before.way[k]))
        return Believed(reached, way)

    def driven(self, wanted: Array, now: Believed | None, last: Array) -> tuple[Array, Array]:
        """Return the values to drive, and limitations of the wanted ones [units].

        A limitation is the amount by which a wanted value was limited. The limits hold for wanted values too, because a
        value that must not be driven must not be reached either. Channels without a curve are driven as wanted, and not
        limited here.

        Args:
            wanted: wanted values [units], shape (channels,).
            now: estimate of where the actuators are; None if it is unknown.
            last: values driven now [units], shape (channels,).
        """
        driven, limited, (low, high) = wanted.copy(), np.zeros(len(wanted)), self.reachable
        for k, curve in self.curves.items():
            if not math.isfinite(wanted[k]):
                continue
            held = min(max(float(wanted[k]), float(low[k])), float(high[k]))
            limited[k] = abs(held - wanted[k])
            if now is None:
                driven[k] = curve.drives(held)
            else:
                driven[k] = curve.to_drive(held, float(now.reached[k]), float(now.way[k]), float(last[k]))
        return driven, limited

    def reached(self, driven: Array) -> Array:
        """Return the reached values for driven ones [units], shape (channels,).

        The directions of the movements count as unknown. Channels without a curve reach the driven value.
        """
        reached = driven.copy()
        for k, curve in self.curves.items():
            reached[k] = curve.between(float(driven[k]))
        return reached


class _Line(NamedTuple):
    """Line through points, extended straight beyond its ends.

    It is evaluated for one sample at a time, so numpy is not used.
    """

    x: list[float]
    y: list[float]

    @classmethod
    def of(cls, points: Points) -> _Line:
        return cls([float(point[0]) for point in points], [float(point[1]) for point in points])

    def reached(self, driven: float) -> float:
        return _between(driven, self.x, self.y)

    def driven(self, reached: float) -> float:
        return _between(reached, self.y, self.x)


def _between(at: float, x: list[float], y: list[float]) -> float:
    k = min(max(bisect_right(x, at) - 1, 0), len(x) - 2)
    if at == x[k + 1]:
        return y[k + 1]
    return y[k] + (at - x[k]) * ((y[k + 1] - y[k]) / (x[k + 1] - x[k]))


def _check_points(points: Points, name: str) -> None:
    where = f"measured curve, {name}"
    if not 2 <= len(points) <= MOST_POINTS:
        raise DermisError(
            "a curve has too few or too many points", where=where, value=len(points), limit=f"2 to {MOST_POINTS}"
        )
    for point in points:
        for value in point:
            if type(value) not in (int, float) or not abs(value) < 1e12:
                raise DermisError("a point is not a pair of finite numbers", where=where, value=str(point)[:80])
    table = np.array(points, np.float64)
    for column, what in ((0, "driven"), (1, "reached")):
        step = np.diff(table[:, column])
        if not (step > 0).all():
            k = int(np.argmax(step <= 0))
            raise DermisError(
                f"what is {what} does not rise from point to point, so the curve cannot be inverted",
                where=f"{where}, points {k + 1} and {k + 2}",
                value=f"{table[k, column]:.6g}, {table[k + 1, column]:.6g}",
                remedy="Measure that part again, leave it out, or turn a motor that is mounted the other way round by "
                "a gain of -1",
            )
    whole = float(np.ptp(table[:, 1]) / np.ptp(table[:, 0]))
    if not 1 / FACTOR <= whole <= FACTOR:
        raise DermisError(
            "the reached position differs too much from the driven one",
            where=where,
            value=f"{whole:.4g} times as much",
            limit=f"{1 / FACTOR:g} to {FACTOR:g} times",
            remedy="Write both in the channel's unit, in SI, or name their units in the CSV's line of names",
        )
    slope = np.diff(table[:, 1]) / np.diff(table[:, 0])
    if slope.min() * STEEPEST < whole:
        k = int(slope.argmin())
        raise DermisError(
            "the slope is too small here, so the curve cannot be inverted",
            where=f"{where}, points {k + 1} and {k + 2}",
            value=f"{slope[k]:.3g} driven to reached",
            limit=f">= {whole / STEEPEST:.3g}",
            remedy="Leave that part out: the calibrated device does not go there",
        )

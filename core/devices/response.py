"""How one actuator of a built device answers: measured curves of its reached over its driven value.

An actuator with play, or friction in its gear, reaches less on the way up than on the way down, and holds still at
first where it is turned round. It is taken as a generalized play operator: its reached value lies between both curves,
and moves only when one of them pushes it (Krasnosel'skii and Pokrovskii, *Systems with Hysteresis*, Springer 1989).
That is inverted exactly: upwards by the rising curve, downwards by the falling one; where it holds still it is held.
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
# An error of a reading comes out of the inverse at most this many times as large: flatter parts are refused.
STEEPEST = 10.0
# A built actuator goes as far as its preset says, within this factor: numbers beyond it are of another unit.
FACTOR = 2.0
# A way back that is shorter [of the reached range] is not followed, so that noise does not make an actuator jump by its
# play again and again. It is half of the error that an inverse may have.
REVERSAL = 5e-4
CROSSING = 1e-3  # curves that cross by less [of the reached range], or by less than the scatter, are one there
LONGEST_LATENCY = 1.0  # [s]


@dataclass(frozen=True)
class Response:
    """Measured curves of one actuator.

    Attributes:
        rising, falling: (driven, reached) on the way up and down [unit of the channel], each with both rising. The same
            where play was not measured.
        scatter: how far repeated readings are apart at most [unit]; 0 where nothing was repeated.
        latency: from a command until the actuator answers [s].
        measured_on: day, such as '2026-11-27'; '' where nobody says. valid_days: how long it may be used; 0: for ever.

    Raises:
        DermisError: points that are no curve of an actuator; says which.
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
        """Read a response that `plain` gave.

        Raises:
            DermisError: fields missing or unknown, or no curve of an actuator.
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
        """Read a response that `dumps` gave.

        Raises:
            DermisError: no JSON, or no curve of an actuator.
        """
        return cls.of(json_of(text, where))

    def dumps(self) -> str:
        """Return it as JSON; equal ones give equal text."""
        return json.dumps(self.plain(), allow_nan=False)

    def plain(self) -> dict[str, Any]:
        """Return it as JSON values."""
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
        """The middle of both curves: straight between points of either, as both are."""
        driven = sorted({*self.span, *(point[0] for curve in (self.rising, self.falling) for point in curve)})
        return _Line.of(tuple((value, self.between(value)) for value in driven))

    @cached_property
    def span(self) -> tuple[float, float]:
        """Least and most that was driven [unit]: the answer beyond is unknown, so nothing beyond is driven."""
        driven = [point[0] for curve in (self.rising, self.falling) for point in curve]
        return min(driven), max(driven)

    @cached_property
    def reach(self) -> tuple[float, float]:
        """Least and most that the actuator reaches [unit]."""
        reached = [point[1] for curve in (self.rising, self.falling) for point in curve]
        return min(reached), max(reached)

    @property
    def play(self) -> float:
        """Largest difference between the reached values of both ways, at the same driven value [unit]."""
        return max(*self._apart(), 0.0)

    def _apart(self) -> list[float]:
        """Return by how much the falling curve is above the rising one, where both were measured [unit]."""
        low = max(self.rising[0][0], self.falling[0][0])
        high = min(self.rising[-1][0], self.falling[-1][0])
        if low >= high:
            raise DermisError(
                "the ways up and down were measured in different places",
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
        """Return the reached value where nobody knows the way: the middle of both."""
        return 0.5 * (self.rises(driven) + self.falls(driven))

    def drives(self, wanted: float) -> float:
        """Return the driven value for a wanted one where nobody knows the way [unit]: off by half the play at most."""
        return min(max(self._middle.driven(wanted), self.span[0]), self.span[1])

    def follow(self, reached: float, driven: float) -> float:
        """Return the value reached by a driven value, after `reached`; NaN: the value before is unknown."""
        if math.isnan(reached):
            return self.between(driven)
        return min(max(reached, self.rises(driven)), self.falls(driven))

    def to_drive(self, wanted: float, reached: float, way: float, last: float) -> float:
        """Return the value to drive so that one in `reach` is reached [unit].

        Args:
            reached: value reached now. way: 1 up, -1 down, 0 not known. last: value driven now.
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
        """Return how many days ago it was measured; None where nobody says."""
        return age_of(self.measured_on, today)


class Believed(NamedTuple):
    """Where actuators are believed to be, from the driven values: reached [units], NaN without a curve; and the way."""

    reached: Array
    way: Array


@dataclass(frozen=True)
class Responses:
    """The measured curves of a device's channels.

    Attributes:
        curves: by index of the channel. lower, upper: limits of driven and of reached values [units].
    """

    curves: Mapping[int, Response]
    lower: Array
    upper: Array

    def __bool__(self) -> bool:
        return bool(self.curves)

    @cached_property
    def reachable(self) -> tuple[Array, Array]:
        """Least and most that may be asked of each channel [units]: within the limits and the measured curves."""
        low, high = self.lower.copy(), self.upper.copy()
        for k, curve in self.curves.items():
            low[k], high[k] = max(low[k], curve.reach[0]), min(high[k], curve.reach[1])
        return low, high

    def believe(self, driven: Array, before: Believed | None = None) -> Believed:
        """Return where the actuators are once values were driven [units], shape (channels,)."""
        reached, way = np.full(len(driven), math.nan), np.zeros(len(driven))
        for k, curve in self.curves.items():
            old = math.nan if before is None else float(before.reached[k])
            reached[k] = curve.follow(old, float(driven[k]))
            moved = float(np.sign(reached[k] - old)) if not math.isnan(old) else 0.0
            way[k] = moved or (0.0 if before is None else float(before.way[k]))
        return Believed(reached, way)

    def driven(self, wanted: Array, now: Believed | None, last: Array) -> tuple[Array, Array]:
        """Return the values to drive for wanted ones [units], and by how much these had to be limited before.

        A value that must not be driven must not be reached either: the limits hold for both.

        Args:
            now: where the actuators are; None: nobody knows. last: values driven now.
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
        """Return the reached values for driven ones where nobody knows the way [units], shape (channels,)."""
        reached = driven.copy()
        for k, curve in self.curves.items():
            reached[k] = curve.between(float(driven[k]))
        return reached


class _Line(NamedTuple):
    """A line through points, straight on beyond its ends: looked up a sample at a time, so without numpy."""

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
            "the actuator reaches much more or less than it is driven",
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

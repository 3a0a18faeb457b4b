"""Electrovibration screen: voltage for perceived friction by a power law."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError, Finding
from .kinds import KINDS
from .spec import DeviceSpec

AMPLITUDE, CARRIER = "amplitude", "carrier"
FULL_FRICTION = 100.0
_ROWS = KINDS["friction_screen"].parameters


@dataclass(frozen=True)
class FrictionLaw:
    """Law log f = slope * log V + intercept of friction f and voltage V.

    The friction is on the paper's scale of 0 to 100.

    Attributes:
        slope, intercept: parameters of the straight line.
        base: base of both logarithms. The paper does not state it. For friction 1, 50 and 100, base 10 gives 7, 165 and
            288 V; base e gives 2.3, 55 and 96 V.

    Source: [S4] eq. 1
    """

    slope: float = _ROWS["law_slope"].default
    intercept: float = _ROWS["law_intercept"].default
    base: float = _ROWS["law_base"].default

    def __post_init__(self) -> None:
        if not (math.isfinite(self.slope) and self.slope > 0):
            raise DermisError("the law's slope must be above zero", where="friction law", value=self.slope, limit="> 0")
        if not math.isfinite(self.intercept):
            raise DermisError("the law's intercept must be finite", where="friction law", value=self.intercept)
        if not (math.isfinite(self.base) and self.base > 1):
            raise DermisError(
                "the logarithm's base must be above one", where="friction law", value=self.base, limit="> 1"
            )

    def volts(self, friction: NDArray[np.floating] | float) -> Array:
        """Return the voltage for a friction [V].

        It is 0 V for a friction of zero or less, and NaN for NaN.
        """
        wanted = np.asarray(friction, dtype=np.float64)
        threshold = self.base ** (-self.intercept / self.slope)
        with np.errstate(invalid="ignore"):
            return np.asarray(threshold * np.where(wanted <= 0, 0.0, wanted) ** (1.0 / self.slope))

    def friction(self, volts: NDArray[np.floating] | float) -> Array:
        """Return the perceived friction for a voltage [V], the inverse of `volts`.

        Raises:
            DermisError: an amplitude is negative.
        """
        applied = np.asarray(volts, dtype=np.float64)
        if (applied < 0).any():
            raise DermisError("an amplitude cannot be negative", where="friction law", value=float(applied.min()))
        return np.asarray(self.base**self.intercept * applied**self.slope)


@dataclass(frozen=True)
class FrictionScreen:
    """Data for driving one screen.

    Attributes:
        law: law of friction and voltage.
        limit: largest amplitude [V].
        carrier: frequency of the voltage [Hz].
        carrier_low, carrier_high: range of carriers in which the law was measured [Hz].
        span_low, span_high: range of amplitudes in which the law was measured [V].
    """

    law: FrictionLaw
    limit: float
    carrier: float = 60.0
    carrier_low: float = _ROWS["carrier_low"].default
    carrier_high: float = _ROWS["carrier_high"].default
    span_low: float = 0.0
    span_high: float = math.inf

    @classmethod
    def of(cls, spec: DeviceSpec) -> FrictionScreen:
        """Read a device preset of kind 'friction_screen'.

        `span_high` may be absent, since the paper gives only the ratio of its strongest to its weakest voltage. The
        strongest is then taken to be the voltage for friction 100.

        Raises:
            DermisError: the device is of another kind, a channel or a limit is missing, or the law is invalid.
        """
        where = f"device preset '{spec.key}'"
        if spec.kind != "friction_screen":
            raise DermisError("not a friction screen", where=where, value=spec.kind, limit="friction_screen")
        amplitude, carrier = spec.channel(AMPLITUDE), spec.channel(CARRIER)
        if amplitude.high is None or not amplitude.high > 0:
            raise DermisError(
                "the amplitude has no voltage limit",
                where=where,
                value=amplitude.high,
                limit="> 0 V",
                remedy="Give the channel 'amplitude' a 'high'",
            )
        law = FrictionLaw(*map(spec.value, ("law_slope", "law_intercept", "law_base")))
        high = spec.value("span_high") or _full_volts(law, where)
        low_carrier, high_carrier = spec.value("carrier_low"), spec.value("carrier_high")
        return cls(
            law,
            float(amplitude.high),
            carrier.rest or 60.0,
            low_carrier,
            high_carrier,
            high / spec.value("span_factor"),
            high,
        )

    def check(self, volts: Array, carrier: Array, where: str = "") -> tuple[Finding, ...]:
        """Return findings for commands outside the measured range.

        The commands are not changed.

        Args:
            volts: amplitudes [V], shape (n,); 0 for no friction.
            carrier: frequencies of the carrier [Hz], shape (n,).
            where: device that the findings name.
        """
        # A rounding error at exactly full friction is no extrapolation.
        low, high = self.span_low * (1 - 1e-9), self.span_high * (1 + 1e-9)
        span = f"{self.span_low:.3g} to {self.span_high:.3g} V"
        shown = volts > 0
        weak, strong = shown & (volts < low), volts > high
        outside = shown & ((carrier < self.carrier_low) | (carrier > self.carrier_high))
        findings = []
        if weak.any():
            findings.append(
                Finding(
                    "info",
                    "below-measured-span",
                    "the voltage is below the range in which the friction law was measured, so the law is extrapolated",
                    where=where,
                    value=f"{volts[weak].min():.3g} V",
                    limit=span,
                    count=int(weak.sum()),
                )
            )
        if strong.any():
            findings.append(
                Finding(
                    "warning",
                    "above-measured-span",
                    "the voltage is above the range in which the friction law was measured, so the law is extrapolated",
                    where=where,
                    value=f"{volts[strong].max():.4g} V",
                    limit=span,
                    count=int(strong.sum()),
                    remedy="Lower the scale, or choose the automatic one",
                )
            )
        if outside.any():
            findings.append(
                Finding(
                    "info",
                    "carrier-not-measured",
                    "the friction law was not measured at this carrier",
                    where=where,
                    value=f"{carrier[outside][0]:.4g} Hz",
                    limit=f"{self.carrier_low:g} to {self.carrier_high:g} Hz",
                    count=int(outside.sum()),
                )
            )
        return tuple(findings)

    def as_dict(self) -> dict[str, Any]:
        """Return all data as JSON values; `from_dict` reads them."""
        return asdict(self)

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> FrictionScreen:
        """Read a screen from the values that `as_dict` returned.

        Raises:
            DermisError: a field is missing, unknown or not a number, or the law is invalid.
        """
        try:
            rest = {name: _number(value) for name, value in fields.items() if name != "law"}
            law = FrictionLaw(**{name: _number(value) for name, value in fields["law"].items()})
            _full_volts(law, "friction screen")
            return cls(law, **rest)
        except (KeyError, TypeError, AttributeError, OverflowError) as error:
            raise DermisError("the friction screen is malformed", where="friction screen", value=str(error)) from error


def _full_volts(law: FrictionLaw, where: str) -> float:
    """Return the voltage for friction 100 [V]; refuse a law that has none."""
    try:
        full = float(law.volts(FULL_FRICTION))
    except OverflowError:
        full = math.inf
    if not (math.isfinite(full) and full > 0):
        raise DermisError("the friction law gives no voltage", where=where, value=full, limit="> 0 V, finite")
    return full


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is not a number")
    return float(value)

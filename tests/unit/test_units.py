"""Units: every factor against its definition, and what is refused."""

from __future__ import annotations

import math

import pytest

from core.errors import DermisError
from core.units import UNITS, from_si, quantity, to_si


@pytest.mark.parametrize(
    ("value", "unit", "expected", "si"),
    [
        (5.0, "mm", 0.005, "m"),
        (3.0, "um", 3e-6, "m"),
        (2.0, "cm", 0.02, "m"),
        (150.0, "mm/s", 0.15, "m/s"),
        (9810.0, "mm/s^2", 9.81, "m/s^2"),
        (180.0, "deg", math.pi, "rad"),
        (90.0, "deg/s", math.pi / 2, "rad/s"),
        (25.0, "ms", 0.025, "s"),
        (4.0, "us", 4e-6, "s"),
        (1.5, "kHz", 1500.0, "Hz"),
        (20.0, "mN", 0.02, "N"),
        (7.0, "mN*m", 0.007, "N*m"),
        (1.1, "N/mm", 1100.0, "N/m"),
        (100.0, "kPa", 1e5, "Pa"),
        (3.0, "MPa", 3e6, "Pa"),
        (12.0, "g", 0.012, "kg"),
        (45.0, "%", 0.45, "1"),
        (115.2, "kbit/s", 115200.0, "bit/s"),
    ],
)
def test_conversions(value: float, unit: str, expected: float, si: str) -> None:
    assert to_si(value, unit) == pytest.approx(expected, rel=1e-15) and UNITS[unit][0] == si
    assert from_si(to_si(value, unit), unit) == pytest.approx(value, rel=1e-15)


def test_every_si_unit_is_its_own() -> None:
    for unit, (si, factor) in UNITS.items():
        assert UNITS[si] == (si, 1.0), f"{unit} converts to {si}, which is no unit"
        assert (factor == 1.0) == (unit == si), unit


def test_lists_nest() -> None:
    assert to_si([[1, 2], [3]], "cm") == [[0.01, 0.02], [0.03]]
    assert quantity({"value": [10, 20], "unit": "mm"}) == [0.01, 0.02]
    assert quantity(0.5) == 0.5


@pytest.mark.parametrize(
    ("field", "message"),
    [
        ({"value": 5, "unit": "inch"}, r"here: unknown unit \(found 'inch'; allowed: m, mm,"),
        ({"value": 5, "unit": ["m"]}, "unknown unit"),
        ({"value": 5}, r"here: a quantity needs 'value' and 'unit' .* Write it as"),
        ({"value": "5", "unit": "m"}, r"not a finite number \(found '5'\)"),
        ({"value": True, "unit": "m"}, r"not a finite number \(found True\)"),
        ({"value": float("nan"), "unit": "m"}, r"not a finite number \(found nan\)"),
        ({"value": [1, None], "unit": "m"}, r"not a finite number \(found \[1, None\]\)"),
        ({"value": 10**400, "unit": "m"}, "not a finite number"),
        (None, "not a finite number"),
    ],
)
def test_refusals(field: object, message: str) -> None:
    with pytest.raises(DermisError, match=message):
        quantity(field, where="here")  # type: ignore[arg-type]


def test_from_si_refuses_unknown_units() -> None:
    with pytest.raises(DermisError, match="unknown unit"):
        from_si(1.0, "furlong")

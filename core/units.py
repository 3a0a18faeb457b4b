"""Units of presets, files and panels, and their conversion to SI.

The engine computes in SI. Presets, files and panels also use units such as mm and degrees.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from .errors import DermisError

# Unit -> (its SI unit, factor), with value in SI = value * factor.
UNITS: dict[str, tuple[str, float]] = {
    "m": ("m", 1.0),
    "mm": ("m", 1e-3),
    "um": ("m", 1e-6),
    "cm": ("m", 1e-2),
    "m/s": ("m/s", 1.0),
    "mm/s": ("m/s", 1e-3),
    "m/s^2": ("m/s^2", 1.0),
    "mm/s^2": ("m/s^2", 1e-3),
    "m/s^2/V": ("m/s^2/V", 1.0),
    "rad": ("rad", 1.0),
    "deg": ("rad", math.pi / 180.0),
    "rad/s": ("rad/s", 1.0),
    "deg/s": ("rad/s", math.pi / 180.0),
    "s": ("s", 1.0),
    "ms": ("s", 1e-3),
    "us": ("s", 1e-6),
    "Hz": ("Hz", 1.0),
    "kHz": ("Hz", 1e3),
    "1/s": ("1/s", 1.0),
    "1/(m/s)": ("1/(m/s)", 1.0),
    "1/(m/s^2)": ("1/(m/s^2)", 1.0),
    "1/m": ("1/m", 1.0),
    "N": ("N", 1.0),
    "mN": ("N", 1e-3),
    "N*m": ("N*m", 1.0),
    "mN*m": ("N*m", 1e-3),
    "N/m": ("N/m", 1.0),
    "N/mm": ("N/m", 1e3),
    "Pa": ("Pa", 1.0),
    "kPa": ("Pa", 1e3),
    "MPa": ("Pa", 1e6),
    "Pa/m": ("Pa/m", 1.0),
    "MPa/m": ("Pa/m", 1e6),
    "kg": ("kg", 1.0),
    "g": ("kg", 1e-3),
    "V": ("V", 1.0),
    "B": ("B", 1.0),
    "MB": ("B", 1e6),
    "bit/s": ("bit/s", 1.0),
    "kbit/s": ("bit/s", 1e3),
    "N/s": ("N/s", 1.0),
    "N*m/s": ("N*m/s", 1.0),
    "Pa/s": ("Pa/s", 1.0),
    "V/s": ("V/s", 1.0),
    "Hz/s": ("Hz/s", 1.0),
    "1": ("1", 1.0),
    "%": ("1", 1e-2),
}


def to_si(value: Any, unit: str, *, where: str = "") -> Any:
    """Convert a number, or a (nested) list of numbers, from `unit` to SI.

    Args:
        value: the number or list.
        unit: a key of `UNITS`.
        where: name of the quantity, for the message.

    Raises:
        DermisError: the unit is unknown.
    """
    if unit not in UNITS:
        raise DermisError("unknown unit", where=where, value=unit, limit=", ".join(UNITS))
    factor = UNITS[unit][1]
    if isinstance(value, list | tuple):
        return [to_si(v, unit, where=where) for v in value]
    return value * factor


def from_si(value: Any, unit: str) -> Any:
    """Convert a number or an array from SI to `unit`, a key of `UNITS`.

    Raises:
        DermisError: the unit is unknown.
    """
    if unit not in UNITS:
        raise DermisError("unknown unit", value=unit, limit=", ".join(UNITS))
    return value / UNITS[unit][1]


def quantity(field: Mapping[str, Any] | float | int, *, where: str = "") -> Any:
    """Return a quantity of a preset in SI.

    Args:
        field: `{"value": 5, "unit": "mm", "source": ...}`, or a number without unit. The value may be a nested list of
            numbers.
        where: name of the quantity, for the message.

    Raises:
        DermisError: the value or the unit is missing, the unit is unknown, or a number is not finite.
    """
    if not isinstance(field, Mapping):
        field = {"value": field, "unit": "1"}
    if "value" not in field or "unit" not in field:
        raise DermisError(
            "a quantity needs 'value' and 'unit'",
            where=where,
            value=dict(field),
            remedy='Write it as {"value": 5, "unit": "mm", "source": "..."}',
        )
    value = field["value"]
    if not isinstance(field["unit"], str):
        raise DermisError("unknown unit", where=where, value=field["unit"], limit=", ".join(UNITS))
    for number in _flat(value):
        if isinstance(number, bool) or not isinstance(number, int | float) or not finite(number):
            raise DermisError("not a finite number", where=where, value=value)
    return to_si(value, field["unit"], where=where)


def setting(field: Any, *, where: str = "") -> Any:
    """Return a setting of a preset.

    Texts, switches and lists of texts are returned unchanged, all other fields as `quantity` returns them.
    """
    if isinstance(field, str | bool) or (isinstance(field, list) and all(isinstance(v, str) for v in field)):
        return field
    return quantity(field, where=where)


def finite(number: float) -> bool:
    """Return whether a number is finite and within the range of floats."""
    try:
        return math.isfinite(number)
    except OverflowError:  # an integer of hundreds of digits
        return False


def _flat(value: Any) -> list[Any]:
    if isinstance(value, list | tuple):
        return [n for v in value for n in _flat(v)]
    return [value]

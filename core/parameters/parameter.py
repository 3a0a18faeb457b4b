"""Parameter: name, range, unit, default and description of one setting."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from ..errors import DermisError
from ..units import UNITS, finite

SWITCH, TEXT, NAMES = "true or false", "a text", "a list of texts"
LARGEST = 1e9  # bound of numbers, in SI, for rows that state none
_SAME: Any = object()  # stands for an `absent` that is not stated


@dataclass(kw_only=True, eq=False, repr=False)  # not frozen, which takes 1 ms whenever Blender starts
class Parameter:
    """One setting, with all numbers in SI.

    Attributes:
        name: name in scenes, presets and the engine.
        unit: SI unit; '1' for a plain number; '' if another setting states the unit; or `SWITCH`, `TEXT`, `NAMES`.
        text: description.
        source: source of the meaning or of the default; 'chosen' if none is published.
        default: value of a new item in Blender's window; None if there is none.
        absent: value if a scene or preset states none; `default` if `absent` is not stated.
        above, low, high: every number is above `above`, at least `low` and at most `high`, in the window, in presets
            and in scenes. `above` may be None.
        whole: whether only whole numbers are allowed.
        choices: possible values of a text: stored value, label and description of each.
        besides: more values that scripts may use, but the window does not offer.
        size: None for one number, n for a list of n numbers, 0 for a list of any length, -1 for a table of numbers.
        required: whether a preset must state a value.
        note: differences between the window, presets and the engine, and their reasons.
        label: label in the window.
        saved: name of the property in a .blend, which must never change.
        window_unit: unit of the property in the window; `unit` if it is not stated.
        soft: lower and upper end of the slider in the window; None for `low` or `high`.
        digits: number of digits after the decimal point in the window.
        keyed: whether the value may change over a scene.
        file: whether the text is the path of a file.
    """

    name: str = ""
    unit: str
    text: str = ""
    source: str = "chosen"
    default: Any = None
    absent: Any = _SAME
    above: float | None = None
    low: float = -LARGEST
    high: float = LARGEST
    whole: bool = False
    choices: tuple[tuple[str, str, str], ...] = ()
    besides: tuple[str, ...] = ()
    size: int | None = None
    required: bool = False
    note: str = ""
    label: str = ""
    saved: str = ""
    window_unit: str = ""
    soft: tuple[float | None, float | None] = (None, None)
    digits: int = 2
    keyed: bool = False
    file: bool = False

    def __post_init__(self) -> None:
        if self.absent is _SAME:
            self.absent = self.default
        self.saved = self.saved or self.name
        self.window_unit = self.window_unit or self.unit

    @property
    def numeric(self) -> bool:
        """Whether the values are numbers."""
        return self.unit not in (SWITCH, TEXT, NAMES)

    @property
    def factor(self) -> float:
        """The window's unit in SI: value = property * factor."""
        return UNITS[self.window_unit][1] if self.window_unit in UNITS else 1.0

    @property
    def keys(self) -> tuple[str, ...]:
        """Allowed texts; empty if any text is allowed."""
        return (*(key for key, _, _ in self.choices), *self.besides)

    @property
    def allowed(self) -> str:
        """The allowed values, as one phrase with the unit."""
        if not self.numeric:
            return ", ".join(self.keys) or self.unit
        unit = "" if self.window_unit in ("", "1") else f" {self.window_unit}"
        low, high = f"{self.low / self.factor:g}", f"{self.high / self.factor:g}{unit}"
        if self.above is not None:
            start = f"> {self.above / self.factor:g}"
            return f"{start}{unit}" if self.high >= LARGEST else f"{start}, <= {high}"
        if self.low <= -LARGEST:
            return self._form if self.high >= LARGEST else f"<= {high}"
        return f">= {low}{unit}" if self.high >= LARGEST else f"{low} to {high}"

    def of(self, values: Mapping[str, Any], where: str = "") -> Any:
        """Return the value of the setting in a scene or preset, in SI.

        If the scene or preset states none, the value is `absent`.

        Args:
            values: stated values by name, in SI.
            where: place of the values, for an error.

        Raises:
            DermisError: the value has another kind, or is out of range.
        """
        if self.name not in values:
            return self.absent
        value = values[self.name]
        self.check(value, where)
        return value

    def check(self, value: Any, where: str, unit: str | None = None) -> None:
        """Raise an error for a value that the setting cannot have.

        Args:
            value: any value; numbers in SI.
            where: place of the value, for an error.
            unit: unit in which a preset states the value; None if the value is not from a preset. The switches of a
                preset must be booleans. Other switches may also be 0 or 1.

        Raises:
            DermisError: the value or its unit has another kind, the number of numbers is wrong, or a number is out of
                range.
        """
        place = f"{where}, {self.name}" if where else self.name
        if self.choices and value not in self.keys:
            raise DermisError(f"unknown {self.name.replace('_', ' ')}", where=place, value=value, limit=self.allowed)
        if not self.numeric:
            if not self._has_form(value, strict=unit is not None):
                raise DermisError("a value of the wrong kind", where=place, value=value, limit=self.unit)
            return
        numbers = self._numbers(value)
        if numbers is None:
            raise DermisError("a value of the wrong kind", where=place, value=value, limit=self._form)
        if unit is not None and self.unit and UNITS[unit][0] != self.unit:
            raise DermisError(
                "a unit of the wrong kind", where=place, value=unit, limit=f"one that converts to {self.unit}"
            )
        for number in numbers:
            self._check_number(number, where)

    def _check_number(self, number: float, where: str) -> None:
        what = ""
        if not finite(number):
            what = "must be a finite number"
        elif self.above is not None and not number > self.above:
            what = f"must be above {'zero' if self.above == 0 else f'{self.above / self.factor:g}'}"
        elif number < self.low:
            what = "is too small"
        elif number > self.high:
            what = "is too large"
        elif self.whole and not float(number).is_integer():
            what = "must be a whole number"
        if what:
            plain = self.window_unit in ("", "1") or not finite(number)
            found = number if plain else f"{number / self.factor:g} {self.window_unit}"
            limit = self.allowed
            if number > self.high >= LARGEST and finite(number):  # a default bound, which is not in `allowed`
                limit = f"<= {self.high / self.factor:g} {'' if plain else self.window_unit}".rstrip()
            raise DermisError(f"'{self.name}' {what}", where=where, value=found, limit=limit)

    def _has_form(self, value: Any, *, strict: bool) -> bool:
        if self.unit == NAMES:
            return isinstance(value, list)
        if self.unit == TEXT:
            return isinstance(value, str)
        return isinstance(value, bool) or (not strict and _is_number(value) and value in (0, 1))

    def _numbers(self, value: Any) -> list[float] | None:
        """Return the numbers of a value; None if it does not fit `size`."""
        if self.size is None:
            return [value] if _is_number(value) else None
        if not isinstance(value, list) or (self.size > 0 and len(value) != self.size):
            return None
        if self.size >= 0:
            return value if all(map(_is_number, value)) else None
        rows = all(isinstance(row, list) and len(row) == len(value[0]) and all(map(_is_number, row)) for row in value)
        return [number for row in value for number in row] if rows else None

    @property
    def _form(self) -> str:
        many = {None: "one number", 0: "a list of numbers", -1: "rows of numbers"}.get(self.size)
        many = many or f"a list of {self.size} numbers"
        return f"{many} in {self.unit}" if self.unit not in ("", "1") else many


Table = Mapping[str, Parameter]


def table(*rows: Parameter) -> Table:
    """Return rows by name, in the given order."""
    return MappingProxyType({row.name: row for row in rows})


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)

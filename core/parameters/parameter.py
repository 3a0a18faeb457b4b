"""Parameter: name, range, unit, default and description of one setting."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from ..errors import DermisError
from ..units import UNITS, finite

SWITCH, TEXT, NAMES = "true or false", "a text", "a list of texts"
LARGEST = 1e9  # in SI: beyond every length, force, stiffness or rate that there is
_SAME: Any = object()


@dataclass(kw_only=True, eq=False, repr=False)  # frozen costs the add-on 1 ms whenever Blender starts
class Parameter:
    """One setting. Every number here is SI.

    Attributes:
        name: in scenes, presets and the engine.
        unit: SI, '1' for a plain number, '' for one whose unit others give; or `SWITCH`, `TEXT`, `NAMES`.
        text: description.
        source: source of its meaning or of its default; 'chosen' if none is published.
        default: value of a new item in Blender's window; None where a preset need not state it.
        absent: value where a scene or preset does not state it; the default unless given.
        above, low, high: every number is above, at least, at most this; in the window, in presets and in scenes alike.
        whole: no fractions.
        choices: possible values of a text: stored value, label and description of each.
        besides: values that scripts may use although the window does not offer them.
        size: how many numbers: None for one alone, n for a list of n, 0 for a list of any length, -1 for a table.
        required: a preset must have it.
        note: where the window, presets or the engine differ, and why.
        label: label in the window.
        saved: the property's name in a .blend, which never changes.
        window_unit: the unit of the property's value; that of the parameter unless stated.
        soft: where sliders end; the range where None. digits: behind the point.
        keyed: it may change over a scene. file: the text is the path of a file.
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
        """Whether its values are numbers."""
        return self.unit not in (SWITCH, TEXT, NAMES)

    @property
    def factor(self) -> float:
        """The window's unit in SI: value = property * factor."""
        return UNITS[self.window_unit][1] if self.window_unit in UNITS else 1.0

    @property
    def keys(self) -> tuple[str, ...]:
        """Allowed texts; empty where any is allowed."""
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
        """Return its value among those of a scene or preset, in SI; what holds where they do not say.

        Raises:
            DermisError: another kind of value, or one out of range.
        """
        if self.name not in values:
            return self.absent
        value = values[self.name]
        self.check(value, where)
        return value

    def check(self, value: Any, where: str, unit: str | None = None) -> None:
        """Refuse a value, in SI, that it cannot have.

        Args:
            unit: the one that it was written in, by a preset; a preset's switches are no numbers.

        Raises:
            DermisError: another kind of value, unit, number of numbers, or a number out of range.
        """
        place = f"{where}, {self.name}" if where else self.name
        if self.choices and value not in self.keys:
            raise DermisError(f"unknown {self.name.replace('_', ' ')}", where=place, value=value, limit=self.allowed)
        if not self.numeric:
            if not self._has_form(value, strict=unit is not None):
                raise DermisError("another kind of value", where=place, value=value, limit=self.unit)
            return
        numbers = self._numbers(value)
        if numbers is None:
            raise DermisError("another kind of value", where=place, value=value, limit=self._form)
        if unit is not None and self.unit and UNITS[unit][0] != self.unit:
            raise DermisError(
                "a unit of another kind", where=place, value=unit, limit=f"one that converts to {self.unit}"
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
            if number > self.high >= LARGEST and finite(number):  # an end that goes without saying else
                limit = f"<= {self.high / self.factor:g} {'' if plain else self.window_unit}".rstrip()
            raise DermisError(f"'{self.name}' {what}", where=where, value=found, limit=limit)

    def _has_form(self, value: Any, *, strict: bool) -> bool:
        if self.unit == NAMES:
            return isinstance(value, list)
        if self.unit == TEXT:
            return isinstance(value, str)
        return isinstance(value, bool) or (not strict and _is_number(value) and value in (0, 1))

    def _numbers(self, value: Any) -> list[float] | None:
        """Return a value's numbers; None where it is not of the size wanted."""
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
    """Return rows by name, in their order."""
    return MappingProxyType({row.name: row for row in rows})


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)

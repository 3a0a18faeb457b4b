"""Conversion of parameters to properties, and of properties to values.

`core/parameters/` has the rows: name, unit, default, range, text and the name under which a .blend saves the property.
Settings unknown to the engine, such as those of the view, are declared where they belong, by the same functions.

Units. A property holds SI unless its name ends in another unit (`_mm`, `_mm_s`, `_kpa`, `_mpa_m`). Blender would scale
properties of unit LENGTH by the scene's unit scale, so a scene in feet or millimetres would show a fingertip's half a
millimetre as something else; these use Blender's lens unit instead, which means millimetres in every scene. Angles are
radians (Blender shows degrees).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from .. import changes, choices, redraw
from .._core import core
from ..compat import BLEND_RELATIVE

Update = Callable[[Any, Any], None]

NO_UPDATES: Mapping[str, Update] = {}
OVERRIDE = {"LIBRARY_OVERRIDABLE"}
SOFT = ("soft_min", "soft_max")
SIGNIFICANT = ".7g"  # digits that single precision keeps: 0.1 typed by a person means 0.1, not 0.10000000149
SINGLE = 1e-6  # relative error, larger than that of single precision
# Units that Blender shows by itself; others stand behind the label.
_SHOWN: dict[str, dict[str, str]] = {
    "mm": {"unit": "CAMERA"},
    "Hz": {"unit": "FREQUENCY"},
    "s": {"unit": "TIME_ABSOLUTE"},
    "rad": {"subtype": "ANGLE"},
    "1": {},
}
# The papers that rows name as sources. One is named by its title.
_PAPERS = {
    "[S0]": "Verschoor et al. 2020",
    "[S1]": "Deformation Matching",
    "[S2]": "Pacchierotti et al. 2018",
    "[S3]": "Girard et al. 2016",
    "[S4]": "Kim et al. 2013",
}
_WRITTEN = {"1/(m/s)": "s/m", "1/(m/s^2)": "s²/m", "MPa/m": "kPa/mm"}


def touched(_self: Any, _context: Any) -> None:
    """Note that the display may be out of date."""
    changes.mark_dirty()


def unfelt(self: Any, _context: Any) -> None:
    """Note that no bake depends on the setting that changed."""
    changes.expect(self.id_data)


def redrawn(self: Any, context: Any) -> None:
    """Request a redraw, because a setting of the display has changed.

    No bake depends on such a setting of a scene.
    """
    if isinstance(self.id_data, bpy.types.Scene):
        unfelt(self, context)
    redraw.request()


def device_name(
    saved: str, description: str, *, kinds: Callable[[], Collection[str]] | None = None, worn: bool = False
) -> Any:
    """Return a property that shows and takes the name of a device preset; another property holds the key.

    Args:
        saved: property with the key.
        kinds: function that returns the kinds of devices that are offered; None for all kinds.
        worn: the device is one that an object wears. Then what a bake depends on leaves the name out, since names are
            known only after presets were read; and it may be set on overrides of linked objects.
    """

    def offered(_self: Any, _context: Any, text: str) -> list[str]:
        own = None if kinds is None else kinds()
        keys = (key for key in choices.search("devices", text) if own is None or choices.kind_of(key) in own)
        return [choices.label("devices", key) for key in keys]

    def named(self: Any, name: str) -> None:
        setattr(self, saved, choices.key_of("devices", name))

    return StringProperty(
        name="Device",
        description=description,
        search=offered,
        get=lambda self: choices.label("devices", getattr(self, saved)) if getattr(self, saved) else "",
        set=named,
        options={"SKIP_SAVE", "HIDDEN"} if worn else {"SKIP_SAVE"},
        override=OVERRIDE if worn else set(),
    )


def declared(
    *tables: core.parameters.parameter.Table, updates: Mapping[str, Update] = NO_UPDATES, override: set[str] = OVERRIDE
) -> Callable[[type], type]:
    """Return a decorator that gives a group the properties of tables.

    They come before the properties that the group declares itself.

    Args:
        updates: functions called on a change, by parameter; `touched` for the others.
        override: Blender's `override` of each property.
    """

    def declare(group: type) -> type:
        rows = (row for rows in tables for row in rows.values() if row.label)
        own = {row.saved: declare_one(row, updates.get(row.name, touched), override) for row in rows}
        group.__annotations__ = {**own, **group.__annotations__}
        return group

    return declare


def declare_one(
    row: core.parameters.parameter.Parameter, update: Update = touched, override: set[str] = OVERRIDE
) -> Any:
    """Return a parameter as a property; it can be animated if its row is `keyed`."""
    common: dict[str, Any] = {"description": row.text, "update": update, "override": override}
    if row.source.startswith("["):
        common["description"] += f" ({cited(row.source)})"
    if not row.keyed:
        common["options"] = set()
    if row.choices:
        items = tuple((key, label, cited(text)) for key, label, text in row.choices)
        return EnumProperty(name=row.label, items=items, default=row.default, **common)
    if row.unit == core.parameters.parameter.SWITCH:
        return BoolProperty(name=row.label, default=row.default, **common)
    if row.unit == core.parameters.parameter.TEXT:
        more = {"subtype": "FILE_PATH", "options": BLEND_RELATIVE} if row.file else {}
        return StringProperty(name=row.label, default=row.default, **{**common, **more})
    low, high = row.low, row.high
    ends = {"min": low, "max": high}
    ends |= {n: hard if soft is None else soft for n, hard, soft in zip(SOFT, (low, high), row.soft, strict=True)}
    if row.whole:
        return IntProperty(name=row.label, default=row.default, **{n: int(v) for n, v in ends.items()}, **common)
    shown = _SHOWN.get(row.window_unit)
    label = row.label if shown is not None else f"{row.label} [{_WRITTEN.get(row.window_unit, row.window_unit)}]"
    if row.window_unit == "1" and (low, high) == (0.0, 1.0):
        shown = {"subtype": "FACTOR"}
    return FloatProperty(
        name=label,
        default=row.default / row.factor,
        precision=row.digits,
        step=3 if row.digits else 100,
        **{n: v / row.factor for n, v in ends.items()},
        **(shown or {}),
        **common,
    )


def cited(text: str) -> str:
    """Return a text with names of papers in place of the keys of their list: '[S3] eq. 3' names authors and year."""
    for key, paper in _PAPERS.items():
        text = text.replace(f"{key} ", f"{paper}, ").replace(key, paper)
    return text


def switch(name: str, text: str, default: bool, update: Update = touched) -> Any:
    """Declare a switch that the engine does not have, constant over a scene."""
    return BoolProperty(name=name, description=text, default=default, options=set(), update=update, override=OVERRIDE)


def values(group: Any, *tables: core.parameters.parameter.Table) -> dict[str, Any]:
    """Return a group's values in SI, by the engine's names."""
    return {row.name: value_of(group, row) for table in tables for row in table.values() if row.label}


def value_of(group: Any, row: core.parameters.parameter.Parameter) -> Any:
    """Return one value of a group in SI.

    Blender stores a property's limits in single precision, a little beyond those of the row. A value at such a limit
    becomes the limit of the row.
    """
    value = getattr(group, row.saved)
    if not isinstance(value, float):
        return value
    value *= row.factor
    beyond = row.low if value < row.low else row.high if value > row.high else value
    return beyond if math.isclose(value, beyond, rel_tol=SINGLE) else value


def apply(group: Any, table: core.parameters.parameter.Table, given: Mapping[str, Any]) -> list[str]:
    """Set a group's properties from SI values; return the names that the table does not have."""
    for name, value in given.items():
        if name in table:
            row = table[name]
            shown = value / row.factor if row.factor != 1.0 else value
            setattr(group, row.saved, int(shown) if row.whole else shown)
    return [name for name in given if name not in table]

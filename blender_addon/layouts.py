"""Parts of layouts that panels and dialogs share: wrapped text, properties."""

import textwrap
from functools import lru_cache
from typing import Any

import bpy

# Most letters of a name beside its field in a sidebar of the default width, without and with dots for keyframes.
BESIDE, BESIDE_DOTS = 17, 14


def ui_scale() -> float:
    """Return the interface's scale; 1 without a window, where it is 0."""
    return bpy.context.preferences.system.ui_scale or 1.0


def paragraph(
    layout: Any, context: bpy.types.Context, text: str, icon: str = "NONE", *, inset: float = 0.0, least: int = 1
) -> None:
    """Write a text, wrapped to the width of the sidebar.

    Args:
        inset: part of the width that is left free [px at scale 1].
        least: smallest number of lines, so that the rows below stay in place while the text changes.
    """
    width = context.region.width if context.region else 300
    words(layout, text, width / ui_scale() - inset, icon, least=least)


def words(layout: Any, text: str, width: float, icon: str = "NONE", *, least: int = 1) -> None:
    """Write a text, wrapped to a width.

    Args:
        width: the width [px at scale 1].
        least: smallest number of lines.
    """
    letters = max(int((width - (52.0 if icon == "NONE" else 74.0)) / 6.2), 16)
    column = layout.column(align=True)
    column.scale_y = 0.85
    lines = _wrapped(text, letters)
    for i, line in enumerate([*lines, *[""] * (least - len(lines))]):
        if icon == "NONE":
            column.label(text=line)
        else:
            column.label(text=line, icon=icon if i == 0 else "BLANK1")


@lru_cache(256)
def _wrapped(text: str, letters: int) -> list[str]:
    return textwrap.wrap(text, letters) or [""]


def role(context: bpy.types.Context) -> str:
    """Return the role of the active object; empty without one."""
    return context.object.dermis.role if context.object is not None else ""


def properties(layout: Any, group: Any, *names: str, keys: bool = True) -> Any:
    """Draw properties one below the other; return their column.

    A number whose name would be cut off beside its field has its name in the field, over the whole width, so that its
    unit can be read.

    Args:
        names: names of the properties.
        keys: whether Blender's dots for keyframes are drawn beside them.
    """
    column = layout.column()
    column.use_property_split, column.use_property_decorate = True, keys
    for name in names:
        row = group.bl_rna.properties[name]
        if row.type != "FLOAT" or "[" not in row.name or len(row.name) <= (BESIDE_DOTS if keys else BESIDE):
            column.prop(group, name)
            continue
        wide = column.row(align=True)
        wide.use_property_split = False
        wide.prop(group, name)
        if keys:
            wide.prop_decorator(group, name)
    return column


class Pairs:
    """Names and their values in two columns, a line each.

    A split for each line would take a third more time.

    Args:
        layout: layout in which they are drawn.
        factor: share of its width for the names.
    """

    def __init__(self, layout: Any, factor: float) -> None:
        split = layout.split(factor=factor)
        self._names, self._values = split.column(align=True), split.column(align=True)

    def add(self, name: str, value: str, icon: str = "NONE") -> None:
        """Draw a line."""
        self._names.label(text=name, icon=icon)
        self._values.label(text=value)


def preset(layout: Any, group: str, choose: str, title: str) -> None:
    """Draw the button that chooses a preset, and those of `own_presets`."""
    row = layout.row(align=True)
    row.operator(choose, text=title or "From Preset", icon="PRESET")
    own_presets(row, group)


def own_presets(row: Any, group: str) -> None:
    """Draw + and -, which save and remove a person's own presets."""
    row.operator("dermis.save_preset", text="", icon="ADD").group = group
    row.operator("dermis.remove_preset", text="", icon="REMOVE").group = group


def editable(layout: Any, obj: bpy.types.Object) -> None:
    """Grey out the settings of a linked object, since edits would not be saved."""
    layout.enabled = obj.is_editable

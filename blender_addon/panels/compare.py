"""Every device for one touch, as a table."""

from typing import Any

import bpy

from .. import choices
from ..comparison import compared
from ..layouts import paragraph
from ..polls import needs
from . import summary
from .main import DermisPanel

LETTERS = 12  # a longer name of a measure is cut off beside its figures, so it has a line of its own


@needs(lambda context: summary.of(context.scene).fingers)
class DERMIS_PT_compare(DermisPanel, bpy.types.Panel):
    """Error of each device for the active finger's touch."""

    bl_idname = "DERMIS_PT_compare"
    bl_label = "Compare Devices"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the button, then a box a device, the best first."""
        layout = self.layout
        column = layout.column(align=True)  # side by side, their names would be cut off
        column.operator("dermis.compare_devices", icon="SPREADSHEET")
        column.operator("dermis.compare_devices", icon="PIVOT_CURSOR", text="With Floors").floors = True
        found = compared.current(context.scene)
        if found is None:
            paragraph(layout, context, "Sends the active finger's touch through every device preset that fits it.")
            return
        if not compared.holds(context.scene, found):
            paragraph(layout, context, "The scene changed since: compare again.", "ERROR")
        finger = compared.called(context.scene, found.table, found.place)
        layout.label(text=f"{finger}: error, target → rendered", icon="VIEW_PAN")
        for finding in found.table["findings"]:
            paragraph(layout, context, f"{finding[:1].upper()}{finding[1:]}.", "ERROR")
        for row in found.table["rows"]:
            _device(layout.box().column(align=True), row)
        row = layout.row(align=True)
        row.operator("dermis.open_comparison", icon="URL")
        row.operator("dermis.save_comparison", icon="EXPORT", text="Save")
        skipped(layout, context, found.table["skipped"])


def skipped(layout: Any, context: bpy.types.Context, devices: "list[dict[str, Any]]") -> None:
    """Draw the devices that were left out, once for each reason."""
    for text in skipped_words(devices):
        paragraph(layout, context, text, "INFO")


def skipped_words(devices: "list[dict[str, Any]]") -> list[str]:
    """Return a sentence for each reason, with the devices left out by it."""
    by_reason: dict[str, list[str]] = {}
    for device in devices:
        by_reason.setdefault(device["why"], []).append(device["title"])
    return [f"{', '.join(titles)}: {why}." for why, titles in by_reason.items()]


def _device(column: Any, row: dict[str, Any]) -> None:
    """Draw a device's measures, and the shares that it cannot render."""
    column.scale_y = 0.85
    column.label(text=row["title"], icon=choices.icon(row["kind"]))
    for measure in row["measures"]:
        name = measure["name"]
        if len(name) > LETTERS:
            column.label(text=name)
        split = column.split(factor=0.38)
        split.label(text="" if len(name) > LETTERS else name)
        rest = split.split(factor=0.28)
        rest.label(text=f"{100 * measure['off']:.0f} %")
        rest.label(text=measure["figures"])
    if row["floors"]:
        _in_columns(column, "", row["floors"][0]["by"], "best", "lateral")
    for floor in row["floors"]:
        _in_columns(column, floor["name"], *map(_percent, (floor["off"], floor["best"], floor["lateral"])))
    last = column.row()
    last.active = False
    last.label(text=f"clipped {100 * row['clipped']:.0f} %, out of reach {100 * row['out_of_reach']:.0f} %")


def _in_columns(column: Any, name: str, *cells: str) -> None:
    """Draw a line of a device's errors.

    Args:
        name: the measure. cells: its errors as rendered, by the best pose, and with axes along the pad.
    """
    split = column.split(factor=0.38)
    split.label(text=name)
    row = split.row()
    for cell in cells:
        row.label(text=cell)


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.0f} %"


CLASSES: tuple[type, ...] = (DERMIS_PT_compare,)

"""Discriminability of a finger's touches, by device and method, as a table."""

from typing import Any

import bpy

from ..comparison import compared, told
from ..layouts import paragraph
from ..polls import needs
from . import compare, summary
from .main import DermisPanel

PAIRS = 4  # number of columns that fit; the saved table has all pairs


@needs(lambda context: summary.of(context.scene).fingers)
class DERMIS_PT_told(DermisPanel, bpy.types.Panel):
    """Discriminability of the active finger's touches for an ideal observer."""

    bl_idname = "DERMIS_PT_told"
    bl_parent_id = "DERMIS_PT_compare"
    bl_label = "Discriminability"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the button, then a line a device and method."""
        layout = self.layout
        layout.operator("dermis.tell_apart", icon="ZOOM_ALL")
        found = told.current(context.scene)
        if found is None:
            paragraph(
                layout,
                context,
                "Animate at least two touches with a lift between them. The result is how often an observer would tell "
                "them apart, for the real touches and for each device.",
            )
            return
        if not compared.holds(context.scene, found):
            paragraph(layout, context, "The scene has changed: compute it again.", "ERROR")
        table = found.table
        for k, touch in enumerate(table["touches"], 1):
            layout.label(text=f"touch {k}: {touch['end'] - touch['start']:.2f} s from frame {touch['frame']:.0f}")
        pairs = table["pairs"][:PAIRS]
        box = layout.box().column(align=True)
        box.scale_y = 0.85
        box.label(text=f"{compared.called(context.scene, table, found.place)}: share of right answers")
        _line(box, "touches", [f"{i} or {j}" for i, j in pairs])
        title = ""
        for row in table["rows"]:
            if row["method"] and row["title"] != title:  # beside the shares, most names would be cut off
                title = row["title"]
                box.label(text=title)
            _line(box, _name(row), [f"{100 * right:.0f} %" for right in row["right"][:PAIRS]])
        if len(table["pairs"]) > PAIRS:
            paragraph(layout, context, f"{len(table['pairs']) - PAIRS} more pairs are in the saved table.", "INFO")
        words = "Simulated: an ideal observer who knows the real touches. Guessing gives 50 %."
        paragraph(layout, context, words, "INFO")
        for finding in table["findings"]:
            paragraph(layout, context, f"{finding[:1].upper()}{finding[1:]}.", "ERROR")
        layout.operator("dermis.save_told", icon="EXPORT", text="Save")
        compare.skipped(layout, context, table["skipped"])


def _name(row: "dict[str, Any]") -> str:
    """Return the name of a row: the method under its device's title, or the title of a row without a method."""
    return {"": row["title"], "lookup": "    look-up table"}.get(row["method"], f"    {row['method']}")


def _line(column: Any, name: str, cells: list[str]) -> None:
    split = column.split(factor=max(0.3, 0.8 - 0.12 * len(cells)))
    split.label(text=name)
    row = split.row()
    for cell in cells:
        row.label(text=cell)


CLASSES: tuple[type, ...] = (DERMIS_PT_told,)

"""Probable mistakes before a bake, each with a button that corrects it."""

from typing import Any

import bpy

from ..layouts import paragraph
from ..viewport import shown

_MOST = 3  # at once; the others come when these are mended


def doubts_of(layout: Any, context: bpy.types.Context) -> None:
    """Draw the first doubts about the scene, if there are any."""
    for doubt in shown.scene_doubts(context.scene)[:_MOST]:
        column = layout.box().column(align=True)
        paragraph(column, context, f"{doubt.text}.".replace("?.", "?"), "ERROR")
        operator = column.operator("dermis.mend", text=doubt.remedy)
        operator.code, operator.name = doubt.code, doubt.name

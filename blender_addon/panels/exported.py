"""What an export wrote, where the eye is: below its button."""

from __future__ import annotations

from typing import Any

import bpy

from ..results import exported

MOST = 4  # names of files that are listed


def box(layout: Any, scene: bpy.types.Scene) -> None:
    """Draw a box that lists the written files and opens their folder; nothing without files."""
    last = exported.last(scene)
    if last is None:
        return
    column = layout.box().column(align=True)
    row = column.row(align=True)
    number = len(last.files)
    row.label(text=f"Wrote {number} file{'' if number == 1 else 's'}", icon="CHECKMARK")
    row.operator("dermis.open_export", text="Open Folder", icon="FILE_FOLDER")
    names = column.column(align=True)
    names.active, names.scale_y = False, 0.8
    for path in last.files[:MOST]:
        names.label(text=path.name, icon="BLANK1")
    if number > MOST:
        names.label(text=f"and {number - MOST} more", icon="BLANK1")

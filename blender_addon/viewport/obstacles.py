"""The space of a 3D view that is free for cards.

Blender's own text, gizmos, side bars and redo panel take precedence.
"""

from __future__ import annotations

from typing import Any

import bpy

from .packing import Box

MARGIN = 12  # [px at scale 1] margin of the room for cards
# Blender's own text [px at scale 1]: height of a line, width of the lines; number of lines of statistics.
LINE, TEXT_WIDTH, STATISTICS = 20, 300, 9
GIZMO_BELOW = 160  # [px at scale 1] by which the buttons of the view reach below the ball that turns it


def free(context: bpy.types.Context, scale: float) -> tuple[Box, list[Box]]:
    """Return the room for cards, and the boxes that are taken [px at scale 1].

    The room is within a view's side bars and headers. Blender's own drawings and other regions take boxes.
    """
    region, taken = context.region, []
    left, right, top = 0.0, float(region.width), float(region.height)
    for other in context.area.regions:
        if other.type == "WINDOW" or min(other.width, other.height) <= 1:  # a hidden one is a pixel large
            continue
        box = Box(other.x - region.x, other.y - region.y, other.width, other.height)
        if other.type in ("HEADER", "TOOL_HEADER") and box.top >= 0.5 * region.height:
            top = min(top, box.bottom)
        elif other.type in ("TOOLS", "UI"):
            beside = box.right <= 0.5 * region.width
            left, right = (max(left, box.right), right) if beside else (left, min(right, box.left))
        else:
            taken.append(box)
    taken += [*_text(context, left, top, scale), *_gizmos(context, right, top, scale)]
    margin = MARGIN * scale
    room = Box(left + margin, margin, max(right - left - 2 * margin, 0.0), max(top - 2 * margin, 0.0))
    return room.scaled(1.0 / scale), [box.scaled(1.0 / scale) for box in taken]


def _text(context: bpy.types.Context, left: float, top: float, scale: float) -> list[Box]:
    view, overlay = context.preferences.view, context.space_data.overlay
    if not overlay.show_overlays:
        return []
    named = (
        bool(view.show_view_name) + bool(view.show_object_info) + 1 if overlay.show_text else 0
    )  # and frames a second
    lines = named + (STATISTICS if overlay.show_stats else 0)
    height = LINE * scale * (lines + 0.5)
    return [Box(left, top - height, TEXT_WIDTH * scale, height)] if lines else []


def _gizmos(context: bpy.types.Context, right: float, top: float, scale: float) -> list[Box]:
    view: Any = context.preferences.view
    space = context.space_data
    if not (space.show_gizmo and space.show_gizmo_navigate):
        return []
    ball = view.gizmo_size_navigate_v3d * scale if view.mini_axis_type == "GIZMO" else 0.0
    height = ball + (GIZMO_BELOW if view.show_navigate_ui else 20) * scale
    width = max(ball, 2 * LINE * scale) + LINE * scale
    return [Box(right - width, top - height, width, height)]

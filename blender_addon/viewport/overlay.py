"""What the viewport shows: the device's twin on each finger, and its values in the corner.

Two draw handlers, one in the scene and one in pixels. They read what `shown` has kept, draw, and change nothing.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from ..layouts import ui_scale
from ..preview.rows import Row
from . import drawing, paint, pin_card, platform_card, shown, thimble_card
from .drawing import Handlers, draw_twin, finger_matrix, in_finger
from .paint import BLUE, GREEN, INK, ORANGE, PANEL
from .parts import heat
from .twin import Twin

_handlers = Handlers()
CARD_WIDTH, DIAL, LINE, MARGIN = 260, 92, 17, 12
FAINT = (*INK[:3], 0.35)
SOURCE_COLOURS = {"bake": GREEN, "live": BLUE, "stale": ORANGE, "earlier": ORANGE, "device": GREEN, "file": GREEN}


def _draw_view() -> None:
    for row, twin in drawing.twins(bpy.context):
        frame = finger_matrix(bpy.context.scene, row.finger)
        if frame is not None:
            with in_finger(frame):
                draw_twin(twin)


def _draw_pixels() -> None:
    context = bpy.context
    scene, space = context.scene, context.space_data
    if not scene.dermis.show_readout or not getattr(space.overlay, "show_overlays", True):
        return
    now = shown.now(scene)
    if now is None or now.devices is None or not (now.devices.rows or now.devices.source == "live"):
        return
    if not now.devices.rows and now.skins.states:
        return  # fingers without devices: the skin's legend says where it comes from
    import gpu

    scale = ui_scale()
    gpu.state.blend_set("ALPHA")
    left = MARGIN * scale + paint.width_of(context.area, "TOOLS")
    bottom = MARGIN * scale
    height = context.region.height
    rows = now.devices.rows
    for row, twin in zip(reversed(rows), reversed(now.twins), strict=True):
        needed = _card_height(row) * scale
        if bottom + needed > height - 60 * scale:
            paint.text(f"and {len(rows)} devices in all", left, bottom, FAINT, scale)
            bottom += LINE * scale
            break
        _card(row, twin, left, bottom, scale)
        bottom += needed + 6 * scale
    paint.text(now.devices.note, left + 2 * scale, bottom + 3 * scale, SOURCE_COLOURS[now.devices.source], scale)
    gpu.state.blend_set("NONE")


def _card_height(row: Row) -> float:
    if row.drawn == "platform":
        return platform_card.height(row) + 2.0 * MARGIN
    tall = row.drawn in ("tactor", "pins", "thimble")
    return DIAL + 3.0 * MARGIN + LINE if tall else 3 * LINE + 2 * MARGIN


def _card(row: Row, twin: Twin | None, left: float, bottom: float, scale: float) -> None:
    height = _card_height(row) * scale
    paint.rectangle(left, bottom, CARD_WIDTH * scale, height, PANEL)
    top = bottom + height - (MARGIN + 6) * scale
    x = left + MARGIN * scale
    state = twin.state if twin is not None else None
    paint.text(f"{row.finger}   {row.title}", x, top, INK, scale, width=(CARD_WIDTH - 2 * MARGIN) * scale)
    width, low = (CARD_WIDTH - 2 * MARGIN) * scale, bottom + 0.7 * MARGIN * scale
    match row.drawn:
        case "tactor":
            _dial(row, x, bottom + MARGIN * scale, scale)
        case "screen":
            _bar(row, x, top - 1.6 * LINE * scale, scale)
        case "pins":
            pin_card.card(row, state, x, bottom + MARGIN * scale, width, DIAL * scale, scale)
        case "thimble":
            thimble_card.card(row, state, x, low, width, scale)
        case "platform":
            platform_card.card(row, state, x, low, width, scale)


def _dial(row: Row, left: float, bottom: float, scale: float) -> None:
    """Draw the tactor's plane as the finger's owner would see it through the nail: tip up."""
    radius = 0.5 * DIAL * scale
    centre = np.array([left + radius, bottom + radius])
    reach = row.full_scale("tactor_x")
    angle = np.linspace(0.0, 2.0 * np.pi, 49)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    _line2d(centre + radius * ring, FAINT, 1.0)
    for a, b in (((-1, 0), (1, 0)), ((0, -1), (0, 1))):
        _line2d(centre + radius * np.array([a, b]), (*FAINT[:3], 0.15), 1.0)
    if len(row.path) > 1:
        points = centre + radius * row.path / reach
        fade = np.linspace(0.0, 0.9, len(points))
        _line2d(points, np.column_stack([np.tile(ORANGE[:3], (len(points), 1)), fade]), 1.6)
    at = np.array([row.values["tactor_x"], row.values["tactor_y"]])
    paint.disc(centre + radius * at / reach, 5.0 * scale, ORANGE)
    x = left + DIAL * scale + 14 * scale
    y = bottom + DIAL * scale - 14 * scale
    lines = [
        (f"x  {at[0] * 1e3:+6.2f} mm", INK),
        (f"y  {at[1] * 1e3:+6.2f} mm", INK),
        (f"{100 * np.hypot(*at) / reach:.0f} % of ±{reach * 1e3:g} mm", FAINT),
    ]
    if row.contact is not None:
        lines.append(("touching", ORANGE) if row.contact > 0.5 else ("in the air", FAINT))
    for text, colour in lines:
        paint.text(text, x, y, colour, scale)
        y -= LINE * scale


def _bar(row: Row, left: float, bottom: float, scale: float) -> None:
    volts, width = row.values["amplitude"], (CARD_WIDTH - 2 * MARGIN) * scale
    level = float(np.clip(volts / row.full_scale("amplitude"), 0.0, 1.0))
    paint.rectangle(left, bottom, width, 12 * scale, (*FAINT[:3], 0.12))
    if level > 0.0:
        paint.rectangle(left, bottom, width * level, 12 * scale, heat(level))
    limit = row.high.get("amplitude")
    text = f"{volts:.0f} V"
    if limit:
        text += f"  of {limit:.0f} V"
    if "carrier" in row.values:
        text += f"   at {row.values['carrier']:.0f} Hz"
    paint.text(text, left, bottom - 1.25 * LINE * scale, INK, scale)
    if row.contact is not None:
        touching = row.contact > 0.5
        paint.text(
            "on the screen" if touching else "off the screen",
            left + 0.66 * width,
            bottom - 1.25 * LINE * scale,
            ORANGE if touching else FAINT,
            scale,
        )


def _line2d(points: np.ndarray, colour: Any, width: float) -> None:
    paint.line(np.column_stack([points, np.zeros(len(points))]), colour, width)


def register() -> None:
    """Draw devices from now on."""
    _handlers.add(_draw_view)
    _handlers.add(_draw_pixels, "POST_PIXEL")


def unregister() -> None:
    """Draw them no more."""
    _handlers.clear()

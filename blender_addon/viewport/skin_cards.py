"""Beside the heat map: a card with a map and figures for each pad, and the legend."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..preview.skin_state import SkinState
from . import paint, skin_colours, skin_field, skin_shader
from .skin_field import QUANTITIES, Drawn
from .skin_shown import Shown, colour_table

LEGEND_WIDTH, BAR, LINE, MARGIN, NARROW = 270, 11, 16, 11, 132
SOURCES = {"bake": paint.GREEN, "live": paint.BLUE, "stale": paint.ORANGE, "earlier": paint.ORANGE}


def columns(context: bpy.types.Context, now: Shown, right: float, bottom: float, scale: float) -> float:
    """Draw a card for each finger, in the order of the view, smaller where there are many; return where to go on."""
    view = context.scene.dermis.skin_view
    gap, count = 6 * scale, len(now.states)
    room = right - paint.width_of(context.area, "TOOLS") - 2 * MARGIN * scale
    fitting = max(min(count, int((room + gap) // (NARROW * scale + gap))), 1)
    width = min(max(NARROW, 0.76 * view.map_size) * scale, (room + gap) / fitting - gap)
    size = min(view.map_size * scale, width / 0.76)
    height = size + (5.2 * LINE + MARGIN) * scale
    left = right - fitting * width - (fitting - 1) * gap
    for i in _from_the_left(context, now.states)[:fitting]:
        state, drawn = now.states[i], now.drawn[i]
        paint.rectangle(left, bottom, width, height, paint.PANEL)
        if drawn is not None:
            middle = np.array([left + 0.5 * width, bottom + 5.0 * LINE * scale + 0.5 * size])
            _pad_map(state, drawn, now, view, middle, size, scale)
        _figures(state, left + 9 * scale, bottom + 4.2 * LINE * scale, width - 18 * scale, scale)
        left += width + gap
    if count > fitting:
        paint.text(f"and {count - fitting} more", right - width, bottom + height + 4 * scale, paint.FAINT, scale)
        height += LINE * scale
    return bottom + height + gap


def _from_the_left(context: bpy.types.Context, states: tuple[SkinState, ...]) -> list[int]:
    """Return the numbers of the fingers as they stand in the view, so that cards and fingers are easily matched."""
    look = context.region_data.perspective_matrix

    def place(i: int) -> tuple[float, int]:
        obj = context.scene.objects.get(states[i].finger)
        if obj is None:
            return (0.0, i)
        at = look @ Vector((*obj.matrix_world.translation, 1.0))
        return (round(at.x / at.w, 1) if at.w > 0.0 else 0.0, i)

    return sorted(range(len(states)), key=place)


def _pad_map(state: SkinState, drawn: Drawn, now: Shown, view: Any, at: np.ndarray, size: float, scale: float) -> None:
    """Draw a pad as seen through the nail, tip up: the finger's X to the right, its Y upwards."""
    longest = max(d.surface.length for d in now.drawn if d is not None)
    zoom = size / (1.05 * longest)  # one scale for all
    origin = at - zoom * drawn.surface.middle
    shift = Matrix.Translation((*origin, 0.0))
    flat = Matrix.Diagonal((zoom, zoom, 0.0, 1.0))
    flat[2][2] = 1e-6 * zoom  # flat, and can still be inverted
    pad = skin_shader.on_card(state, drawn).pad
    skin_shader.draw(pad, shift @ flat, now, view, opacity=1.0, fill=1.0, bias=0.0, light=0.35, contours=0.12)
    if not state.touching:
        return
    start = origin + zoom * drawn.centre
    paint.disc(start, 2.6 * scale, paint.INK)
    share = float(np.hypot(*drawn.shear))
    if share > 0.02:
        end = start + 0.34 * size * min(share, 1.0) / share * drawn.shear
        paint.arrow(start, end, paint.INK, 2.0, scale)


def _figures(state: SkinState, x: float, y: float, width: float, scale: float) -> None:
    colour = SOURCES.get(state.source, paint.FAINT)
    paint.text(state.finger, x, y, paint.INK, scale, width=width - 12 * scale)
    if state.model is None:
        rows = [(state.note, paint.ORANGE)]
    elif not state.touching:
        rows = [("in the air", paint.FAINT)]
    else:
        rows = [
            (f"N {force(state.normal_force)}   T {force(state.tangential_force)}", paint.INK),
            (f"{1e3 * state.depth:.2f} mm deep", paint.INK if state.depth <= 2e-3 else paint.ORANGE),
            (friction(state), paint.FAINT) if state.converged else ("did not converge", paint.ORANGE),
        ]
        if state.work == "rendered":
            rows[-1] = (state.note, paint.FAINT if state.converged else paint.ORANGE)
    for text, ink in rows:
        y -= LINE * scale
        paint.text(text, x, y, ink, scale, width=width + 4 * scale)
    paint.disc(np.array([x + width - 4 * scale, y + (len(rows) * LINE + 4) * scale]), 3.2 * scale, colour)


def legend(now: Shown, view: Any, right: float, bottom: float, scale: float) -> None:
    """Draw the colours with their range and unit, where the forces come from, and how far off the model is."""
    quantity = QUANTITIES[view.quantity]
    deepest = max((s.depth for s in now.states), default=0.0)
    said = paint.wrapped(skin_field.error_text(now.states), 42)
    noted = next((s for s in now.states if s.note), None)
    note = paint.wrapped(noted.note, 42) if noted is not None else []
    width, height = LEGEND_WIDTH * scale, ((1.9 + len(said) + max(len(note), 1)) * LINE + BAR + 2 * MARGIN) * scale
    left, x = right - width, right - width + MARGIN * scale
    inner = width - 2 * MARGIN * scale
    paint.rectangle(left, bottom, width, height, paint.PANEL)
    y = bottom + height - (MARGIN + 8) * scale
    how = {"auto": "largest so far", "frame": "this frame", "fixed": "fixed"}[view.range_mode]
    paint.text(f"{quantity.title}  [{quantity.unit}]", x, y, paint.INK, scale)
    paint.text(how, right - (MARGIN + 82) * scale, y, paint.FAINT, scale)
    y -= (BAR + 7) * scale
    paint.strip(x, y, inner, BAR * scale, skin_colours.table(colour_table(view)))
    y -= LINE * scale
    for share in (0.0, 0.5, 1.0):
        value = (now.low + share * (now.high - now.low)) / quantity.factor
        paint.text(f"{value:.4g}", x + share * inner, y, paint.INK, scale, align=share)
    y -= 1.15 * LINE * scale
    for line in said:
        paint.text(line, x, y, paint.ORANGE if deepest > 2e-3 else paint.FAINT, scale, width=inner)
        y -= LINE * scale
    y = bottom + (MARGIN - 3 + LINE * (len(note) - 1)) * scale
    for line in note:
        paint.text(line, x, y, SOURCES.get(noted.source, paint.ORANGE) if noted else paint.FAINT, scale, width=inner)
        y -= LINE * scale


def friction(state: SkinState) -> str:
    """Return how many nodes stick and slip; a device's rendering touches nothing that could."""
    if state.work == "rendered":
        return "none: by the device"
    return f"{state.sticking} stick, {state.slipping} slip"


def force(value: float) -> str:
    """Return a force for people."""
    return f"{value:.2f} N" if value >= 0.1 else f"{1e3 * value:.0f} mN"

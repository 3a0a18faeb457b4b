"""Cards of devices: current values, drawn by the device's kind or in one line."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..preview.rows import Row
from ..quantities import quantity
from . import paint, pin_card, platform_card, thimble_card
from .packing import Box
from .paint import INK, ORANGE, PANEL
from .parts import heat
from .twin import Twin

# [px at scale 1] Width of a card, size of a dial, height of a line of text, margin.
WIDTH, DIAL, LINE, MARGIN = 260, 92, 17, 12
FOLDED = 22  # [px at scale 1] height of a card of one line
FAINT = (*INK[:3], 0.35)


def height(row: Row) -> float:
    """Return the height of a row's open card [px at scale 1]."""
    if row.drawn == "platform":
        return platform_card.height(row) + 2.0 * MARGIN
    tall = row.drawn in ("tactor", "coil", "pins", "thimble")
    return DIAL + 3.0 * MARGIN + LINE if tall else 3 * LINE + 2 * MARGIN


def card(row: Row, twin: Twin | None, place: Box, scale: float) -> None:
    """Draw a device's card into a place."""
    left, bottom, *_ = place
    paint.rectangle(*place, PANEL)
    top = place.top - (MARGIN + 6) * scale
    x = left + MARGIN * scale
    state = twin.state if twin is not None else None
    width, low = place.width - 2 * MARGIN * scale, bottom + 0.7 * MARGIN * scale
    paint.text(f"{row.finger}   {row.title}", x, top, INK, scale, width=width, shorter=_shorter(row))
    if row.note:
        paint.text(row.note, x, top - 1.6 * LINE * scale, paint.FAINT, scale, width=width)
    match row.drawn:
        case "tactor":
            _dial(row, x, bottom + MARGIN * scale, scale)
        case "screen":
            _bar(row, x, top - 1.6 * LINE * scale, width, scale)
        case "coil":
            _wave(row, x, bottom + MARGIN * scale, width, scale)
        case "pins":
            pin_card.card(row, state, x, bottom + MARGIN * scale, width, DIAL * scale, scale)
        case "thimble":
            thimble_card.card(row, state, x, low, width, scale)
        case "platform":
            platform_card.card(row, state, x, low, width, scale)


def line(row: Row, place: Box, scale: float) -> None:
    """Draw a device's name and its current state in one line."""
    paint.rectangle(*place, PANEL)
    x, y = place.left + MARGIN * scale, place.bottom + 0.3 * place.height
    width = place.width - 2 * MARGIN * scale
    touching = row.contact is None or row.contact > 0.5
    said = paint.text(in_words(row), x + width, y, ORANGE if touching else paint.FAINT, scale, align=1.0)
    room = width - said - MARGIN * scale
    paint.text(f"{row.finger}   {row.title}", x, y, INK, scale, width=room, shorter=_shorter(row))


def _shorter(row: Row) -> list[str]:
    """Return shorter names of finger and device, the longest first."""
    words = row.title.split()
    return [f"{row.finger}   {' '.join(words[:count])}" for count in range(len(words) - 1, 0, -1)]


def in_words(row: Row) -> str:
    """Return a device's current state in a few words."""
    if row.note:
        return row.note
    if row.contact is not None and row.contact < 0.5:
        return "in the air"
    if row.drawn == "tactor":
        return f"{1e3 * row.values['tactor_x']:+.2f}, {1e3 * row.values['tactor_y']:+.2f} mm"
    if row.drawn == "coil":
        return f"{_peak(row):.2f} V peak"
    if row.drawn == "pins":
        return f"{float(row.numbers.sum()):.2f} N"
    if "mismatch" in row.signals:
        return f"mismatch {100 * row.signals['mismatch']:.0f} %"
    return next((quantity(value, row.units[name]) for name, value in row.values.items()), "")


def _dial(row: Row, left: float, bottom: float, scale: float) -> None:
    """Draw the tactor's plane as the finger's owner would see it through the nail, fingertip up."""
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
        (f"{100 * np.hypot(*at) / reach:.0f} % of ±{reach * 1e3:g} mm", paint.FAINT),
    ]
    if row.contact is not None:
        lines.append(("touching", ORANGE) if row.contact > 0.5 else ("in the air", paint.FAINT))
    for text, colour in lines:
        paint.text(text, x, y, colour, scale)
        y -= LINE * scale


def _wave(row: Row, left: float, bottom: float, width: float, scale: float) -> None:
    """Draw the last moments of a voltage, with the present at the right end.

    A single value would say nothing about a vibration.
    """
    reach, half = row.full_scale("voltage"), 0.5 * (DIAL - LINE) * scale
    middle = bottom + half + 1.25 * LINE * scale
    _line2d(np.array([(left, middle), (left + width, middle)]), FAINT, 1.0)
    if len(row.path) > 1:
        across = left + width * (1.0 - row.path[:, 0] / min(float(row.path[0, 0]), -1e-3))
        _line2d(np.column_stack([across, middle + half * row.path[:, 1] / reach]), ORANGE, 1.2)
    paint.text(f"{_peak(row):.2f} V peak of ±{reach:g} V", left, bottom, INK, scale)


def _peak(row: Row) -> float:
    """Return the largest voltage of the last moments [V]."""
    return float(np.abs(row.path[:, 1]).max()) if len(row.path) else abs(row.values["voltage"])


def _bar(row: Row, left: float, bottom: float, width: float, scale: float) -> None:
    volts = row.values["amplitude"]
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
            ORANGE if touching else paint.FAINT,
            scale,
        )


def _line2d(points: np.ndarray, colour: Any, width: float) -> None:
    paint.line(np.column_stack([points, np.zeros(len(points))]), colour, width)

"""Cards of pads in the 3D view, each a map with figures or one line; the legend."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from mathutils import Matrix

from ..preview.skin_state import SkinState
from . import paint, skin_colours, skin_field, skin_shader
from .packing import Box
from .skin_field import QUANTITIES, Drawn
from .skin_shown import Shown, colour_table

LEGEND_WIDTH, BAR, LINE, MARGIN, NARROW, COMPACT = 270, 11, 16, 11, 132, 98
LETTERS = 40  # most letters in a line of the legend: 42 can be wider than the legend
FOLDED = 22  # [px at scale 1] height of a card of one line
ASPECT = 0.76  # width of a map divided by its height
SOURCES = {"bake": paint.GREEN, "live": paint.BLUE, "stale": paint.ORANGE, "earlier": paint.ORANGE}


def sizes(map_size: float, lines: int) -> list[tuple[float, float]]:
    """Return sizes of a card to try [px at scale 1], the wanted one first.

    Args:
        map_size: wanted height of the map. lines: lines of text in the card.
    """
    wide = max(NARROW, ASPECT * map_size)
    return [(width, min(map_size, width / ASPECT) + _beneath(width, lines)) for width in (wide, NARROW, COMPACT)]


def lines_of(states: Sequence[SkinState]) -> int:
    """Return the number of text lines in the cards of skins.

    There is one more if a device renders a skin, because its two errors are given.
    """
    return 5 if any(state.work == "rendered" for state in states) else 4


def card(now: Shown, i: int, view: Any, place: Box, scale: float) -> None:
    """Draw a pad's map and figures into a place."""
    state, drawn = now.states[i], now.drawn[i]
    beneath = _beneath(place.width / scale, lines_of(now.states)) * scale
    size = place.height - beneath
    paint.rectangle(*place, paint.PANEL)
    if drawn is not None:
        middle = np.array([place.left + 0.5 * place.width, place.bottom + beneath - 0.9 * LINE * scale + 0.5 * size])
        _pad_map(state, drawn, now, view, middle, size, scale)
    y, width = place.bottom + beneath - (MARGIN + LINE) * scale, place.width - 18 * scale
    _figures(state, place.left + 9 * scale, y, width, scale, short=place.width < 0.99 * NARROW * scale)


def _beneath(width: float, lines: int) -> float:
    """Return the height of a card's text [px at scale 1].

    A slim card has fewer lines.
    """
    return (lines + 1.2 if width >= 0.99 * NARROW else 3.0) * LINE + MARGIN


def line(state: SkinState, place: Box, scale: float) -> None:
    """Draw a pad's name, forces and depth in one line."""
    paint.rectangle(*place, paint.PANEL)
    x, y, width = place.left + 9 * scale, place.bottom + 0.3 * place.height, place.width - 18 * scale
    words, colour = "in the air", paint.FAINT
    if state.model is None:
        words, colour = state.note or "no skin", paint.ORANGE
    elif state.touching:
        words = f"N {force(state.normal_force)}  T {force(state.tangential_force)}  {1e3 * state.depth:.2f} mm"
        colour = paint.INK if state.converged and not (state.too_deep or state.too_far) else paint.ORANGE
    said = paint.text(words, x + width, y, colour, scale, align=1.0, width=0.75 * width)
    room = width - said - 9 * scale
    paint.text(state.finger, x, y, paint.INK, scale, width=room, shorter=_shorter(state))


def _shorter(state: SkinState) -> list[str]:
    """Return shorter titles of a pad: the device alone, without the finger.

    Empty for a pad that no device renders. The finger's own map stands before those that devices render.
    """
    device = state.finger.partition(": ")[2]
    return [device] if device and state.work == "rendered" else []


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


def _figures(state: SkinState, x: float, y: float, width: float, scale: float, *, short: bool) -> None:
    colour = SOURCES.get(state.source, paint.FAINT)
    paint.text(state.finger, x, y, paint.INK, scale, width=width - 12 * scale, shorter=_shorter(state))
    if state.model is None:
        rows = [(state.note, paint.ORANGE)]
    elif not state.touching:
        rows = [("in the air", paint.FAINT)]
    else:
        rows = [
            (f"N {force(state.normal_force)}   T {force(state.tangential_force)}", paint.INK),
            (f"{1e3 * state.depth:.2f} mm deep", paint.ORANGE if state.too_deep else paint.INK),
            (friction(state), paint.FAINT) if state.converged else ("did not converge", paint.ORANGE),
        ]
        if state.work == "rendered":
            ink = paint.FAINT if state.converged else paint.ORANGE
            rows[-1:] = [(part, ink) for part in state.note.split(", ", 1)]
        if short:
            rows = [(force(state.normal_force), rows[1][1])]
    for text, ink in rows:
        y -= LINE * scale
        paint.text(text, x, y, ink, scale, width=width + 4 * scale)
    paint.disc(np.array([x + width - 4 * scale, y + (len(rows) * LINE + 4) * scale]), 3.2 * scale, colour)


class Legend(NamedTuple):
    """The legend's text beneath the colours, in lines.

    Attributes:
        off: the errors of the model. deep: a skin is pressed deeper or dragged farther than the model is trusted.
        note, source: where the forces come from, in words and as a key of `SOURCES`.
    """

    off: list[str]
    deep: bool
    note: list[str]
    source: str

    @classmethod
    def of(cls, now: Shown, *, full: bool, said: str) -> Legend:
        """Return the legend of skins.

        Args:
            full: give errors and notes, too, not only the meaning of the colours. said: a note that is shown elsewhere.
        """
        deep = any(s.too_deep or s.too_far for s in now.states)
        noted = next((s for s in now.states if s.note not in ("", said) and s.work != "rendered"), None)
        off = skin_field.error_lines(now.states) if full else []
        own = "skin: " if said else ""  # the note of the devices, shown elsewhere, may name another frame
        note = paint.wrapped(own + noted.note, LETTERS) if noted is not None and full else []
        return cls(off, deep, note, noted.source if noted is not None else "")

    @property
    def height(self) -> float:
        """Height of the legend [px at scale 1]."""
        return (1.9 + len(self.off) + len(self.note)) * LINE + BAR + 2 * MARGIN


def legend(now: Shown, view: Any, words: Legend, place: Box, scale: float) -> None:
    """Draw the colours with their range and unit, and the legend's words."""
    quantity, x = QUANTITIES[view.quantity], place.left + MARGIN * scale
    inner = place.width - 2 * MARGIN * scale
    paint.rectangle(*place, paint.PANEL)
    y = place.top - (MARGIN + 8) * scale
    how = {"auto": "largest so far", "frame": "this frame", "fixed": "fixed"}[view.range_mode]
    paint.text(f"{quantity.title}  [{quantity.unit}]", x, y, paint.INK, scale)
    paint.text(how, x + inner, y, paint.FAINT, scale, align=1.0)
    y -= (BAR + 7) * scale
    paint.strip(x, y, inner, BAR * scale, skin_colours.table(colour_table(view)))
    y -= LINE * scale
    for share in (0.0, 0.5, 1.0):
        value = (now.low + share * (now.high - now.low)) / quantity.factor
        paint.text(f"{value:.4g}", x + share * inner, y, paint.INK, scale, align=share)
    y -= 0.15 * LINE * scale
    off, note = paint.ORANGE if words.deep else paint.FAINT, SOURCES.get(words.source, paint.ORANGE)
    for line, colour in (*((text, off) for text in words.off), *((text, note) for text in words.note)):
        y -= LINE * scale
        paint.text(line, x, y, colour, scale, width=inner)


def friction(state: SkinState) -> str:
    """Return how many nodes stick and slip.

    On a skin as a device renders it, no node does.
    """
    if state.work == "rendered":
        return "none: by the device"
    return f"{state.sticking} stick, {state.slipping} slip"


def force(value: float) -> str:
    """Return a force as text, in N or mN."""
    return f"{value:.2f} N" if value >= 0.1 else f"{1e3 * value:.0f} mN"

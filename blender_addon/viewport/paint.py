"""Drawing of overlays in pixels: text, boxes, lines, discs and colour strips.

Lines can also be drawn in space.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..layouts import ui_scale

Colour = tuple[float, float, float, float]

INK: Colour = (0.92, 0.93, 0.95, 1.0)
FAINT: Colour = (0.92, 0.93, 0.95, 0.55)
# So opaque that every colour of text has a contrast of 4.5 to 1 over any view (WCAG 2.1, criterion 1.4.3).
PANEL: Colour = (0.07, 0.08, 0.09, 0.95)
VEIL: Colour = (*PANEL[:3], 0.65)
ORANGE: Colour = (1.0, 0.52, 0.10, 1.0)
BLUE: Colour = (0.36, 0.62, 1.0, 1.0)
GREEN: Colour = (0.45, 0.80, 0.55, 1.0)
FONT_SIZE, SMALLER = 11.5, 0.8  # size of text [px at scale 1], and the factor for smaller text, which is still legible
EDGE = 4.0  # [px at scale 1] margin of a line's ground around its letters
# Corners of a unit disc, its middle first; triangles of the disc and of a square.
SIDES = 24
_ANGLE = np.linspace(0.0, 2.0 * np.pi, SIDES + 1)[:-1]
WHEEL = np.vstack([np.zeros((1, 2)), np.stack([np.cos(_ANGLE), np.sin(_ANGLE)], axis=1)])
SPOKES = np.array([(0, 1 + i, 1 + (i + 1) % SIDES) for i in range(SIDES)], np.int32)
SQUARE = np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def text(
    words: str,
    x: float,
    y: float,
    colour: Colour,
    scale: float,
    *,
    width: float = 0.0,
    align: float = 0.0,
    ground: bool = False,
    shorter: Sequence[str] = (),
) -> float:
    """Write a line of text.

    If it does not fit a given width, shorter words are taken, then a smaller size; then it is cut off.

    Args:
        width: largest width [px]; 0 for no limit.
        align: share of the line left of x. shorter: other words that say the same, the longest first.
        ground: draw a dark box behind the line; needed wherever no card is beneath it.

    Returns:
        The width of the line [px] if `width`, `align` or `ground` is given; else 0.
    """
    import blf

    blf.size(0, FONT_SIZE * scale)
    blf.color(0, *colour)
    if width:
        words = next((said for said in (words, *shorter) if blf.dimensions(0, said)[0] <= width), [words, *shorter][-1])
        if blf.dimensions(0, words)[0] > width:
            blf.size(0, SMALLER * FONT_SIZE * scale)
    while width and len(words) > 4 and blf.dimensions(0, words)[0] > width:
        words = words.rstrip("…")[:-1] + "…"
    wide = blf.dimensions(0, words)[0] if align or width or ground else 0.0
    if ground:
        edge = EDGE * scale
        rectangle(x - align * wide - edge, y - edge, wide + 2.0 * edge, (FONT_SIZE + 1.5 * EDGE) * scale, PANEL)
    blf.position(0, x - align * wide, y, 0.0)
    blf.draw(0, words)
    return float(wide)


def wrapped(words: str, letters: int) -> list[str]:
    """Return a text in lines of at most `letters` letters."""
    return textwrap.wrap(words, letters)


def rectangle(left: float, bottom: float, width: float, height: float, colour: Colour) -> None:
    """Fill a box."""
    right, top = left + width, bottom + height
    corners = np.array([[left, bottom], [right, bottom], [right, top], [left, top]])
    _fill(corners, SQUARE, colour)


def veil(left: float, bottom: float, width: float, height: float, words: str, scale: float) -> None:
    """Dim a drawn card, and write the reason at its upper right."""
    rectangle(left, bottom, width, height, VEIL)
    text(words, left + width - 8.0 * scale, bottom + height - 15.0 * scale, INK, scale, align=1.0, ground=True)


def disc(centre: NDArray[Any], radius: float, colour: Colour) -> None:
    """Fill a circle."""
    _fill(centre + radius * WHEEL, SPOKES, colour)


def arrow(start: NDArray[Any], end: NDArray[Any], colour: Colour, width: float, scale: float) -> None:
    """Draw a line with a head at its end."""
    along = end - start
    length = float(np.hypot(*along))
    if length < 1.0:
        return
    along = along / length
    side = np.array([-along[1], along[0]])
    head = min(7.0 * scale, 0.6 * length)
    neck = end - head * along
    half = 0.5 * width * scale
    body = np.array([start + half * side, start - half * side, neck - half * side, neck + half * side])
    _fill(body, SQUARE, colour)
    wings = 0.55 * head * side
    _fill(np.array([end, neck + wings, neck - wings]), SQUARE[:1], colour)


def line(points: NDArray[Any], colour: tuple[float, ...], width: float) -> None:
    """Draw a line through points of shape (n, 3); width at scale 1 [px].

    The points are in pixels, or in the space of the view.
    """
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("POLYLINE_SMOOTH_COLOR")
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    shader.uniform_float("lineWidth", width * ui_scale())
    gpu.state.blend_set("ALPHA")  # text drawing leaves it off
    colours = np.broadcast_to(np.asarray(colour, np.float32), (len(points), 4)).copy()
    batch_for_shader(shader, "LINE_STRIP", {"pos": points.astype(np.float32), "color": colours}).draw(shader)


def strip(left: float, bottom: float, width: float, height: float, colours: NDArray[np.float32]) -> None:
    """Fill a box with a colour map from left to right; colours of shape (n, 3)."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    n = len(colours)
    x = np.linspace(left, left + width, n)
    low, high = (np.column_stack([x, np.full(n, y), np.zeros(n)]) for y in (bottom, bottom + height))
    i = np.arange(n - 1)
    faces = np.vstack([np.stack([i, i + 1, n + i + 1], axis=1), np.stack([i, n + i + 1, n + i], axis=1)])
    rgba = np.tile(np.column_stack([colours, np.ones(n)]).astype(np.float32), (2, 1))
    batch_for_shader(
        shader,
        "TRIS",
        {"pos": np.vstack([low, high]).astype(np.float32), "color": rgba},
        indices=np.ascontiguousarray(faces, np.int32),
    ).draw(shader)


def _fill(points: NDArray[Any], triangles: NDArray[np.int32], colour: Colour) -> None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    shader.uniform_float("color", colour)
    gpu.state.blend_set("ALPHA")  # text drawing leaves it off
    flat = np.zeros((len(points), 3), np.float32)
    flat[:, :2] = points
    batch_for_shader(shader, "TRIS", {"pos": flat}, indices=triangles).draw(shader)

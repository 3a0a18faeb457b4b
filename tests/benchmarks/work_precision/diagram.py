"""Diagrams on two logarithmic axes, side by side on one canvas."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, floor, log10

import numpy as np

from core.plot.axes import FAINT, FRAME, GRID, INK, PAPER
from core.plot.canvas import Canvas

from .measured import Panel, Point

COLOURS = (
    "#c8323c", "#e39aa0", "#1f6fb2", "#4fa3a0", "#8a4fb0", "#b0661a", "#6b7480", "#2e7d46", "#a03a78", "#20262e",
    "#d4a017", "#7cb342", "#5b7fd1", "#9c6b4f", "#94a3b8", "#0b5563",
)  # fmt: skip
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 306.0, 250.0, 48.0, 14.0, 34.0, 42.0
HEAD = 92.0  # for title, sentence and legend
OWN, BAND = "#eef0f3", "#b9a06a"
SMALL = 6.2
Box = tuple[float, float, float, float]


def size(count: int, across: int) -> tuple[float, float]:
    """Return width and height of a canvas for so many diagrams [points]."""
    return 12.0 + WIDTH * across, HEAD + HEIGHT * ceil(count / across)


def draw(canvas: Canvas, panels: Sequence[Panel], title: str, says: str, across: int) -> None:
    """Draw diagrams row by row; the same curve has the same colour everywhere."""
    points = [point for panel in panels for point in panel.points]
    names = list(dict.fromkeys(point.curve for point in sorted(points, key=lambda point: point.curve == point.knob)))
    colours = {name: COLOURS[k % len(COLOURS)] for k, name in enumerate(names)}
    canvas.text(20, 24, title, 9.5, INK)
    canvas.text(20, 43, says, 7.5, INK)
    canvas.disc(24, 60.5, 5.0, INK)
    canvas.disc(24, 60.5, 3.6, PAPER)
    canvas.text(33, 63.5, "the default", 7.0, FAINT)
    x, y = 100.0, 63.5
    curves = [point.curve for point in points if point.curve != point.knob]
    for name in dict.fromkeys(curves):  # what is one point alone has its name beside it
        if x + 12 + 5.4 * len(name) > size(1, across)[0]:
            x, y = 20.0, y + 14.0
        canvas.disc(x + 4, y - 3.0, 3.5, colours[name])
        canvas.text(x + 12, y, name, 7.0, FAINT)
        x += 26 + 5.4 * len(name)
    for k, panel in enumerate(panels):
        _draw(canvas, panel, colours, 6.0 + WIDTH * (k % across), HEAD + HEIGHT * (k // across))


def _draw(canvas: Canvas, panel: Panel, colours: dict[str, str], left: float, top: float) -> None:
    errors = [p.error for p in panel.points] + [e for e in (*panel.bands.values(), panel.own) if e > 0.0]
    (low, high), (fast, slow) = (_around(values) for values in (errors, [p.median for p in panel.points]))
    x0, x1, y0, y1 = left + LEFT, left + WIDTH - RIGHT, top + HEIGHT - BOTTOM, top + TOP

    def x(value: float) -> float:
        share = (log10(max(value, 1e-300)) - low) / (high - low)
        return x0 + (x1 - x0) * min(max(share, 0.0), 1.0)

    def y(value: float) -> float:
        return y0 + (y1 - y0) * (log10(value) - fast) / (slow - fast)

    if panel.own > 0.0:
        canvas.rectangle(x0, y1, x(panel.own) - x0, y0 - y1, OWN)
    for value in _ticks(low, high):
        canvas.line(x(value), y1, x(value), y0 + 3, GRID, 0.75)
        canvas.text(x(value), y0 + 13, _share(value), 6.5, FAINT, "middle")
    for value in _ticks(fast, slow):
        canvas.line(x0 - 3, y(value), x1, y(value), GRID, 0.75)
        canvas.text(x0 - 6, y(value) + 3, f"{value:g}", 6.5, FAINT, "end")
    for level in (y0, y1):
        canvas.line(x0, level, x1, level, FRAME, 0.75)
    for side in (x0, x1):
        canvas.line(side, y1, side, y0, FRAME, 0.75)
    canvas.text(x0, y1 - 20, panel.title, 8.0, INK)
    canvas.text(x0, y1 - 6, panel.each, 6.5, FAINT)
    canvas.text((x0 + x1) / 2, y0 + 27, panel.across, 6.5, FAINT, "middle")
    taken: list[Box] = []
    for k, (name, value) in enumerate(panel.bands.items()):
        canvas.line(x(value), y1, x(value), y0, BAND, 1.0, 3.0)
        at = x(value) + 3, y1 + 9 + 9 * k
        canvas.text(*at, name.replace("_", "-"), SMALL, BAND)
        taken.append((at[0], at[1] - 7.0, at[0] + 3.6 * len(name), at[1]))
    if panel.own > 0.0:
        canvas.text(x0 + 3, y0 - 4, "the reference's own", SMALL, FAINT)
        taken.append((x0, y0 - 11.0, x0 + 70.0, y0))
    for curve in dict.fromkeys(point.curve for point in panel.points):
        own = [point for point in panel.points if point.curve == curve]
        if len(own) > 1:
            canvas.path(np.array([x(p.error) for p in own]), np.array([y(p.median) for p in own]), colours[curve], 1.0)
        for point in own:
            if point.default:
                canvas.disc(x(point.error), y(point.median), 5.4, INK)
                canvas.disc(x(point.error), y(point.median), 4.4, PAPER)
            canvas.disc(x(point.error), y(point.median), 3.0, colours[curve])
    places = [(x(point.error), y(point.median)) for point in panel.points]
    taken += [(a - 2.0, b - 2.0, a + 2.0, b + 2.0) for a, b in places]
    for point, at in sorted(zip(panel.points, places, strict=True), key=lambda pair: not pair[0].default):
        _name(canvas, point, at, colours[point.curve], (x0, x1 + 8.0), taken)


def _name(
    canvas: Canvas, point: Point, at: tuple[float, float], colour: str, ends: tuple[float, float], taken: list[Box]
) -> None:
    """Write what a point is, where there is room beside it."""
    wide = 4.6 * len(point.knob)
    for side, down in ((1, 2.5), (-1, 2.5), (1, -6.0), (-1, -6.0), (1, 11.0), (-1, 11.0)):
        start = at[0] + 8.0 if side > 0 else at[0] - 8.0 - wide
        box = (start, at[1] + down - 7.0, start + wide, at[1] + down)
        clear = all(box[0] > b[2] or box[2] < b[0] or box[1] > b[3] or box[3] < b[1] for b in taken)
        if clear and ends[0] < start and start + wide < ends[1]:
            taken.append(box)
            canvas.text(start, at[1] + down, point.knob, SMALL, colour)
            return


def _around(values: Sequence[float]) -> tuple[float, float]:
    """Return the powers of ten between which values lie, with some room."""
    found = [log10(v) for v in values if v > 0.0]
    low, high = min(found), max(found)
    room = max(0.08 * (high - low), 0.12)
    return low - room, high + room


def _ticks(low: float, high: float) -> list[float]:
    """Return round values between two powers of ten: 1, 2 and 5 of each, or whole powers where there are many."""
    steps = (1.0, 2.0, 5.0) if high - low < 2.5 else (1.0,)
    every = max(1, ceil((high - low) / 7.0))
    powers = range(floor(low), ceil(high) + 1)
    values = [step * 10.0**k for k in powers if k % every == 0 for step in steps]
    return [float(f"{v:.3g}") for v in values if low <= log10(v) <= high]


def _share(value: float) -> str:
    return f"{100 * value:g} %" if value >= 1e-4 else f"{value:.0e}"

"""A row of small diagrams with named curves, as one PNG."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from core.files import write_bytes
from core.plot.axes import FAINT, FRAME, GRID, INK, ticks
from core.plot.canvas import PngCanvas

Array = NDArray[np.float64]

COLOURS = {
    "rest": "#b9c0c8",
    "target": "#20262e",
    "FM1": "#1f6fb2",
    "FM2": "#4fa3a0",
    "DM1": "#b0661a",
    "DM2": "#c8323c",
    "DM0": "#8a4fb0",
    "FM0": "#6b7480",
}
WIDTH, HEIGHT, TOP, BOTTOM = 920.0, 270.0, 64.0, 40.0


class Chart:
    """Diagrams side by side.

    Args:
        count: how many. title: of all. across, up: names of the axes, one a diagram.
    """

    def __init__(self, count: int, title: str, across: tuple[str, ...], up: tuple[str, ...]) -> None:
        self.count, self.title, self.across, self.up = count, title, across, up
        self.curves: list[list[tuple[Array, Array, str]]] = [[] for _ in range(count)]

    def curve(self, k: int, x: Array, y: Array, name: str) -> None:
        """Add a curve over rising x to diagram k; `name` chooses its colour."""
        self.curves[k].append((np.asarray(x, float), np.asarray(y, float), name))

    def write(self, path: Path) -> None:
        """Draw and write all of it."""
        canvas = PngCanvas(WIDTH, HEIGHT)
        canvas.text(24, 24, self.title, 9.5, INK)
        names = list(dict.fromkeys(name for curves in self.curves for _, _, name in curves))
        for k, name in enumerate(names):
            canvas.rectangle(24 + 80 * k, 38, 18, 3, COLOURS[name])
            canvas.text(47 + 80 * k, 43, name, 7.5, COLOURS[name])
        for k in range(self.count):
            self._draw(k, canvas)
        write_bytes(path, canvas.to_bytes())

    def _draw(self, k: int, canvas: PngCanvas) -> None:
        room = (WIDTH - 16) / self.count
        left, right = 16 + k * room + 38, 16 + (k + 1) * room - 14
        bottom = HEIGHT - BOTTOM
        x = np.concatenate([c[0] for c in self.curves[k]])
        y = np.concatenate([c[1] for c in self.curves[k]])
        x0, x1 = float(x.min()), float(x.max())
        y0, y1 = min(float(y.min()), 0.0), float(y.max())
        pad = 0.06 * (y1 - y0 or 1.0)
        y0, y1 = y0 - (pad if y0 < 0 else 0.0), y1 + pad
        for v in ticks(y0, y1, 5):
            at = bottom - (v - y0) / (y1 - y0) * (bottom - TOP)
            canvas.line(left, at, right, at, GRID, 0.75)
            canvas.text(left - 5, at + 3, f"{v:g}", 6.5, FAINT, "end")
        for v in ticks(x0, x1, 5):
            at = left + (v - x0) / (x1 - x0) * (right - left)
            canvas.line(at, bottom, at, bottom + 4, FRAME, 0.75)
            canvas.text(at, bottom + 14, f"{v:g}", 6.5, FAINT, "middle")
        canvas.line(left, bottom, right, bottom, FRAME, 0.75)
        canvas.line(left, TOP, left, bottom, FRAME, 0.75)
        canvas.text(left, TOP - 5, self.up[k], 7, INK)
        canvas.text((left + right) / 2, bottom + 30, self.across[k], 7, INK, "middle")
        for curve_x, curve_y, name in self.curves[k]:
            canvas.path(
                left + (curve_x - x0) / (x1 - x0) * (right - left),
                bottom - (curve_y - y0) / (y1 - y0) * (bottom - TOP),
                COLOURS[name],
                1.2,
            )

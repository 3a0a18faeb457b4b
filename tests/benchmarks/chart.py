"""A row of small diagrams with named curves, as one PNG."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from core.files import write_bytes
from core.plot.axes import INK, Axes, legend
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
        colours: of names. from_zero: whether zero is always on the axis upwards.
    """

    def __init__(
        self,
        count: int,
        title: str,
        across: tuple[str, ...],
        up: tuple[str, ...],
        *,
        colours: Mapping[str, str] = COLOURS,
        from_zero: bool = True,
    ) -> None:
        self.count, self.title, self.across, self.up = count, title, across, up
        self.colours, self.from_zero = colours, from_zero
        self.curves: list[list[tuple[Array, Array, str]]] = [[] for _ in range(count)]

    def curve(self, k: int, x: Array, y: Array, name: str) -> None:
        """Add a curve over rising x to diagram k; `name` chooses its colour."""
        self.curves[k].append((np.asarray(x, float), np.asarray(y, float), name))

    def write(self, path: Path) -> None:
        """Draw and write all of it."""
        canvas = PngCanvas(WIDTH, HEIGHT)
        canvas.text(24, 24, self.title, 9.5, INK)
        names = list(dict.fromkeys(name for curves in self.curves for _, _, name in curves))
        legend(canvas, 24, 43, [(name, self.colours[name]) for name in names])
        for k in range(self.count):
            self._draw(k, canvas)
        write_bytes(path, canvas.to_bytes())

    def _draw(self, k: int, canvas: PngCanvas) -> None:
        room = (WIDTH - 16) / self.count
        x = np.concatenate([c[0] for c in self.curves[k]])
        y = np.concatenate([c[1] for c in self.curves[k]])
        low, high = float(y.min()), float(y.max())
        if self.from_zero:
            low = min(low, 0.0)
        pad = 0.06 * (high - low or 1.0)
        box = (16 + k * room + 38, TOP, room - 52, HEIGHT - BOTTOM - TOP)
        axes = Axes(
            canvas,
            box,
            (float(x.min()), float(x.max())),
            (low - (pad if low < 0 or not self.from_zero else 0.0), high + pad),
        )
        axes.grid(self.across[k], self.up[k], most=(5, 5))
        for curve_x, curve_y, name in self.curves[k]:
            axes.curve(curve_x, curve_y, self.colours[name], 1.2)

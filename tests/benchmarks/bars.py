"""Groups of bars with whiskers and a rule, as one PNG."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from core.files import write_bytes
from core.plot.axes import FAINT, FRAME, GRID, INK
from core.plot.canvas import PngCanvas

Array = NDArray[np.float64]

SHADES = ("#1f6fb2", "#4fa3a0", "#b0661a", "#8a4fb0", "#6b7480")
RULE = "#c8323c"
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 920.0, 320.0, 56.0, 16.0, 74.0, 40.0
CUT = 60.0  # beyond this a bar is cut, and its number stands on it


class Bars:
    """Bars of percentages, a group for each case.

    Args:
        title: of all. rule: the percentage that a dashed line marks.
    """

    def __init__(self, title: str, rule: float) -> None:
        self.title, self.rule = title, rule
        self.groups: list[tuple[str, Array]] = []

    def group(self, name: str, rows: Array) -> None:
        """Add a group: one bar a column, its height the mean of the rows, its whisker from least to greatest."""
        self.groups.append((name, np.asarray(rows, float)))

    def write(self, path: Path) -> None:
        """Draw and write all of it."""
        canvas = PngCanvas(WIDTH, HEIGHT)
        canvas.text(24, 24, self.title, 9.5, INK)
        base, tall = HEIGHT - BOTTOM, HEIGHT - BOTTOM - TOP

        def y(percent: float) -> float:
            return base - tall * min(max(percent, 0.0), CUT) / CUT

        for tick in np.arange(0.0, CUT + 1.0, 10.0):
            canvas.line(LEFT, y(tick), WIDTH - RIGHT, y(tick), GRID, 0.75)
            canvas.text(LEFT - 6, y(tick) + 3, f"{tick:.0f}", 6.5, FAINT, "end")
        canvas.text(24, TOP - 12, "%", 7, INK)
        step = (WIDTH - LEFT - RIGHT) / max(len(self.groups), 1)
        for g, (name, rows) in enumerate(self.groups):
            bars = rows.shape[1]
            wide = 0.8 * step / bars
            for k in range(bars):
                x = LEFT + (g + 0.1) * step + k * wide
                mean, low, high = rows[:, k].mean(), rows[:, k].min(), rows[:, k].max()
                canvas.rectangle(x + 1, y(mean), wide - 2, max(base - y(mean), 0.75), SHADES[k % len(SHADES)])
                middle = x + 0.5 * wide
                if low < CUT:
                    canvas.line(middle, y(low), middle, y(high), INK, 1.0)
                canvas.text(middle, y(high) - 4, f"{round(mean)}", 6.5, INK, "middle")
            canvas.text(LEFT + (g + 0.5) * step, base + 16, name, 8, INK, "middle")
        canvas.line(LEFT, y(self.rule), WIDTH - RIGHT, y(self.rule), RULE, 1.0, 4.0)
        canvas.line(LEFT, base, WIDTH - RIGHT, base, FRAME, 0.75)
        canvas.text((LEFT + WIDTH - RIGHT) / 2, base + 32, "interaction (motors expected)", 7, INK, "middle")
        for k in range(max((rows.shape[1] for _, rows in self.groups), default=0)):
            canvas.rectangle(24 + 76 * k, 36, 14, 6, SHADES[k % len(SHADES)])
            canvas.text(42 + 76 * k, 43, f"{k + 1} motor{'s' if k else ''}", 7, INK)
        canvas.text(24 + 76 * 5 + 30, 43, f"dashed: the rule, {self.rule:g} %", 7, RULE)
        write_bytes(path, canvas.to_bytes())

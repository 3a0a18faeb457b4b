"""Axes of a chart: scales, grids, curves and legends."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array
from .canvas import Canvas

INK, FAINT, GRID, PAPER, FRAME = "#20262e", "#6b7480", "#e4e7eb", "#ffffff", "#b9c0c8"
LIMIT, TOUCH = "#c8503c", "#fdebc8"
SMALL = 7.5  # [points] height of a capital letter in all texts but titles
MAX_POINTS = 4000  # largest number of points of a curve; a longer one is thinned, see `thinned`


class Axes:
    """Two axes of a chart.

    Args:
        canvas: canvas on which the axes are drawn.
        box: left, top, width and height of the frame [points]; labels and names lie outside it.
        xlim, ylim: values at the left and right edge, and at the bottom and top edge.
    """

    def __init__(
        self,
        canvas: Canvas,
        box: tuple[float, float, float, float],
        xlim: tuple[float, float],
        ylim: tuple[float, float],
    ) -> None:
        self.canvas, self.xlim, self.ylim = canvas, xlim, ylim
        self.left, self.top, self.width, self.height = box
        self.right, self.bottom = self.left + self.width, self.top + self.height

    def x(self, values: ArrayLike) -> Array:
        """Return the horizontal positions of values on the canvas [points]."""
        low, high = self.xlim
        return self.left + self.width * (np.asarray(values, dtype=np.float64) - low) / (high - low)

    def y(self, values: ArrayLike) -> Array:
        """Return the vertical positions of values on the canvas [points].

        They are measured downwards.
        """
        low, high = self.ylim
        return self.top + self.height * (high - np.asarray(values, dtype=np.float64)) / (high - low)

    def band(self, first: float, last: float) -> None:
        """Shade the interval between two values of x.

        It is to be called before `grid`, which is drawn on top.
        """
        left, right = self.x([first, last]).tolist()
        self.canvas.rectangle(left, self.top, right - left, self.height, TOUCH)

    def bands(self, times: Array, contact: Array) -> None:
        """Shade the intervals in which contact is above one half.

        Each sample extends half-way to its neighbours.
        """
        edges = np.r_[times[:1], (times[1:] + times[:-1]) / 2, times[-1:]]
        for part in runs(np.asarray(contact) > 0.5):
            self.band(float(edges[part.start]), float(edges[part.stop]))

    def grid(
        self, across: str, up: str, *, most: tuple[int, int] = (8, 5), factor: float = 1.0, colour: str = INK
    ) -> None:
        """Draw a grid at round values, with labels, frame and axis names.

        Args:
            across, up: names of the horizontal and the vertical axis.
            most: largest numbers of steps between labels, horizontally and vertically.
            factor: divisor of y for the labels.
            colour: colour of the name `up`.
        """
        draw = self.canvas
        marks = ticks(*self.xlim, most[0])
        for value, x in zip(marks, self.x(marks).tolist(), strict=True):
            draw.line(x, self.top, x, self.bottom + 4, GRID, 0.75)
            draw.text(x, self.bottom + 14, label(value, marks), SMALL, FAINT, "middle")
        low, high = self.ylim
        marks = ticks(low / factor, high / factor, most[1])
        for value, y in zip(marks, self.y(np.multiply(marks, factor)).tolist(), strict=True):
            draw.line(self.left - 4, y, self.right, y, GRID, 0.75)
            draw.text(self.left - 7, y + 3.5, label(value, marks), SMALL, FAINT, "end")
        for y in (self.top, self.bottom):
            draw.line(self.left, y, self.right, y, FRAME, 0.75)
        for x in (self.left, self.right):
            draw.line(x, self.top, x, self.bottom, FRAME, 0.75)
        draw.text(self.left, self.top - 6, up, SMALL, colour)
        draw.text((self.left + self.right) / 2, self.bottom + 29, across, SMALL, FAINT, "middle")

    def level(self, value: float) -> None:
        """Draw a dashed line at a value of y.

        It is drawn only if the value lies between the limits of y.
        """
        if self.ylim[0] <= value <= self.ylim[1]:
            y = float(self.y(value))
            self.canvas.line(self.left, y, self.right, y, LIMIT, 1.0, 4.0)

    def between(self, x: Array, low: Array, high: Array, colour: str) -> None:
        """Fill the area between two curves over rising x.

        It is filled with strips about one point wide. It is to be called before a curve in the area is drawn.
        """
        if len(x) < 2:
            return
        every = np.unique(np.concatenate([x, np.linspace(x[0], x[-1], max(int(np.ptp(self.x(x[[0, -1]]))), 2))]))
        low, high, across = np.interp(every, x, low), np.interp(every, x, high), self.x(every)
        ends = [*np.flatnonzero(np.diff(np.floor(across))) + 1, len(every) - 1]
        for a, b in zip([0, *ends], ends, strict=False):
            top, bottom = float(self.y(high[a : b + 1].max())), float(self.y(low[a : b + 1].min()))
            top, bottom = max(top, self.top), min(bottom, self.bottom)
            if bottom > top and b > a:
                self.canvas.rectangle(float(across[a]), top, float(across[b] - across[a]), bottom - top, colour)

    def curve(self, x: Array, y: Array, colour: str, width: float = 1.3) -> None:
        """Draw y over rising x.

        The curve has a gap where y is not finite. A single sample between two gaps is drawn as a dot.
        """
        for part in runs(np.isfinite(y)):
            across, down = thinned(self.x(x[part]), self.y(y[part]), MAX_POINTS)
            if len(across) == 1:
                self.canvas.disc(float(across[0]), float(down[0]), 1.5, colour)
            else:
                self.canvas.path(across, down, colour, width)


def legend(canvas: Canvas, x: float, y: float, entries: list[tuple[str, str]]) -> float:
    """Draw a legend: names beside patches of their colours.

    Args:
        canvas: canvas on which the legend is drawn.
        x, y: left end of the base line [points].
        entries: name and colour of each entry.

    Returns:
        Horizontal position at which a further entry would begin [points].
    """
    for name, colour in entries:
        canvas.rectangle(x, y - 7, 12, 7, colour)
        canvas.text(x + 16, y, name, SMALL, FAINT)
        x += 36 + 0.8 * SMALL * len(name)
    return x


def ticks(low: float, high: float, most: int) -> list[float]:
    """Return round values from low to high, at most `most` + 1.

    The distance of the values is 1, 2 or 5 times a power of ten.
    """
    raw = (high - low) / most
    power = 10.0 ** np.floor(np.log10(raw))
    step = next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= raw * (1 - 1e-9))
    count = np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1)
    return [float(f"{v:.12g}") + 0.0 for v in (count * step).tolist()]


def label(value: float, marks: list[float]) -> str:
    """Return the label of a value.

    It has as many decimals as the distance of the marks requires. If these are more than 6, or if the value is 1e6 or
    more in size, it has four significant digits instead.
    """
    step = min((b - a for a, b in zip(marks, marks[1:], strict=False)), default=1.0)
    decimals = max(0, int(-np.floor(np.log10(step) + 1e-9)))
    if decimals > 6 or abs(value) >= 1e6:
        return f"{value:.4g}"
    return f"{value:.{decimals}f}"


def thinned(x: Array, y: Array, most: int) -> tuple[Array, Array]:
    """Return about `most` points of a curve that look like all of them.

    The curve is divided into sections. Of each section the first, the least, the greatest and the last point are kept.
    """
    if len(x) <= most:
        return x, y
    starts = np.unique(np.linspace(0, len(x), most // 4 + 1).astype(int)[:-1])
    ends = np.r_[starts[1:], len(x)]
    keep = {0, len(x) - 1}
    for a, b in zip(starts.tolist(), ends.tolist(), strict=True):
        keep |= {a, a + int(np.argmin(y[a:b])), a + int(np.argmax(y[a:b])), b - 1}
    rows = np.array(sorted(keep))
    return x[rows], y[rows]


def runs(mask: NDArray[np.bool_]) -> list[slice]:
    """Return the intervals in which a mask is true, as slices."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(np.int8)))
    return [slice(a, b) for a, b in edges.reshape(-1, 2).tolist()]

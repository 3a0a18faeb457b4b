"""Picture of target and rendered touch.

It shows the measures over time, and the pressure on the pad.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..plot.axes import FAINT, INK, PAPER, SMALL, Axes, legend
from ..plot.canvas import Canvas, SvgCanvas
from .device_comparison import Row
from .measures import Measure, PadMap

# [points] LEFT, TOP and FOOT: margins of the picture. PANEL: height of a panel. GAP: gap below a panel.
LEFT, TOP, PANEL, GAP, FOOT = 62.0, 50.0, 104.0, 54.0, 40.0
PLOT, MAP = 430.0, 132.0  # [points] width of a panel, and largest width of a map of the pad
TARGET, RENDERED = INK, "#d9650a"
SMALL_LENGTH = 1e-4  # [m] lengths below it are shown in micrometres
UNITS = {"Pa": (1e3, "kPa"), "m": (1e-3, "mm"), "1": (1.0, "")}
DARK, LIGHT = np.array([0x14, 0x2F, 0x5C]), np.array([0xC4, 0xD3, 0xE8])


def shown_unit(measure: Measure) -> tuple[float, str]:
    """Return the unit in which a measure is shown.

    Returns:
        Size of the unit in SI units, and name of the unit.
    """
    if measure.unit == "m" and max(float(measure.target.max()), float(measure.rendered.max())) < SMALL_LENGTH:
        return 1e-6, "µm"
    return UNITS.get(measure.unit, (1.0, measure.unit))


def svg(row: Row, duration: float) -> str:
    """Return the picture of one device as SVG.

    Args:
        duration: duration of the scene [s].
    """
    canvas = SvgCanvas(*size(row))
    draw(row, duration, canvas)
    return canvas.to_bytes().decode("utf-8")


def size(row: Row) -> tuple[float, float]:
    """Return width and height of a device's picture [points]."""
    count = len(row.judged.measures)
    width = LEFT + PLOT + 24.0 + (2 * MAP + 48.0 if row.judged.pad is not None else 0.0)
    return width, TOP + count * PANEL + (count - 1) * GAP + FOOT


def draw(row: Row, duration: float, canvas: Canvas) -> None:
    """Draw the whole picture of a device."""
    width, height = size(row)
    canvas.rectangle(0, 0, width, height, PAPER)
    canvas.text(LEFT, 20, row.title, 10.0, INK)
    legend(canvas, LEFT + PLOT - 130, 20, [("target", TARGET), ("rendered", RENDERED)])
    for i, measure in enumerate(row.judged.measures):
        _series(canvas, measure, TOP + i * (PANEL + GAP), duration)
    if row.judged.pad is not None:
        _pads(canvas, row.judged.pad, LEFT + PLOT + 44.0)


def _series(canvas: Canvas, measure: Measure, top: float, duration: float) -> None:
    factor, unit = shown_unit(measure)
    values = np.concatenate([measure.target, measure.rendered])
    low, high = min(float(values.min()), 0.0), float(values.max())
    high = high if high > low else low + 1.0
    axes = Axes(canvas, (LEFT, top, PLOT, PANEL), (0.0, max(duration, 1e-9)), (low, high + 0.07 * (high - low)))
    axes.grid("time [s]", f"{measure.name} [{unit}]" if unit else measure.name, factor=factor, colour=INK)
    canvas.text(axes.right, top - 6, f"{100 * measure.off:.0f} % off", SMALL, RENDERED, "end")
    times, gaps = measure.times, _gaps(measure.times)
    for series, colour in ((measure.target, TARGET), (measure.rendered, RENDERED)):
        axes.curve(np.insert(times, gaps, times[gaps]), np.insert(series, gaps, np.nan), colour)


def _gaps(times: Array) -> NDArray[np.intp]:
    """Return the indices of samples that follow a long gap.

    A curve is interrupted there.
    """
    step = np.diff(times)
    return np.flatnonzero(step > 3.0 * np.median(step)) + 1 if len(step) else np.zeros(0, np.intp)


def _pads(canvas: Canvas, pad: PadMap, left: float) -> None:
    """Draw the target and the rendered pressure on the pad.

    The pad is seen from the nail's side, with the tip up.
    """
    low, high = pad.nodes.min(axis=0), pad.nodes.max(axis=0)
    zoom = min(MAP / max(high[0] - low[0], 1e-9), 2.2 * MAP / max(high[1] - low[1], 1e-9))
    dot = 0.45 * zoom * np.sqrt(float(np.prod(high - low)) / len(pad.nodes))
    top = max(float(pad.target.max()), 1e-9)
    for k, (name, values) in enumerate((("target", pad.target), ("rendered", pad.rendered))):
        x0 = left + k * (MAP + 16.0)
        places, shares = zoom * (pad.nodes - low), np.clip(values / top, 0.0, 1.0)
        for i in np.argsort(shares, kind="stable").tolist():
            share, (x, y) = float(shares[i]), places[i].tolist()
            tone = np.rint(LIGHT + share * (DARK - LIGHT)).astype(int).tolist()
            radius = dot if share > 1e-3 else 0.25 * dot
            canvas.disc(x0 + x, TOP + zoom * (high[1] - low[1]) - y, radius, "#{:02x}{:02x}{:02x}".format(*tone))
        canvas.text(x0, TOP - 14, f"{name}: {1e-3 * float(values.max()):.3g} kPa", SMALL, FAINT)
    canvas.text(left, TOP - 26, f"pressure at {pad.time:.2f} s", SMALL, INK)

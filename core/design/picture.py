"""The answer to 'how many motors?' as a picture: error against the number of motors.

Source: [S2] fig. 7 and 8
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import DermisError
from ..files import write_bytes
from ..plot.canvas import Canvas, PngCanvas, SvgCanvas
from .report import Design
from .synergies import CHOICES

INK, FAINT, GRID, PAPER, CHOSEN = "#20262e", "#6b7480", "#e4e7eb", "#ffffff", "#c8503c"
BARS = {"variance": "#1f6fb2", "rendered": "#12876f"}


def write_picture(found: Design, path: Path) -> None:
    """Write error against number of motors as PNG or SVG, by the path's ending.

    Raises:
        DermisError: another ending, or the file cannot be written.
    """
    width, height = 640.0, 360.0
    suffix = Path(path).suffix.lower()
    if suffix not in (".png", ".svg"):
        raise DermisError("unknown kind of picture", where=str(path), value=suffix, limit=".png, .svg")
    canvas: PngCanvas | SvgCanvas = PngCanvas(width, height, 2.0) if suffix == ".png" else SvgCanvas(width, height)
    _draw(found, canvas, width, height)
    write_bytes(Path(path), canvas.to_bytes())


def _draw(found: Design, canvas: Canvas, width: float, height: float) -> None:
    left, right, top, bottom = 64.0, 20.0, 86.0, 46.0
    canvas.rectangle(0, 0, width, height, PAPER)
    n = len(found.spec.channels)
    motors = found.by("variance").motors
    canvas.text(left, 22, f"How many motors? {found.spec.name}", 10, INK)
    said = f"{motors} of {n}" if motors < n else f"all {n}"
    canvas.text(left, 42, f"{said}, for {', '.join(found.names)}"[:80], 8.5, FAINT)
    # beyond 160 % a bar says no more: it is cut, and its number stands on it
    most = min(max(float(np.max([r.mean_percent for r in found.joint])), 150.0 * found.knee), 160.0)
    base, tall = height - bottom, height - bottom - top

    def y(percent: float) -> float:
        return base - tall * min(max(percent, 0.0), most) / most

    for tick in np.linspace(0.0, most, 5):
        canvas.line(left, y(tick), width - right, y(tick), GRID, 0.75)
        canvas.text(left - 6, y(tick) + 3, f"{tick:.0f}", 7.5, FAINT, "end")
    step = (width - left - right) / n
    for k in range(n):
        for i, reduction in enumerate(found.joint):
            value = float(reduction.mean_percent[k])
            x = left + k * step + step * (0.16 + 0.34 * i)
            canvas.rectangle(x, y(value), step * 0.3, max(base - y(value), 0.75), BARS[reduction.choice])
            canvas.text(x + step * 0.15, y(value) - 4, f"{value:.0f}", 7, INK, "middle")
        own = k + 1 == motors
        canvas.text(left + (k + 0.5) * step, base + 15, str(k + 1), 9 if own else 8, CHOSEN if own else INK, "middle")
    canvas.line(left, y(100 * found.knee), width - right, y(100 * found.knee), CHOSEN, 1.5, 6.0)
    canvas.text(width - right, y(100 * found.knee) - 4, "rule", 7.5, CHOSEN, "end")
    canvas.line(left, base, width - right, base, INK, 1.0)
    canvas.text(left + (width - left - right) / 2, base + 32, "motors", 8, INK, "middle")
    for i, choice in enumerate(CHOICES):
        x = width - right - 220 + 110 * i
        canvas.rectangle(x, 53, 9, 9, BARS[choice])
        canvas.text(x + 14, 61, f"by {choice}", 7.5, FAINT)
    canvas.text(left, 61, "error above all motors [%]", 7.5, FAINT)

"""The answer to 'how many motors?' as a picture: error against the number of motors.

Source: [S2] fig. 7 and 8
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import DermisError
from ..files import write_bytes
from ..plot.axes import FAINT, INK, LIMIT, PAPER, SMALL, Axes, legend
from ..plot.canvas import Canvas, PngCanvas, SvgCanvas
from .report import Design
from .synergies import CHOICES

LEFT, RIGHT, TOP, BOTTOM = 64.0, 20.0, 76.0, 46.0  # [points]
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
    canvas.rectangle(0, 0, width, height, PAPER)
    n, motors = len(found.spec.channels), found.by("variance").motors
    canvas.text(LEFT, 22, f"How many motors? {found.spec.name}", 10, INK)
    said = f"{motors} of {n}" if motors < n else f"all {n}"
    canvas.text(LEFT, 42, f"{said}, for {', '.join(found.names)}"[:80], 8.5, FAINT)
    # beyond 160 % a bar says no more: it is cut, and its number stands on it
    most = min(max(float(np.max([r.mean_percent for r in found.joint])), 150.0 * found.knee), 160.0)
    box = (LEFT, TOP, width - LEFT - RIGHT, height - TOP - BOTTOM)
    axes = Axes(canvas, box, (0.5, n + 0.5), (0.0, 1.1 * most))
    axes.band(motors - 0.5, motors + 0.5)
    axes.grid("motors", "error above all motors [%]", most=(n, 5), colour=FAINT)
    wide = axes.width / n
    for i, reduction in enumerate(found.joint):
        for k, value in enumerate(reduction.mean_percent.tolist()):
            x, y = float(axes.x(k + 0.66 + 0.34 * i)), float(axes.y(min(max(value, 0.0), most)))
            canvas.rectangle(x, y, 0.3 * wide, max(axes.bottom - y, 0.75), BARS[reduction.choice])
            canvas.text(x + 0.15 * wide, y - 4, f"{value:.0f}", 7, INK, "middle")
    axes.level(100 * found.knee)
    canvas.text(axes.right - 4, float(axes.y(100 * found.knee)) - 4, "rule", SMALL, LIMIT, "end")
    legend(canvas, axes.right - 220, TOP - 6, [(f"by {choice}", BARS[choice]) for choice in CHOICES])

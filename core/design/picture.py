"""Picture of a task-driven design: error against the number of motors.

Source: [S2] fig. 7 and 8
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import DermisError
from ..files import write_bytes
from ..plot.axes import FAINT, INK, LIMIT, PAPER, SMALL, Axes, legend
from ..plot.canvas import Canvas, PngCanvas, SvgCanvas
from .answer import Design
from .synergies import RULES, Rule

LEFT, RIGHT, TOP, BOTTOM = 64.0, 20.0, 76.0, 46.0  # [points]
BARS: dict[Rule, str] = {"touch": "#1f6fb2", "paper": "#a9b4bd"}
WORDS: dict[Rule, str] = {"touch": "lost of the touch", "paper": "above all motors (paper)"}


def write_picture(found: Design, path: Path, rule: Rule = "touch") -> None:
    """Write a bar chart of error against number of motors.

    The recommended number is marked.

    Args:
        found: result of the design.
        path: the file; its suffix .png or .svg sets the format.
        rule: rule that gives the recommended number.

    Raises:
        DermisError: the suffix is unknown, or the file cannot be written.
    """
    width, height = 640.0, 360.0
    suffix = Path(path).suffix.lower()
    if suffix not in (".png", ".svg"):
        raise DermisError("unknown kind of picture", where=str(path), value=suffix, limit=".png, .svg")
    canvas: PngCanvas | SvgCanvas = PngCanvas(width, height, 2.0) if suffix == ".png" else SvgCanvas(width, height)
    _draw(found, canvas, width, height, rule)
    write_bytes(Path(path), canvas.to_bytes())


def _draw(found: Design, canvas: Canvas, width: float, height: float, rule: Rule) -> None:
    canvas.rectangle(0, 0, width, height, PAPER)
    n, motors, limit = len(found.spec.channels), found.motors(rule), 100.0 * found.joint.limit
    canvas.text(LEFT, 22, f"How many motors? {found.spec.name}", 10, INK)
    said = "no number" if motors is None else f"{motors} of {n}" if motors < n else f"all {n}"
    said = said if motors is not None else f"{said}, all motors together leave too much"
    canvas.text(LEFT, 42, f"{said}, for {', '.join(found.names)}"[:80], 8.5, FAINT)
    # A bar is cut at 160 %, because longer ones are not more informative; its number stands above it.
    most = min(max(float(np.max([found.joint.mean_percent(r) for r in RULES])), 1.5 * limit), 160.0)
    box = (LEFT, TOP, width - LEFT - RIGHT, height - TOP - BOTTOM)
    axes = Axes(canvas, box, (0.5, n + 0.5), (0.0, 1.1 * most))
    if motors is not None:
        axes.band(motors - 0.5, motors + 0.5)
    axes.grid("motors", "left beyond all motors [%]", most=(n, 5), colour=FAINT)
    wide = axes.width / n
    for i, own in enumerate(RULES):
        for k, value in enumerate(found.joint.mean_percent(own).tolist()):
            x, y = float(axes.x(k + 0.66 + 0.34 * i)), float(axes.y(min(max(value, 0.0), most)))
            canvas.rectangle(x, y, 0.3 * wide, max(axes.bottom - y, 0.75), BARS[own])
            canvas.text(x + 0.15 * wide, y - 4, str(round(value)), 7, INK, "middle")
    axes.level(limit)
    canvas.text(axes.right - 4, float(axes.y(limit)) - 4, "rule", SMALL, LIMIT, "end")
    legend(canvas, axes.right - 300, TOP - 6, [(WORDS[own], BARS[own]) for own in RULES])

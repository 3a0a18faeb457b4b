"""Picture of stimuli in three components.

It has three views of a cloud of dots and of lines.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..files import write_bytes
from .axes import FAINT, INK, PAPER, SMALL, Axes, legend
from .canvas import Canvas, PngCanvas, SvgCanvas

SIDE, GAP, LEFT, TOP, FOOT = 240.0, 56.0, 56.0, 76.0, 64.0
WIDTH, HEIGHT = LEFT + 3 * SIDE + 2 * GAP + 20.0, TOP + SIDE + FOOT
COLOURS = {
    "target": "#2a9d3a", "predicted": "#d0342c", "rendered": "#2255cc", "estimated": "#d0342c", "measured": "#2255cc",
    "from A": "#2a9d3a", "from B": "#12306b",
}  # fmt: skip
VIEWS = ((0, 1), (0, 2), (1, 2))


def draw(
    cloud: Array, configuration: Array, lines: Mapping[str, Array], title: str, words: str, canvas: Canvas
) -> None:
    """Draw the whole picture, `WIDTH` by `HEIGHT` points.

    Args:
        cloud: stimuli that are drawn as dots, in three components, shape (n, 3).
        configuration: configuration of each dot, from -1 to 1, which sets its colour, shape (n, 3).
        lines: stimuli that are drawn as lines, in three components, shape (k, 3) each, by name, such as 'target',
            'predicted' or 'measured'.
    """
    canvas.rectangle(0, 0, WIDTH, HEIGHT, PAPER)
    canvas.text(LEFT, 24, title[:88], 11.0, INK)
    canvas.text(LEFT, 42, words[:120], SMALL, FAINT)
    every = np.concatenate([cloud, *lines.values()])
    low, high = every.min(axis=0), every.max(axis=0)
    half = 0.53 * float((high - low).max()) or 0.5  # one scale for all components, so that distances can be compared
    limits = [(m - half, m + half) for m in (0.5 * (low + high)).tolist()]
    tints = _tints(configuration)
    for k, (i, j) in enumerate(VIEWS):
        axes = Axes(canvas, (LEFT + k * (SIDE + GAP), TOP, SIDE, SIDE), limits[i], limits[j])
        axes.grid(f"component {i + 1}", f"component {j + 1}", most=(5, 5), colour=FAINT)
        for x, y, colour in zip(axes.x(cloud[:, i]).tolist(), axes.y(cloud[:, j]).tolist(), tints, strict=True):
            canvas.disc(x, y, 0.9, colour)
        for name, points in lines.items():
            if len(points):
                x, y = axes.x(points[:, i]), axes.y(points[:, j])
                canvas.path(x, y, COLOURS.get(name, INK), 1.5)
                canvas.disc(float(x[-1]), float(y[-1]), 2.6, COLOURS.get(name, INK))
    after = legend(canvas, LEFT, HEIGHT - 10, [(name, COLOURS.get(name, INK)) for name in lines])
    said = "dots: what the device can make felt, coloured by pitch, roll and depth"
    canvas.text(after, HEIGHT - 10, said, SMALL, FAINT)


def write(path: Path, cloud: Array, configuration: Array, lines: Mapping[str, Array], title: str, words: str) -> Path:
    """Write the picture as PNG or SVG; see `draw`.

    It is SVG if the name ends in .svg.

    Raises:
        DermisError: the file cannot be written.
    """
    vector = Path(path).suffix.lower() == ".svg"
    canvas: SvgCanvas | PngCanvas = SvgCanvas(WIDTH, HEIGHT) if vector else PngCanvas(WIDTH, HEIGHT)
    draw(cloud, configuration, lines, title, words, canvas)
    write_bytes(Path(path), canvas.to_bytes())
    return Path(path)


def _tints(configuration: Array) -> list[str]:
    """Return a light colour for each configuration.

    Red shows pitch, green roll, and blue depth.
    """
    levels = np.rint(165 + 62 * configuration).astype(int)
    return ["#{:02x}{:02x}{:02x}".format(*row) for row in levels.tolist()]

"""The three-component stimulus plot as a picture: three views of the cloud, with the touch's lines in them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..files import write_bytes
from .canvas import Canvas, PngCanvas, SvgCanvas

Array = NDArray[np.float64]

SIDE, GAP, LEFT, TOP, FOOT = 250.0, 16.0, 18.0, 62.0, 34.0
WIDTH, HEIGHT = 2 * LEFT + 3 * SIDE + 2 * GAP, TOP + SIDE + FOOT
PAPER, FRAME, INK, FAINT = "#ffffff", "#d5d8dc", "#22262b", "#7a828c"
COLOURS = {"target": "#2a9d3a", "predicted": "#d0342c", "rendered": "#2255cc", "from A": "#2a9d3a", "from B": "#12306b"}
VIEWS = ((0, 1), (0, 2), (1, 2))


def draw(
    cloud: Array, configuration: Array, lines: Mapping[str, Array], title: str, words: str, canvas: Canvas
) -> None:
    """Draw the whole picture, `WIDTH` by `HEIGHT` points.

    Args:
        cloud: dots in three components, shape (n, 3).
        configuration: of each dot, -1 to 1, decides its colour, shape (n, 3).
        lines: by name, 'target', 'predicted' or 'rendered', in three components, shape (k, 3) each.
    """
    canvas.rectangle(0, 0, WIDTH, HEIGHT, PAPER)
    canvas.text(LEFT, 24, title[:88], 11.0, INK)
    canvas.text(LEFT, 42, words[:120], 7.5, FAINT)
    every = np.concatenate([cloud, *lines.values()])
    low, high = every.min(axis=0), every.max(axis=0)
    size = float((high - low).max()) * 1.06 or 1.0  # one scale for all: distances can be compared
    middle = 0.5 * (low + high)
    for k, (i, j) in enumerate(VIEWS):
        x0, y0 = LEFT + k * (SIDE + GAP), TOP
        _frame(x0, y0, canvas)

        def place(points: Array, i: int = i, j: int = j, x0: float = x0, y0: float = y0) -> tuple[Array, Array]:
            x = x0 + SIDE * (0.5 + (points[:, i] - middle[i]) / size)
            y = y0 + SIDE * (0.5 - (points[:, j] - middle[j]) / size)
            return x, y

        for x, y, colour in zip(*place(cloud), _tints(configuration), strict=True):
            canvas.disc(float(x), float(y), 0.9, colour)
        for name, points in lines.items():
            if len(points):
                x, y = place(points)
                canvas.path(x, y, COLOURS.get(name, INK), 1.5)
                canvas.disc(float(x[-1]), float(y[-1]), 2.6, COLOURS.get(name, INK))
        canvas.text(x0 + SIDE / 2, y0 + SIDE + 13, f"components {i + 1} and {j + 1}", 7.0, FAINT, "middle")
    x = LEFT
    for name in lines:
        canvas.rectangle(x, HEIGHT - 11, 14, 2.5, COLOURS.get(name, INK))
        canvas.text(x + 18, HEIGHT - 7, name, 7.5, INK)
        x += 34 + 6.5 * len(name)
    canvas.text(x, HEIGHT - 7, "dots: what the device can make felt, coloured by pitch, roll and depth", 7.5, FAINT)


def write(path: Path, cloud: Array, configuration: Array, lines: Mapping[str, Array], title: str, words: str) -> Path:
    """Write the picture as PNG or, for a name that ends in .svg, as SVG; see `draw`.

    Raises:
        DermisError: the file cannot be written.
    """
    vector = Path(path).suffix.lower() == ".svg"
    canvas: SvgCanvas | PngCanvas = SvgCanvas(WIDTH, HEIGHT) if vector else PngCanvas(WIDTH, HEIGHT)
    draw(cloud, configuration, lines, title, words, canvas)
    write_bytes(Path(path), canvas.to_bytes())
    return Path(path)


def _frame(x: float, y: float, canvas: Canvas) -> None:
    for x0, y0, x1, y1 in ((0, 0, SIDE, 0), (0, SIDE, SIDE, SIDE), (0, 0, 0, SIDE), (SIDE, 0, SIDE, SIDE)):
        canvas.line(x + x0, y + y0, x + x1, y + y1, FRAME, 1.0)


def _tints(configuration: Array) -> list[str]:
    """Return a light colour for each configuration: red for pitch, green for roll, blue for depth."""
    levels = np.rint(165 + 62 * configuration).astype(int)
    return ["#{:02x}{:02x}{:02x}".format(*row) for row in levels.tolist()]

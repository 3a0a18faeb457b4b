"""Picture of a pin array's track: six maps above curves of two forces.

The maps show the pins at six moments. The curves are the total force and the largest force of a pin. A map
shows the array as its wearer would see it through the nail. Rows run along the finger with the tip up, columns from
left to right. Each pin is a disc whose area and colour show its force.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..devices.spec import DeviceSpec
from ..track.command_track import CommandTrack
from .axes import FAINT, FRAME, GRID, SMALL, Axes, legend
from .canvas import Canvas

MAPS, MAP_HEIGHT, GAP, PANEL, FOOT = 6, 90.0, 46.0, 136.0, 44.0
HEIGHT = MAP_HEIGHT + GAP + PANEL + FOOT  # [points]
COLD, HOT = np.array([0x2F, 0x6F, 0xB2]), np.array([0xD9, 0x4B, 0x2B])
LINES = (("total", "#1f6fb2"), ("largest pin force", "#b0661a"))


def draw(
    track: CommandTrack,
    contact: Array | None,
    canvas: Canvas,
    place: tuple[float, float, float],
    span: tuple[float, float],
) -> None:
    """Draw maps and curves, `HEIGHT` points high.

    Args:
        track: track of a pin array.
        contact: contact signal; the finger touches if it is above one half, shape (n,). None for no shading.
        canvas: canvas on which the picture is drawn.
        place: left, top and width [points].
        span: first and last time [s].
    """
    left, top, width = place
    limit = max((c.high for c in track.spec.channels if c.high is not None), default=0.0)
    high = limit or float(np.abs(track.values).max(initial=0.0)) or 1.0
    room = width / MAPS
    for k, share in enumerate(((np.arange(MAPS) + 0.5) / MAPS).tolist()):
        moment = span[0] + share * (span[1] - span[0])
        forces: Array = np.zeros(len(track.channels))
        if len(track.times):
            forces = track.values[int(np.argmin(np.abs(track.times - moment)))]
        pin_map(track.spec, forces, high, left + k * room + 4, top, room - 8, MAP_HEIGHT - 16, canvas)
        canvas.text(left + (k + 0.5) * room, top + MAP_HEIGHT, f"{moment:.2f} s", SMALL, FAINT, "middle")
    curves = (track.values.sum(axis=1), track.values.max(axis=1, initial=0.0))
    most = max(float(curves[0].max(initial=0.0)), 1e-3) * 1.08
    axes = Axes(canvas, (left, top + MAP_HEIGHT + GAP, width, PANEL), span, (0.0, most))
    if contact is not None:
        axes.bands(track.times, contact)
    axes.grid("time [s]", "force [N]")
    if limit > 0.0:
        axes.level(limit)
    for (_, colour), values in zip(LINES, curves, strict=True):
        axes.curve(track.times, values, colour)
    legend(canvas, left + 80, axes.top - 6, list(LINES))


def pin_map(
    spec: DeviceSpec, forces: Array, high: float, left: float, top: float, width: float, height: float, canvas: Canvas
) -> None:
    """Draw one map into a rectangle [points].

    Args:
        forces: forces of the pins [N], row by row along the finger, shape (pins,).
        high: force that is shown by the largest disc [N].
    """
    rows, columns = (int(spec.parameters.get(name, 0)) for name in ("rows", "columns"))
    if rows * columns != len(forces):
        columns = max(int(np.ceil(np.sqrt(len(forces)))), 1)
        rows = -(-len(forces) // columns)
    cell = min(width / columns, height / rows)
    x0, y0 = left + (width - columns * cell) / 2, top + (height - rows * cell) / 2
    canvas.rectangle(x0 - 2, y0 - 2, columns * cell + 4, rows * cell + 4, GRID)
    for pin, force in enumerate(forces.tolist()):
        row, column = divmod(pin, columns)
        x, y = x0 + (column + 0.5) * cell, y0 + (rows - row - 0.5) * cell
        canvas.disc(x, y, 0.08 * cell, FRAME)
        share = min(abs(force) / high, 1.0)
        if share > 1e-3:
            colour = np.rint(COLD + share * (HOT - COLD)).astype(int)
            canvas.disc(x, y, 0.46 * cell * np.sqrt(share), "#{:02x}{:02x}{:02x}".format(*colour.tolist()))

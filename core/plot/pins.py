"""The picture of a pin array's track: maps of the pins at six moments over the total force and the hardest pin.

A map shows the array as its wearer would see it through the nail: rows along the finger with the tip up, columns from
left to right, each pin a disc whose area and colour follow its force.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..devices.spec import DeviceSpec
from ..track.command_track import CommandTrack
from .axes import FAINT, FRAME, GRID, INK, LEFT, LIMIT, PAPER, RIGHT, TOUCH, WIDTH, thinned, ticks
from .canvas import Canvas

Array = NDArray[np.float64]

HEIGHT = 386.0
MAPS, MAP_TOP, MAP_HEIGHT = 6, 60.0, 100.0
PANEL_TOP, PANEL_HEIGHT = 202.0, 136.0
COLD, HOT = np.array([0x2F, 0x6F, 0xB2]), np.array([0xD9, 0x4B, 0x2B])
LINES = (("total", "#1f6fb2"), ("hardest pin", "#b0661a"))


def draw(track: CommandTrack, contact: Array | None, canvas: Canvas) -> None:
    """Draw the whole picture, `axes.WIDTH` by `HEIGHT` points."""
    canvas.rectangle(0, 0, WIDTH, HEIGHT, PAPER)
    title = track.spec.name if "finger" not in track.meta else f"{track.meta['finger']} · {track.spec.name}"
    canvas.text(LEFT, 25, title[:60], 11.5, INK)
    words = [
        track.meta.get("scene", ""),
        track.meta.get("method", ""),
        f"{len(track.times)} samples",
        f"{track.spec.rate:g} Hz",
    ]
    canvas.text(LEFT, 43, " · ".join(w for w in words if w)[:90], 7.5, FAINT)
    high = max((c.high for c in track.spec.channels if c.high is not None), default=0.0)
    high = high or float(np.abs(track.values).max(initial=0.0)) or 1.0
    first, last = (float(track.times[0]), float(track.times[-1])) if len(track.times) else (0.0, 1.0)
    last = last if last > first else first + 1.0
    moments = first + (np.arange(MAPS) + 0.5) / MAPS * (last - first)
    room = (WIDTH - LEFT - RIGHT) / MAPS
    for k, moment in enumerate(moments.tolist()):
        forces: Array = np.zeros(len(track.channels))
        if len(track.times):
            forces = track.values[int(np.argmin(np.abs(track.times - moment)))]
        pin_map(track.spec, forces, high, LEFT + k * room + 4, MAP_TOP, room - 8, MAP_HEIGHT, canvas)
        canvas.text(LEFT + (k + 0.5) * room, MAP_TOP + MAP_HEIGHT + 13, f"{moment:.2f} s", 7.5, FAINT, "middle")
    _panel(track, contact, first, last, canvas)


def pin_map(
    spec: DeviceSpec, forces: Array, high: float, left: float, top: float, width: float, height: float, canvas: Canvas
) -> None:
    """Draw one map into a rectangle [points].

    Args:
        forces: of the pins, row by row along the finger [N], shape (pins,).
        high: the force of a full disc [N].
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


def _panel(track: CommandTrack, contact: Array | None, first: float, last: float, canvas: Canvas) -> None:
    def across(t: Array | float) -> Array:
        return LEFT + (WIDTH - LEFT - RIGHT) * (np.asarray(t) - first) / (last - first)

    curves = (track.values.sum(axis=1), track.values.max(axis=1, initial=0.0))
    top_value = max(float(curves[0].max(initial=0.0)), 1e-3) * 1.08

    def down(v: Array | float) -> Array:
        return PANEL_TOP + PANEL_HEIGHT * (1.0 - np.asarray(v) / top_value)

    if contact is not None and len(track.times):
        touching = np.r_[False, np.asarray(contact) > 0.5, False]
        edges = np.flatnonzero(np.diff(touching.astype(np.int8))).reshape(-1, 2)
        for a, b in edges.tolist():
            x = float(across(track.times[a]))
            canvas.rectangle(x, PANEL_TOP, float(across(track.times[b - 1])) - x, PANEL_HEIGHT, TOUCH)
    for mark in ticks(0.0, top_value, 4):
        canvas.line(LEFT, float(down(mark)), WIDTH - RIGHT, float(down(mark)), GRID, 0.75)
        canvas.text(LEFT - 7, float(down(mark)) + 3.5, f"{mark:g}", 7.5, FAINT, "end")
    base = PANEL_TOP + PANEL_HEIGHT
    for t in ticks(first, last, 8):
        canvas.line(float(across(t)), PANEL_TOP, float(across(t)), base + 4, GRID, 0.75)
        canvas.text(float(across(t)), base + 16, f"{t:g}", 7.5, FAINT, "middle")
    canvas.line(LEFT, base, WIDTH - RIGHT, base, FRAME, 0.75)
    canvas.line(LEFT, PANEL_TOP, LEFT, base, FRAME, 0.75)
    high = max((c.high for c in track.spec.channels if c.high is not None), default=0.0)
    if 0.0 < high < top_value:
        canvas.line(LEFT, float(down(high)), WIDTH - RIGHT, float(down(high)), LIMIT, 1.0, 4.0)
    for k, ((name, colour), values) in enumerate(zip(LINES, curves, strict=True)):
        if len(track.times) > 1:
            some, thin = thinned(track.times, values, 4000)
            canvas.curve(across(some), down(thin), colour, 1.3)
        canvas.text(LEFT + 10 + 120 * k, PANEL_TOP - 6, f"{name} [N]", 7.5, colour)
    canvas.text((LEFT + WIDTH - RIGHT) / 2, base + 34, "time [s]", 8, INK, "middle")

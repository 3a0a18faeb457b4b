"""Pictures of a command track: one panel a channel over a common time, as SVG or PNG."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..devices.spec import Channel
from ..files import write_bytes
from ..track.command_track import CommandTrack
from .axes import FAINT, FRAME, GRID, INK, LEFT, LIMIT, PAPER, RIGHT, TOUCH, WIDTH, thinned, ticks
from .canvas import Canvas, PngCanvas, SvgCanvas

Array = NDArray[np.float64]

PANEL, GAP = 92.0, 16.0
TOP, BOTTOM = 62.0, 46.0
LINES = ("#1f6fb2", "#12876f", "#8a4fb0", "#b0661a", "#4c5fc4", "#a33a6a")
MOST_POINTS = 4000  # of a curve in SVG; beyond, each step keeps its first, least, greatest and last value

# Which steps of thousand a unit may be shown in; others are shown as they are.
_PREFIXES = ((1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"))
_SCALED = ("m", "m/s", "N", "Pa", "V", "Hz", "s", "N*m")


def write_svg(track: CommandTrack, path: Path | str, *, contact: Array | None = None) -> None:
    """Write a track's plot as SVG.

    Args:
        contact: where it is above one half the finger touches, which is shaded; shape (n,).

    Raises:
        DermisError: the file cannot be written.
    """
    canvas = SvgCanvas(WIDTH, _height(track))
    _picture(track, contact, canvas)
    write_bytes(Path(path), canvas.to_bytes())


def write_png(track: CommandTrack, path: Path | str, *, contact: Array | None = None, scale: float = 2.0) -> None:
    """Write a track's plot as PNG, `scale` pixels a point; arguments as in `write_svg`.

    Raises:
        DermisError: the file cannot be written.
    """
    canvas = PngCanvas(WIDTH, _height(track), scale)
    _picture(track, contact, canvas)
    write_bytes(Path(path), canvas.to_bytes())


def _picture(track: CommandTrack, contact: Array | None, canvas: Canvas) -> None:
    """Draw a panel a channel; pins, which are too many for that, as maps."""
    if track.spec.kind == "pin_array":
        from .pins import draw

        draw(track, contact, canvas)
        return
    _draw(track, contact, canvas)


def _height(track: CommandTrack) -> float:
    if track.spec.kind == "pin_array":
        from .pins import HEIGHT

        return HEIGHT
    return TOP + len(track.channels) * (PANEL + GAP) - GAP + BOTTOM


def _draw(track: CommandTrack, contact: Array | None, canvas: Canvas) -> None:
    canvas.rectangle(0, 0, WIDTH, _height(track), PAPER)
    _title(track, contact is not None, canvas)
    first, last = (float(track.times[0]), float(track.times[-1])) if len(track.times) else (0.0, 1.0)
    if last <= first:
        last = first + 1.0
    x_ticks = ticks(first, last, 8)
    for i, channel in enumerate(track.channels):
        top = TOP + i * (PANEL + GAP)
        if contact is not None:
            _shade(track.times, contact, first, last, top, canvas)
        for t in x_ticks:
            x = _across(t, first, last)
            canvas.line(x, top, x, top + PANEL, GRID, 0.75)
        _panel(channel, track.times, track.values[:, i], first, last, top, LINES[i % len(LINES)], canvas)
    base = _height(track) - BOTTOM
    for t in x_ticks:
        x = _across(t, first, last)
        canvas.line(x, base, x, base + 4, FRAME, 0.75)
        canvas.text(x, base + 16, _label(t, x_ticks), 7.5, FAINT, "middle")
    canvas.text((LEFT + WIDTH - RIGHT) / 2, base + 34, "time [s]", 8, INK, "middle")


def _title(track: CommandTrack, shaded: bool, canvas: Canvas) -> None:
    title = track.spec.name if "finger" not in track.meta else f"{track.meta['finger']} · {track.spec.name}"
    canvas.text(LEFT, 25, _short(title, 60), 11.5, INK)
    words = [track.meta[k] for k in ("scene",) if track.meta.get(k)]
    words += [f"{len(track.times)} samples", f"{track.spec.rate:g} Hz", f"{track.duration:.4g} s"]
    changed = sum(track.limited.values())
    if changed:
        words.append(f"{changed} values limited")
    canvas.text(LEFT, 43, _short(" · ".join(words), 90), 7.5, FAINT)
    x = WIDTH - RIGHT
    for text, colour, wanted in (
        ("limit", LIMIT, any(c.low is not None or c.high is not None for c in track.channels)),
        ("contact", TOUCH, shaded),
    ):
        if wanted:
            canvas.text(x, 43, text, 7.5, FAINT, "end")
            x -= 6.6 * len(text) + 8
            if colour == TOUCH:
                canvas.rectangle(x - 18, 34, 18, 11, colour)
            else:
                canvas.line(x - 18, 40, x, 40, colour, 1.0, 3.0)
            x -= 34


def _panel(
    channel: Channel, times: Array, values: Array, first: float, last: float, top: float, colour: str, canvas: Canvas
) -> None:
    good = np.isfinite(values)
    low, high = _range(channel, values[good])
    factor, unit = _shown_unit(channel.unit, max(abs(low), abs(high)))

    def y_of(value: Array | float) -> Array:
        return top + PANEL * (high - np.asarray(value)) / (high - low)

    y_ticks = ticks(low / factor, high / factor, 4)
    for v in y_ticks:
        y = float(y_of(v * factor))
        canvas.line(LEFT, y, WIDTH - RIGHT, y, GRID, 0.75)
        canvas.text(LEFT - 7, y + 3.5, _label(v, y_ticks), 7.5, FAINT, "end")
    for limit in (channel.low, channel.high):
        if limit is not None and low <= limit <= high:
            y = float(y_of(limit))
            canvas.line(LEFT, y, WIDTH - RIGHT, y, LIMIT, 1.0, 4.0)
    for x0, y0, x1, y1 in (
        (LEFT, top, WIDTH - RIGHT, top),
        (LEFT, top + PANEL, WIDTH - RIGHT, top + PANEL),
        (LEFT, top, LEFT, top + PANEL),
        (WIDTH - RIGHT, top, WIDTH - RIGHT, top + PANEL),
    ):
        canvas.line(x0, y0, x1, y1, FRAME, 0.75)
    for part in _runs(good):
        if part.stop - part.start == 1:
            t = _across(float(times[part.start]), first, last)
            canvas.rectangle(t - 1.5, float(y_of(values[part.start])) - 1.5, 3, 3, colour)
        else:
            t_part, v_part = thinned(times[part], values[part], MOST_POINTS)
            canvas.curve(LEFT + (WIDTH - LEFT - RIGHT) * (t_part - first) / (last - first), y_of(v_part), colour, 1.3)
    name = f"{channel.name} [{unit}]" if unit else channel.name
    canvas.rectangle(LEFT + 5, top + 4, 5.6 * len(name) + 10, 15, PAPER)
    canvas.text(LEFT + 10, top + 15, name, 7.5, colour)


def _shade(times: Array, contact: Array, first: float, last: float, top: float, canvas: Canvas) -> None:
    """Shade the times of contact, from each sample half way to its neighbours."""
    if len(times) == 0:
        return
    middle = (times[1:] + times[:-1]) / 2
    start, end = np.r_[times[0], middle], np.r_[middle, times[-1]]
    for part in _runs(np.asarray(contact) > 0.5):
        x0, x1 = _across(float(start[part.start]), first, last), _across(float(end[part.stop - 1]), first, last)
        canvas.rectangle(x0, top, x1 - x0, PANEL, TOUCH)


def _range(channel: Channel, values: Array) -> tuple[float, float]:
    """Choose what a panel shows: the values and, where they come near, the limits."""
    low, high = (float(values.min()), float(values.max())) if len(values) else (channel.rest, channel.rest)
    low, high = min(low, channel.rest), max(high, channel.rest)
    for limit in (channel.low, channel.high):
        if limit is not None and (high == low or max(abs(low), abs(high)) > 0.3 * abs(limit)):
            low, high = min(low, limit), max(high, limit)
    if high - low <= 1e-12 * max(abs(low), abs(high)):
        size = abs(low) or 1.0
        low, high = low - size, high + size
    pad = 0.07 * (high - low)
    return low - pad, high + pad


def _shown_unit(unit: str, largest: float) -> tuple[float, str]:
    """Return the factor and name of the unit in which a number reads well."""
    if unit == "1":
        return 1.0, ""
    if unit in _SCALED:
        for factor, prefix in _PREFIXES:
            if largest >= 0.3 * factor and (factor <= 1 or unit in ("Hz", "Pa")):
                return factor, f"{prefix}{unit}"
    return 1.0, unit.replace("^2", "²")


def _runs(mask: NDArray[np.bool_]) -> list[slice]:
    """Return where a mask is true, as slices."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(np.int8)))
    return [slice(a, b) for a, b in edges.reshape(-1, 2).tolist()]


def _across(t: float, first: float, last: float) -> float:
    return LEFT + (WIDTH - LEFT - RIGHT) * (t - first) / (last - first)


def _label(value: float, all_values: list[float]) -> str:
    """Write a tick's number, with as many decimals as the distance of the ticks asks for."""
    step = min((b - a for a, b in zip(all_values, all_values[1:], strict=False)), default=1.0)
    decimals = max(0, int(-np.floor(np.log10(step) + 1e-9)))
    if decimals > 6 or abs(value) >= 1e6:
        return f"{value:.4g}"
    return f"{value:.{decimals}f}"


def _short(text: str, most: int) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"

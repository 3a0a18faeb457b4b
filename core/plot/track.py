"""Pictures of a command track as SVG or PNG.

They have a panel over time for each channel, or maps of pins.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..devices.spec import Channel
from ..files import write_bytes
from ..track.command_track import CommandTrack
from . import pins
from .axes import FAINT, INK, LIMIT, PAPER, SMALL, TOUCH, Axes, legend
from .canvas import Canvas, PngCanvas, SvgCanvas

WIDTH, LEFT, RIGHT = 920.0, 76.0, 24.0  # [points]
TOP, PANEL, GAP = 74.0, 92.0, 52.0
DOUBTED = "#f0b9a8"  # colour of the band of a spread
LINES = ("#1f6fb2", "#12876f", "#8a4fb0", "#b0661a", "#4c5fc4", "#a33a6a")

# Prefixes of the units in `_SCALED`, which are shown in steps of a thousand; other units are shown as they are.
_PREFIXES = ((1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"))
_SCALED = ("m", "m/s", "N", "Pa", "V", "Hz", "s", "N*m")


def write_svg(
    track: CommandTrack, path: Path | str, *, contact: Array | None = None, alike: Sequence[CommandTrack] = ()
) -> None:
    """Write a track's plot as SVG.

    Args:
        track: the track.
        path: path of the file.
        contact: contact signal, shape (n,); the intervals in which it is above one half are shaded.
        alike: other tracks of the same device, whose plots are to have the same units and scales.

    Raises:
        DermisError: the file cannot be written.
    """
    canvas = SvgCanvas(WIDTH, _height(track))
    _picture(track, contact, canvas, alike)
    write_bytes(Path(path), canvas.to_bytes())


def write_png(
    track: CommandTrack,
    path: Path | str,
    *,
    contact: Array | None = None,
    alike: Sequence[CommandTrack] = (),
    scale: float = 2.0,
) -> None:
    """Write a track's plot as PNG.

    `scale` is the number of pixels per point; other arguments as in `write_svg`.

    Raises:
        DermisError: the file cannot be written.
    """
    write_bytes(Path(path), png(track, contact=contact, alike=alike, scale=scale))


def png(
    track: CommandTrack,
    *,
    contact: Array | None = None,
    alike: Sequence[CommandTrack] = (),
    scale: float = 2.0,
    spread: Array | None = None,
) -> bytes:
    """Return a track's plot as the bytes of a PNG file.

    The arguments are those of `write_png`.

    Args:
        spread: half the width of a band about each curve, shape (n, channels). It is not drawn for maps of pins.
    """
    canvas = PngCanvas(WIDTH, _height(track), scale)
    _picture(track, contact, canvas, alike, spread)
    return canvas.to_bytes()


def _height(track: CommandTrack) -> float:
    return TOP + (pins.HEIGHT if _is_pins(track) else len(track.channels) * (PANEL + GAP))


def _is_pins(track: CommandTrack) -> bool:
    return track.spec.kind == "pin_array"  # it has too many channels to give each a panel


def _picture(
    track: CommandTrack,
    contact: Array | None,
    canvas: Canvas,
    alike: Sequence[CommandTrack],
    spread: Array | None = None,
) -> None:
    canvas.rectangle(0, 0, WIDTH, _height(track), PAPER)
    _heading(track, contact is not None, spread is not None, canvas)
    first, last = (float(track.times[0]), float(track.times[-1])) if len(track.times) else (0.0, 1.0)
    span, width = (first, last if last > first else first + 1.0), WIDTH - LEFT - RIGHT
    if _is_pins(track):
        pins.draw(track, contact, canvas, (LEFT, TOP, width), span)
        return
    ranges: dict[tuple[str, str], tuple[float, float]] = {}
    shown = [(c, v) for t in (track, *alike) for c, v in zip(t.channels, t.values.T, strict=True)]
    if spread is not None:
        shown += [(c, v) for s in (spread, -spread) for c, v in zip(track.channels, (track.values + s).T, strict=True)]
    for channel, values in shown:
        low, high = _range(channel, values[np.isfinite(values)])
        before = ranges.get(_likeness(channel), (low, high))
        ranges[_likeness(channel)] = min(low, before[0]), max(high, before[1])
    for i, channel in enumerate(track.channels):
        same = [r for (of, _), r in ranges.items() if of == channel.unit]
        factor, unit = _shown_unit(channel.unit, float(np.abs(same).max()))
        axes = Axes(canvas, (LEFT, TOP + i * (PANEL + GAP), width, PANEL), span, ranges[_likeness(channel)])
        if contact is not None:
            axes.bands(track.times, contact)
        colour, name = LINES[i % len(LINES)], f"{channel.name} [{unit}]" if unit else channel.name
        axes.grid("time [s]", name, factor=factor, colour=colour)
        for limit in (channel.low, channel.high):
            if limit is not None:
                axes.level(limit)
        if spread is not None:
            values, far = track.values[:, i], spread[:, i]
            axes.between(track.times, values - far, values + far, DOUBTED)
        axes.curve(track.times, track.values[:, i], colour)


def _heading(track: CommandTrack, shaded: bool, doubted: bool, canvas: Canvas) -> None:
    title = track.spec.name if "finger" not in track.meta else f"{track.meta['finger']} · {track.spec.name}"
    canvas.text(LEFT, 25, _short(title, 60), 11.5, INK)
    words = [track.meta[name] for name in ("scene", "method") if track.meta.get(name)]
    words += [f"{len(track.times)} samples", f"{track.spec.rate:g} Hz", f"{track.duration:.4g} s"]
    changed = sum(track.limited.values())
    if changed:
        words.append(f"{changed} values limited")
    canvas.text(LEFT, 43, _short(" · ".join(words), 90), SMALL, FAINT)
    limited = any(c.low is not None or c.high is not None for c in track.channels)
    entries = [("spread", DOUBTED)] * doubted + [("contact", TOUCH)] * shaded + [("limit", LIMIT)] * limited
    legend(canvas, WIDTH - RIGHT - 64.0 * len(entries), 43, entries)


def _likeness(channel: Channel) -> tuple[str, str]:
    """Return the key of the channels that share a scale.

    It is the unit, and the name without its last part.
    """
    return channel.unit, channel.name.rpartition("_")[0] or channel.name


def _range(channel: Channel, values: Array) -> tuple[float, float]:
    """Return the range of a panel.

    It covers the values and, if the values come near a limit, the limit.
    """
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
    """Return the unit with the prefix that suits the largest value.

    The results are the size of the unit and its name.
    """
    if unit == "1":
        return 1.0, ""
    if unit in _SCALED:
        for factor, prefix in _PREFIXES:
            if largest >= 0.3 * factor and (factor <= 1 or unit in ("Hz", "Pa")):
                return factor, f"{prefix}{unit}"
    return 1.0, unit.replace("^2", "²")


def _short(text: str, most: int) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"

"""Two things to draw on, with the same few strokes: an SVG text, and an array of pixels saved as PNG."""

from __future__ import annotations

import struct
import zlib
from typing import Any, Literal, Protocol
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from . import font

Array = NDArray[np.float64]
Anchor = Literal["start", "middle", "end"]
Colour = str  # '#rrggbb'


class Canvas(Protocol):
    """What a plot draws on. Lengths in points, y down."""

    def rectangle(self, x: float, y: float, width: float, height: float, fill: Colour) -> None:
        """Fill a rectangle."""

    def disc(self, x: float, y: float, radius: float, fill: Colour) -> None:
        """Fill a disc."""

    def line(self, x0: float, y0: float, x1: float, y1: float, colour: Colour, width: float, dash: float = 0.0) -> None:
        """Draw a horizontal or vertical line, dashed on request."""

    def curve(self, x: Array, y: Array, colour: Colour, width: float) -> None:
        """Draw y over rising x."""

    def path(self, x: Array, y: Array, colour: Colour, width: float) -> None:
        """Draw a line through points that may go anywhere."""

    def text(self, x: float, y: float, text: str, size: float, colour: Colour, anchor: Anchor = "start") -> None:
        """Write a text with its base line at y; `size` is the height of a capital."""


class SvgCanvas:
    """Draws as SVG, with three decimals, so that equal plots are equal texts."""

    def __init__(self, width: float, height: float) -> None:
        self._parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{_n(width)}" height="{_n(height)}" '
            f'viewBox="0 0 {_n(width)} {_n(height)}" font-family="DejaVu Sans, Arial, sans-serif">'
        ]

    def rectangle(self, x: float, y: float, width: float, height: float, fill: Colour) -> None:
        """Fill a rectangle."""
        self._parts.append(f'<rect x="{_n(x)}" y="{_n(y)}" width="{_n(width)}" height="{_n(height)}" fill="{fill}"/>')

    def disc(self, x: float, y: float, radius: float, fill: Colour) -> None:
        """Fill a disc."""
        self._parts.append(f'<circle cx="{_n(x)}" cy="{_n(y)}" r="{_n(radius)}" fill="{fill}"/>')

    def line(self, x0: float, y0: float, x1: float, y1: float, colour: Colour, width: float, dash: float = 0.0) -> None:
        """Draw a line, dashed on request."""
        dashes = f' stroke-dasharray="{_n(dash)}"' if dash else ""
        self._parts.append(
            f'<line x1="{_n(x0)}" y1="{_n(y0)}" x2="{_n(x1)}" y2="{_n(y1)}" stroke="{colour}" '
            f'stroke-width="{_n(width)}"{dashes}/>'
        )

    def curve(self, x: Array, y: Array, colour: Colour, width: float) -> None:
        """Draw y over rising x."""
        points = " ".join(f"{_n(a)},{_n(b)}" for a, b in zip(x.tolist(), y.tolist(), strict=True))
        self._parts.append(
            f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{_n(width)}" '
            'stroke-linejoin="round"/>'
        )

    def path(self, x: Array, y: Array, colour: Colour, width: float) -> None:
        """Draw a line through points that may go anywhere."""
        self.curve(x, y, colour, width)

    def text(self, x: float, y: float, text: str, size: float, colour: Colour, anchor: Anchor = "start") -> None:
        """Write a text with its base line at y."""
        printable = "".join(c if c.isprintable() else " " for c in text)
        self._parts.append(
            f'<text x="{_n(x)}" y="{_n(y)}" font-size="{_n(size * 1.37)}" fill="{colour}" '
            f'text-anchor="{anchor}">{escape(printable)}</text>'
        )

    def to_bytes(self) -> bytes:
        """Return the file."""
        return ("\n".join([*self._parts, "</svg>"]) + "\n").encode("utf-8")


class PngCanvas:
    """Draws into pixels, smoothed at edges.

    Args:
        width, height: [points].
        scale: pixels a point.
    """

    def __init__(self, width: float, height: float, scale: float = 2.0) -> None:
        self._scale = scale
        self._pixels = np.full((round(height * scale), round(width * scale), 3), 255.0, dtype=np.float32)

    def rectangle(self, x: float, y: float, width: float, height: float, fill: Colour) -> None:
        """Fill a rectangle, its edges shared with the pixels that they cut."""
        rows, columns, _ = self._pixels.shape
        across = _cover(x * self._scale, (x + width) * self._scale, columns)
        down = _cover(y * self._scale, (y + height) * self._scale, rows)
        i, j = np.flatnonzero(down), np.flatnonzero(across)
        if len(i) and len(j):
            self._blend(i[0], j[0], np.outer(down[i[0] : i[-1] + 1], across[j[0] : j[-1] + 1]), fill)

    def disc(self, x: float, y: float, radius: float, fill: Colour) -> None:
        """Fill a disc, its edge smoothed."""
        s = self._scale
        self._stroke(x * s, y * s, x * s, y * s, radius * s, fill)

    def line(self, x0: float, y0: float, x1: float, y1: float, colour: Colour, width: float, dash: float = 0.0) -> None:
        """Draw a horizontal or vertical line, dashed on request, laid on whole pixels."""
        s, length = self._scale, max(abs(x1 - x0), abs(y1 - y0))
        thick = max(round(width * s), 1) / s
        starts = np.arange(0.0, length, 2 * dash) if dash else np.array([0.0])
        for start in starts.tolist():
            part = min(dash, length - start) if dash else length
            if y0 == y1:
                top = round((y0 - thick / 2) * s) / s
                self.rectangle(min(x0, x1) + start, top, part, thick, colour)
            else:
                left = round((x0 - thick / 2) * s) / s
                self.rectangle(left, min(y0, y1) + start, thick, part, colour)

    def curve(self, x: Array, y: Array, colour: Colour, width: float) -> None:
        """Draw y over rising x: in every third of a pixel's column, what the line covers there."""
        s, fine = self._scale, 3
        x, y, half = x * s, y * s, width * s / 2
        first, last = int(np.floor(x[0] - half)), int(np.ceil(x[-1] + half))
        edges = np.linspace(first, last, (last - first) * fine + 1)
        low, high = _extent(x, y, edges[:-1] - half * 0.7, edges[1:] + half * 0.7)
        top, bottom = int(np.floor(low.min() - half)), int(np.ceil(high.max() + half))
        rows = np.arange(top, bottom)[:, None]
        cover = np.clip(np.minimum(rows + 1, high + half) - np.maximum(rows, low - half), 0.0, 1.0)
        cover = cover.reshape(len(rows), -1, fine).mean(axis=2)
        self._blend(top, first, cover, colour)

    def path(self, x: Array, y: Array, colour: Colour, width: float) -> None:
        """Draw a line through points that may go anywhere."""
        points = (np.stack([x, y], axis=1) * self._scale).tolist()
        for (x0, y0), (x1, y1) in zip(points[:-1], points[1:], strict=True):
            self._stroke(x0, y0, x1, y1, width * self._scale / 2, colour)

    def text(self, x: float, y: float, text: str, size: float, colour: Colour, anchor: Anchor = "start") -> None:
        """Write a text with its base line at y."""
        dot = size * self._scale / font.HEIGHT
        shift = {"start": 0.0, "middle": 0.5, "end": 1.0}[anchor] * font.width(text) * dot
        left, top = x * self._scale - shift, y * self._scale - size * self._scale
        for i, letter in enumerate(font.plain(text)):
            for stroke in font.strokes(letter):
                x0, x1 = (left + (i * font.ADVANCE + 0.5 + v) * dot for v in stroke[0::2])
                y0, y1 = (top + (0.5 + v) * dot for v in stroke[1::2])
                self._stroke(x0, y0, x1, y1, 0.52 * dot, colour)

    def to_bytes(self) -> bytes:
        """Return the file: 8 bits a colour, no date in it."""
        rows = np.clip(np.rint(self._pixels), 0, 255).astype(np.uint8)
        height, width, _ = rows.shape
        lines = np.concatenate([np.zeros((height, 1), np.uint8), rows.reshape(height, -1)], axis=1)
        return b"\x89PNG\r\n\x1a\n" + b"".join(
            (
                _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
                _chunk(b"IDAT", zlib.compress(lines.tobytes(), 6)),
                _chunk(b"IEND", b""),
            )
        )

    def _stroke(self, x0: float, y0: float, x1: float, y1: float, half: float, colour: Colour) -> None:
        """Draw a short line with round ends, by the distance of pixels from it."""
        top, left = int(min(y0, y1) - half - 1), int(min(x0, x1) - half - 1)
        rows = np.arange(top, int(max(y0, y1) + half + 2))[:, None] + 0.5
        columns = np.arange(left, int(max(x0, x1) + half + 2)) + 0.5
        length2 = (x1 - x0) ** 2 + (y1 - y0) ** 2
        along = ((columns - x0) * (x1 - x0) + (rows - y0) * (y1 - y0)) / length2 if length2 else 0.0
        along = np.clip(along, 0.0, 1.0)
        away = np.hypot(columns - x0 - along * (x1 - x0), rows - y0 - along * (y1 - y0))
        self._blend(top, left, np.clip(half + 0.5 - away, 0.0, 1.0), colour)

    def _blend(self, top: int, left: int, cover: NDArray[Any], colour: Colour) -> None:
        """Lay a colour over pixels, as much of it as `cover` says; what lies outside is left out."""
        rows, columns, _ = self._pixels.shape
        a, b = max(top, 0), min(top + cover.shape[0], rows)
        c, d = max(left, 0), min(left + cover.shape[1], columns)
        if a >= b or c >= d:
            return
        share = cover[a - top : b - top, c - left : d - left, None].astype(np.float32)
        ink = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)], dtype=np.float32)
        pixels = self._pixels[a:b, c:d]
        pixels += share * (ink - pixels)


def _extent(x: Array, y: Array, left: Array, right: Array) -> tuple[Array, Array]:
    """Return the least and the greatest y of the line in every window of x, shape (windows,) each."""
    ends = np.interp(np.concatenate([left, right]), x, y)
    first, after = np.searchsorted(x, left), np.searchsorted(x, right)
    low, high = (f(ends[: len(left)], ends[len(left) :]) for f in (np.minimum, np.maximum))
    inside = after > first
    for reduce, result in ((np.minimum, low), (np.maximum, high)):
        # reduceat over [first, after) pairs; every second result is the gap between two windows
        bounds = np.stack([first, after], axis=1)[inside].ravel()
        if len(bounds):
            found = reduce.reduceat(np.append(y, y[-1]), bounds)[::2]
            result[inside] = reduce(result[inside], found)
    return low, high


def _cover(start: float, end: float, count: int) -> Array:
    """Return how much of each of `count` pixels lies between two places."""
    pixels = np.arange(count)
    return np.clip(np.minimum(pixels + 1, end) - np.maximum(pixels, start), 0.0, 1.0)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _n(value: float) -> str:
    text = f"{value:.3f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text

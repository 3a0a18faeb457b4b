"""Canvases for plots: SVG, and pixels saved as PNG.

Pillow draws the pixels.
"""

from __future__ import annotations

import io
import unicodedata
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any, Literal, Protocol
from xml.sax.saxutils import escape

import numpy as np

from ..arrays import Array

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont

Anchor = Literal["start", "middle", "end"]
Colour = str  # '#rrggbb'

FINE = 4  # oversampling factor for round shapes and slanting lines
FONT_SIZE = 1.37  # font size divided by the height of a capital letter
_PLAIN = str.maketrans({"µ": "u", "μ": "u", "²": "^2", "–": "-"})  # characters that Pillow's own font lacks


class Canvas(Protocol):
    """Interface of a canvas. Lengths are in points, and y points downwards."""

    def rectangle(self, x: float, y: float, width: float, height: float, fill: Colour) -> None:
        """Fill a rectangle."""

    def disc(self, x: float, y: float, radius: float, fill: Colour) -> None:
        """Fill a disc."""

    def line(self, x0: float, y0: float, x1: float, y1: float, colour: Colour, width: float, dash: float = 0.0) -> None:
        """Draw a horizontal or vertical line, dashed on request."""

    def path(self, x: Array, y: Array, colour: Colour, width: float) -> None:
        """Draw a polyline through points."""

    def text(self, x: float, y: float, text: str, size: float, colour: Colour, anchor: Anchor = "start") -> None:
        """Write a text with its base line at y.

        `size` is the height of a capital letter.
        """


class SvgCanvas:
    """Canvas that writes SVG.

    Numbers have three decimals, so that equal plots give equal texts.
    """

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

    def path(self, x: Array, y: Array, colour: Colour, width: float) -> None:
        """Draw a polyline through points."""
        points = " ".join(f"{_n(a)},{_n(b)}" for a, b in zip(x.tolist(), y.tolist(), strict=True))
        self._parts.append(
            f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{_n(width)}" '
            'stroke-linejoin="round"/>'
        )

    def text(self, x: float, y: float, text: str, size: float, colour: Colour, anchor: Anchor = "start") -> None:
        """Write a text with its base line at y."""
        self._parts.append(
            f'<text x="{_n(x)}" y="{_n(y)}" font-size="{_n(size * FONT_SIZE)}" fill="{colour}" '
            f'text-anchor="{anchor}">{escape(_printable(text))}</text>'
        )

    def to_bytes(self) -> bytes:
        """Return the file."""
        return ("\n".join([*self._parts, "</svg>"]) + "\n").encode("utf-8")


class PngCanvas:
    """Canvas of pixels.

    Horizontal and vertical edges lie on whole pixels; all other edges are smoothed.

    Args:
        width, height: size of the canvas [points].
        scale: pixels per point.
    """

    def __init__(self, width: float, height: float, scale: float = 2.0) -> None:
        from PIL import Image

        self._scale = scale
        self._image = Image.new("RGB", (round(width * scale), round(height * scale)), "#ffffff")

    def rectangle(self, x: float, y: float, width: float, height: float, fill: Colour) -> None:
        """Fill a rectangle that is at least one pixel wide and high."""
        left, top, right, bottom = (int(np.floor(v * self._scale + 0.5)) for v in (x, y, x + width, y + height))
        self._image.paste(fill, (left, top, max(right, left + 1), max(bottom, top + 1)))

    def disc(self, x: float, y: float, radius: float, fill: Colour) -> None:
        """Fill a disc."""
        half = radius * self._scale * FINE

        def stroke(draw: Any, points: Array) -> None:
            (a, b), reach = points[0], half - 0.5
            draw.ellipse((a - reach, b - reach, a + reach, b + reach), fill=255)

        self._smooth(np.array([[x, y]]), radius, fill, stroke)

    def line(self, x0: float, y0: float, x1: float, y1: float, colour: Colour, width: float, dash: float = 0.0) -> None:
        """Draw a horizontal or vertical line, dashed on request."""
        length, width = max(abs(x1 - x0), abs(y1 - y0)), max(round(width * self._scale), 1) / self._scale
        for start in np.arange(0.0, length, 2 * dash).tolist() if dash else [0.0]:
            part = min(dash, length - start) if dash else length
            if y0 == y1:
                self.rectangle(min(x0, x1) + start, y0 - width / 2, part, width, colour)
            else:
                self.rectangle(x0 - width / 2, min(y0, y1) + start, width, part, colour)

    def path(self, x: Array, y: Array, colour: Colour, width: float) -> None:
        """Draw a polyline through points."""
        wide = max(round(width * self._scale * FINE), 1)

        def stroke(draw: Any, points: Array) -> None:
            draw.line([tuple(p) for p in points.tolist()], fill=255, width=wide)

        self._smooth(np.stack([x, y], axis=1), width, colour, stroke)

    def text(self, x: float, y: float, text: str, size: float, colour: Colour, anchor: Anchor = "start") -> None:
        """Write a text with its base line at y."""
        from PIL import ImageDraw

        at, font = (x * self._scale, y * self._scale), _font(size * self._scale * FONT_SIZE)
        where = {"start": "ls", "middle": "ms", "end": "rs"}[anchor]
        ImageDraw.Draw(self._image).text(at, _plain(text), fill=colour, font=font, anchor=where)

    def to_bytes(self) -> bytes:
        """Return the PNG file, with 8 bits per colour and without a date."""
        out = io.BytesIO()
        self._image.save(out, "PNG")
        return out.getvalue()

    def _smooth(self, points: Array, margin: float, colour: Colour, stroke: Callable[[Any, Array], None]) -> None:
        """Draw a smooth shape.

        `stroke` draws the shape on an oversampled mask, through which the colour is applied.

        Args:
            points: points of the shape [points].
            margin: distance by which the shape extends beyond these points [points].
            colour: colour of the shape.
            stroke: function that draws the shape, from a drawing object and the points in its pixels.
        """
        from PIL import Image, ImageDraw

        points, reach, size = points * self._scale, margin * self._scale + 1.0, np.array(self._image.size)
        low, high = np.floor(points.min(axis=0) - reach), np.ceil(points.max(axis=0) + reach)
        low, high = (np.clip(corner, 0, size).astype(int) for corner in (low, high))
        if (low < high).all():
            mask = Image.new("L", tuple(((high - low) * FINE).tolist()))
            stroke(ImageDraw.Draw(mask), (points - low) * FINE - 0.5)
            self._image.paste(colour, tuple(low.tolist()), mask.reduce(FINE))


@cache
def _font(size: float) -> FreeTypeFont:
    from PIL import ImageFont

    font = ImageFont.load_default(size)
    assert isinstance(font, ImageFont.FreeTypeFont)
    return font


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)


def _plain(text: str) -> str:
    """Return a text in characters that Pillow's font has.

    Accents are dropped. Other missing characters are kept and appear as boxes.
    """
    return "".join(unicodedata.normalize("NFKD", c)[0] for c in _printable(text).translate(_PLAIN))


def _n(value: float) -> str:
    text = f"{value:.3f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text

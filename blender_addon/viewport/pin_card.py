"""The card of a pin array: a map of its pins; colour and size follow the force."""

from __future__ import annotations

import numpy as np

from ..preview.pin_preview import Pins
from ..preview.rows import Row
from . import paint
from .parts import heat


def card(row: Row, pins: Pins | None, left: float, bottom: float, width: float, height: float, scale: float) -> None:
    """Draw the map of a pin array, and its figures [px].

    The map shows the array through the nail, with the tip up.
    """
    forces, high = row.numbers, max(row.full_scale(name) for name in row.values)
    rows, columns = grid(row, pins)
    cell = min(width / columns, (height - 22 * scale) / rows)
    x0, y0 = left, bottom + 20 * scale
    paint.rectangle(
        x0 - 2 * scale, y0 - 2 * scale, columns * cell + 4 * scale, rows * cell + 4 * scale, (*paint.FAINT[:3], 0.10)
    )
    for pin, force in enumerate(forces.tolist()):
        r, c = divmod(pin, columns)
        share = min(max(force / high, 0.0), 1.0)
        centre = np.array([x0 + (c + 0.5) * cell, y0 + (r + 0.5) * cell])
        if share > 1e-3:
            paint.disc(centre, 0.48 * cell * np.sqrt(share) + 0.5, heat(share))
    total, full = float(forces.sum()), int((forces >= 0.999 * high).sum())
    words = f"{total:.2f} N in all, {int((forces > 1e-3 * high).sum())} pins, {full} at {high:g} N"
    paint.text(words, left, bottom + 2 * scale, paint.INK, scale)


def grid(row: Row, pins: Pins | None) -> tuple[int, int]:
    """Return rows and columns of a device; one line if its preset is unknown."""
    if pins is not None and pins.rows * pins.columns == len(row.values):
        return pins.rows, pins.columns
    return 1, max(len(row.values), 1)

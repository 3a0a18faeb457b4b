"""The card of a platform: motors as gauges over their range, cable tensions."""

from __future__ import annotations

import numpy as np

from ..preview.rows import Row
from ..quantities import quantity
from . import paint, platform_twin

LINE = 17


def lines_of(row: Row) -> list[tuple[str, float, str]]:
    """Return the name, share of the range, and value as text, for each motor."""
    out = []
    for name, value in row.values.items():
        low, high = row.low.get(name), row.high.get(name)
        share = (value - low) / (high - low) if low is not None and high is not None and high > low else 0.0
        out.append((name.replace("_", " "), float(np.clip(share, 0.0, 1.0)), quantity(value, row.units[name])))
    return out


def height(row: Row) -> float:
    """Return the height of a row's card [px at scale 1]."""
    return LINE * (len(row.values) + 2.6)


def card(row: Row, state: platform_twin.State | None, left: float, bottom: float, width: float, scale: float) -> None:
    """Draw the motors as gauges over their range, and the cables' tensions [px]."""
    line = LINE * scale
    y = bottom + (len(row.values) + 0.2) * line
    bar = 0.38 * width
    for name, share, words in lines_of(row):
        paint.text(name, left, y, paint.FAINT, scale)
        x = left + 0.27 * width
        paint.rectangle(x, y, bar, 8 * scale, (*paint.FAINT[:3], 0.14))
        paint.rectangle(x, y, max(bar * share, 1.0), 8 * scale, paint.ORANGE if share in (0.0, 1.0) else paint.BLUE)
        paint.text(words, x + bar + 6 * scale, y, paint.INK, scale)
        y -= line
    if row.contact is not None and row.contact < 0.5:
        paint.text("in the air: at rest", left, y, paint.FAINT, scale)
    elif "mismatch" in row.signals:
        paint.text(f"mismatch {100 * row.signals['mismatch']:.0f} %", left, y, paint.INK, scale)
    elif state is not None and state.tension is not None:
        paint.text("tension " + ", ".join(f"{t:.2f}" for t in state.tension.tolist()) + " N", left, y, paint.INK, scale)

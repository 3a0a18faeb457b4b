"""What plots share: their measures and colours, round numbers for axes, and fewer points for long curves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WIDTH, LEFT, RIGHT = 920.0, 76.0, 24.0  # [points]
INK, FAINT, GRID, PAPER, FRAME = "#20262e", "#6b7480", "#e4e7eb", "#ffffff", "#b9c0c8"
LIMIT, TOUCH = "#c8503c", "#fdebc8"


def ticks(low: float, high: float, most: int) -> list[float]:
    """Return round values (1, 2 or 5 times a power of ten apart) from low to high, at most `most` + 1 of them."""
    raw = (high - low) / most
    power = 10.0 ** np.floor(np.log10(raw))
    step = next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= raw * (1 - 1e-9))
    count = np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1)
    return [float(f"{v:.12g}") + 0.0 for v in (count * step).tolist()]


def thinned(x: Array, y: Array, most: int) -> tuple[Array, Array]:
    """Return at most about `most` points that look like all: each step's first, least, greatest and last."""
    if len(x) <= most:
        return x, y
    starts = np.unique(np.linspace(0, len(x), most // 4 + 1).astype(int)[:-1])
    ends = np.r_[starts[1:], len(x)]
    keep = {0, len(x) - 1}
    for a, b in zip(starts.tolist(), ends.tolist(), strict=True):
        keep |= {a, a + int(np.argmin(y[a:b])), a + int(np.argmax(y[a:b])), b - 1}
    rows = np.array(sorted(keep))
    return x[rows], y[rows]

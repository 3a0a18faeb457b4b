"""How much a touch differs from one repetition to the next: a device need not render less than that."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..interpolate import interpolate

SHORT = 0.5  # of the longest: a shorter touch is no repetition, but noise or a slip
ALIKE = 1.25  # longest over shortest: beyond, they are different touches


def scatter(readings: Array, touching: NDArray[np.bool_]) -> tuple[int, float]:
    """Return how often a touch is repeated, and how far its repetitions are from their mean [counts].

    Repetitions are stretches of contact between rests. They are brought to one length, and compared moment by moment.

    Args:
        readings: readings of the touch, shape (n, channels).
        touching: whether they differ from rest, shape (n,).

    Returns:
        Count, and root mean square over time of the norm of the difference from the mean, for a sample of so many; (1,
        nan) where there are not two alike.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], touching, [False]]).astype(np.int8)))
    runs = edges.reshape(-1, 2)
    lengths = runs[:, 1] - runs[:, 0]
    runs = runs[lengths >= max(SHORT * lengths.max(initial=0), 2)]
    lengths = runs[:, 1] - runs[:, 0]
    if len(runs) < 2 or lengths.max() > ALIKE * lengths.min():
        return 1, float("nan")
    share = np.linspace(0.0, 1.0, int(lengths.min()))
    each = [interpolate(np.linspace(0.0, 1.0, b - a), readings[a:b].astype(float), share) for a, b in runs.tolist()]
    spread = np.var(each, axis=0, ddof=1).sum(axis=1)
    return len(runs), float(np.sqrt(spread.mean()))

"""Mixing of steps towards a balance: what an old tangent does not know of, they learn on the way (Anderson 1965)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import Array

_FAINTEST = 1e-8  # of the largest change of a step


def mixed(x: Array, way: Array, learned: Sequence[tuple[Array, Array]]) -> Array:
    """Return where a step leads that is mixed with those before so that together they leave least.

    Args:
        x: where it begins, shape (n,). way: that the tangent says x is off by, shape (n,).
        learned: of steps before, how far x went and by how much the way changed for it, shapes (n,).
    """
    x = x - way
    if learned:
        ways, gains = (np.array(rows).T for rows in zip(*learned, strict=True))
        x = x - (ways - gains) @ np.linalg.lstsq(gains, way, rcond=_FAINTEST)[0]
    return x

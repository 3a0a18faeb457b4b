"""Jets: what forces that grow with t move, as a power series in t.

f = t f1 is held by u = u0 + t u1 + t^2 u2 + ...; each coefficient is one linear solve, with the forces that the lower
ones leave over on the right.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import Array
from ..skin.assembly import degrees
from .neo_hookean import NeoHookean

Solve = Callable[[Array], Array]  # takes forces on free degrees, (d, b), to their displacement at the tangent


def jets(tissue: NeoHookean, solve: Solve, first: Array, order: int, base: Array | None = None) -> Array:
    """Return the series of the displacement [m] for forces that grow from a state at rest or pressed.

    Args:
        solve: with the tangent at `base`, free degrees only. first: u1, shape (b, n, 3).
        order: the highest power. base: u0, shape (n, 3); at rest where None.

    Returns:
        shape (order + 1, b, n, 3), u0 included.
    """
    out = np.zeros((order + 1, *first.shape))
    if base is not None:
        out[0] = base
    out[1] = first
    free = degrees(tissue.mesh.free)
    for n in range(2, order + 1):
        left = tissue.forces(tissue.response(out[: n + 1]).piola[n])
        moved = solve(-left.reshape(len(first), -1)[:, free].T)
        out[n].reshape(len(first), -1)[:, free] = moved.T
    return out

"""The touch on a skin between two samples, in a straight line."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..skin.point_forces import PointForces
from .skin_contact import SkinStep


def between(a: SkinStep, b: SkinStep, share: float) -> SkinStep:
    """Return the touch between two samples, at a share of the way from the first to the second."""

    def mixed(one: float, other: float) -> float:
        return (1.0 - share) * one + share * other

    nearer = a if share < 0.5 else b
    return SkinStep(
        (1.0 - share) * a.force + share * b.force,
        mixed(a.normal_force, b.normal_force),
        mixed(a.tangential_force, b.tangential_force),
        mixed(a.depth, b.depth),
        mixed(a.lift, b.lift),
        nearer.sticking,
        nearer.slipping,
        "between",
        a.converged and b.converged,
        _points(a.points, b.points, share),
        _amounts(a.amounts, b.amounts, share),
        mixed(a.slide, b.slide),
    )


def _points(a: PointForces | None, b: PointForces | None, share: float) -> PointForces | None:
    """Return the forces of both, by their shares, on the cells of either."""
    if a is None and b is None:
        return None
    parts = [(p, s) for p, s in ((a, 1.0 - share), (b, share)) if p is not None]
    cells, places = np.unique(np.concatenate([p.cells for p, _ in parts]), return_inverse=True)
    force, at = np.zeros((len(cells), 3)), 0
    for p, s in parts:
        force[places.reshape(-1)[at : at + len(p.cells)]] += s * p.force  # no cell is there twice
        at += len(p.cells)
    amounts = _amounts(None if a is None else a.amounts, None if b is None else b.amounts, share)
    return PointForces(parts[0][0].surface, cells, force, amounts)


def _amounts(a: Array | None, b: Array | None, share: float) -> Array | None:
    """Return the amounts of tissue that stiffens; skin without touch has none."""
    if a is None:
        return None if b is None else np.asarray(share * b)
    return np.asarray((1.0 - share) * a + (0.0 if b is None else share * b))

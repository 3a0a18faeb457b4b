"""Where straight ways first enter a surface: what nearness cannot tell of things that are thinner than a step."""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Indices
from .nearest import PAIRS_AT_ONCE
from .triangles import TriangleTable

# Ways that pass beside a triangle by less than this share of its size meet it: none slips through between two.
OVERLAP = 1e-9


def first_crossing(table: TriangleTable, start: Array, end: Array, side: int = 1) -> tuple[Indices, Array]:
    """Return the first triangle that each way enters through its front, and where.

    Args:
        start, end: of the ways [m], shape (n, 3) each.
        side: 1 where the front is on the side of the normals, -1 where it is behind them.

    Returns:
        The triangle, -1 where a way enters none, shape (n,); how far along the way it is met, 0 to 1, shape (n,).

    Source: Moeller and Trumbore 1997.
    """
    triangle, share = np.full(len(start), -1), np.ones(len(start))
    low, high = np.minimum(start, end), np.maximum(start, end)
    kept = table.usable
    for axis in range(3):
        centre, radius = table.bounds[axis], table.bounds[6]
        kept = kept & (centre + radius >= low[:, axis].min()) & (centre - radius <= high[:, axis].max())
    chosen = np.flatnonzero(kept)
    if chosen.size == 0:
        return triangle, share
    a, ab, ac = (table.rows[k : k + 3, chosen] for k in (0, 3, 6))
    normal = np.cross(ab, ac, axis=0)
    size = max(1, PAIRS_AT_ONCE // chosen.size)
    for first in range(0, len(start), size):
        part = slice(first, first + size)
        origin, way = start[part], end[part] - start[part]
        along = way @ normal  # below zero where it enters, by the normals
        offset = origin[:, :, None] - a
        with np.errstate(divide="ignore", invalid="ignore"):
            t = -np.einsum("nit,it->nt", offset, normal) / along
            across = np.cross(offset, way[:, :, None], axis=1)
            u = -np.einsum("nit,it->nt", across, ac) / along
            w = np.einsum("nit,it->nt", across, ab) / along
            met = (side * along < 0.0) & (t >= 0.0) & (t <= 1.0)
            met &= (u >= -OVERLAP) & (w >= -OVERLAP) & (u + w <= 1.0 + OVERLAP)
        t = np.where(met, t, np.inf)
        best = t.argmin(axis=1)
        earliest = t[np.arange(len(t)), best]
        hits = np.isfinite(earliest)
        triangle[part] = np.where(hits, chosen[best], -1)
        share[part] = np.where(hits, earliest, 1.0)
    return triangle, share

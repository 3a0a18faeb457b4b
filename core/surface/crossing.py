"""Where straight ways first enter a surface. Nearness cannot tell this of objects thinner than a step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from .triangles import TriangleTable

# Ways that pass beside a triangle by less than this share of its size meet it: none slips through between two.
OVERLAP = 1e-9
# So many pairs of a way and a triangle are looked at at once.
PAIRS_AT_ONCE = 1_500_000
# A margin about triangles' balls, relative to their size and in all [m]: triangles nearer to a way are looked at.
NEAR = 1e-6


def first_crossing(table: TriangleTable, start: Array, end: Array, side: int = 1) -> tuple[Indices, Array]:
    """Return the first triangle that each way enters through its front, and where.

    Args:
        start, end: first and last point of each way [m], shape (n, 3) each.
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
    middle, radius = table.bounds[0:3, chosen], table.bounds[6, chosen] * (1.0 + NEAR) + NEAR
    front = side * table.bounds[3:6, chosen]
    size = max(1, PAIRS_AT_ONCE // chosen.size)
    for first in range(0, len(start), size):
        part = slice(first, first + size)
        owner, near = _close(start[part], end[part] - start[part], middle, radius, front)
        if owner.size == 0:
            continue
        own = first + owner
        origin, way = start[own].T, (end[own] - start[own]).T
        a, ab, ac = (table.rows[k : k + 3].take(chosen[near], axis=1) for k in (0, 3, 6))
        offset = origin - a
        normal, across = _cross(ab, ac), _cross(offset, way)
        along = _dot(way, normal)  # below zero where it enters, by the normals
        with np.errstate(divide="ignore", invalid="ignore"):
            t, u, w = -_dot(offset, normal) / along, -_dot(across, ac) / along, _dot(across, ab) / along
            met = (side * along < 0.0) & (t >= 0.0) & (t <= 1.0)
            met &= (u >= -OVERLAP) & (w >= -OVERLAP) & (u + w <= 1.0 + OVERLAP)
        hits = np.flatnonzero(met)
        order = hits[np.lexsort((near[hits], t[hits], own[hits]))]
        which, earliest = np.unique(own[order], return_index=True)
        triangle[which], share[which] = chosen[near[order[earliest]]], t[order[earliest]]
    return triangle, share


def _close(start: Array, way: Array, middle: Array, radius: Array, front: Array) -> tuple[Indices, Indices]:
    """Return the pairs of a way and a ball that come together, and whose way leads through the ball's plane, (k,) each.

    Args:
        start, way: first point and vector of each way [m], shape (n, 3).
        middle, radius: centres and radii of the balls [m], shapes (3, m) and (m,).
        front: unit normals of the planes through their middles, towards where ways come from, shape (3, m).
    """
    far = np.sqrt(np.einsum("ni,ni->n", way, way))
    line = way / np.maximum(far, 1e-300)[:, None]
    origin = start.mean(axis=0)  # nearby, so that nothing cancels
    start, middle = start - origin, middle - origin[:, None]
    along = line @ middle - np.einsum("ni,ni->n", line, start)[:, None]
    square = np.einsum("in,in->n", middle, middle) - 2.0 * (start @ middle)
    square += np.einsum("ni,ni->n", start, start)[:, None] - along * along
    close = (square <= radius * radius) & (along >= -radius) & (along <= far[:, None] + radius)
    above = start @ front - np.einsum("in,in->n", middle, front)
    close &= (above >= -NEAR) & (above + way @ front <= NEAR)
    return close.nonzero()


def _cross(a: Array, b: Array) -> Array:
    """Return the cross products of columns, shape (3, n)."""
    out = np.empty_like(a)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.subtract(a[j] * b[k], a[k] * b[j], out=out[i])
    return out


def _dot(a: NDArray[np.floating], b: NDArray[np.floating]) -> Array:
    return np.einsum("in,in->n", a, b)

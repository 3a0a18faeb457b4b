"""First crossing of line segments with a surface, also for thin objects."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from .triangles import TriangleTable, column_crosses

# A line that passes a triangle at up to this share of its size crosses it, so that no line slips between two triangles.
OVERLAP = 1e-9
# Number of pairs of a line and a triangle that are tested at once.
PAIRS_AT_ONCE = 1_500_000
# Lines are divided into groups that are near each other, down to FEW lines or to this many pairs with the triangles
# that are near them all. This changes the run time only.
FEW, FEW_PAIRS = 16, 50_000
# Margin around the bounding spheres of triangles, relative to their size and absolute [m].
NEAR = 1e-6


def first_crossing(table: TriangleTable, start: Array, end: Array, side: int = 1) -> tuple[Indices, Array]:
    """Return the first triangle that each line segment crosses from its front.

    Args:
        table: triangles of the surface.
        start, end: ends of each segment [m], shape (n, 3) each.
        side: 1 if the front is on the side of the normals, -1 if it is behind them.

    Returns:
        Index of the triangle, -1 for none, shape (n,); position of the crossing along the segment, 0 to 1, shape (n,).

    Source: Moeller and Trumbore 1997
    """
    triangle, share = np.full(len(start), -1), np.ones(len(start))
    for lines, chosen in _groups(table, start, end):
        middle, radius = table.bounds[0:3, chosen], _reach(table, chosen)
        front = side * table.bounds[3:6, chosen]
        size = max(1, PAIRS_AT_ONCE // chosen.size)
        for first in range(0, len(lines), size):
            part = lines[first : first + size]
            owner, near = _close(start[part], end[part] - start[part], middle, radius, front)
            if owner.size == 0:
                continue
            own = part[owner]
            origin, way = start[own].T, (end[own] - start[own]).T
            a, ab, ac = (table.rows[k : k + 3].take(chosen[near], axis=1) for k in (0, 3, 6))
            offset = origin - a
            normal, across = column_crosses(ab, ac), column_crosses(offset, way)
            along = _dot(way, normal)  # negative if the line enters against the normal
            with np.errstate(divide="ignore", invalid="ignore"):
                t, u, w = -_dot(offset, normal) / along, -_dot(across, ac) / along, _dot(across, ab) / along
                met = (side * along < 0.0) & (t >= 0.0) & (t <= 1.0)
                met &= (u >= -OVERLAP) & (w >= -OVERLAP) & (u + w <= 1.0 + OVERLAP)
            hits = np.flatnonzero(met)
            order = hits[np.lexsort((near[hits], t[hits], own[hits]))]
            which, earliest = np.unique(own[order], return_index=True)
            triangle[which], share[which] = chosen[near[order[earliest]]], t[order[earliest]]
    return triangle, share


def _reach(table: TriangleTable, chosen: Indices) -> Array:
    """Return the radii of the triangles' bounding spheres, with a margin [m]."""
    return np.asarray(table.bounds[6, chosen] * (1.0 + NEAR) + NEAR)


def _groups(table: TriangleTable, start: Array, end: Array) -> Iterator[tuple[Indices, Indices]]:
    """Yield groups of lines, and the triangles near each group: the indices of both, in ascending order.

    Args:
        table: triangles of the surface.
        start, end: ends of each line [m], shape (n, 3) each.
    """
    low, high, twice = np.minimum(start, end), np.maximum(start, end), start + end
    left = [(np.arange(len(start)), np.flatnonzero(table.usable))] if len(start) else []
    while left:
        lines, chosen = left.pop()
        for axis in range(3):
            centre, radius = table.bounds[axis, chosen], _reach(table, chosen)
            chosen = chosen[(centre + radius >= low[lines, axis].min()) & (centre - radius <= high[lines, axis].max())]
        if not chosen.size:
            continue
        if len(lines) <= FEW or len(lines) * chosen.size <= FEW_PAIRS:
            yield lines, chosen
            continue
        axis = int(np.ptp(twice[lines], axis=0).argmax())
        order = np.argsort(twice[lines, axis], kind="stable")
        left += [(np.sort(lines[half]), chosen) for half in np.array_split(order, 2)]


def _close(start: Array, way: Array, middle: Array, radius: Array, front: Array) -> tuple[Indices, Indices]:
    """Return the pairs of a segment and a sphere that meet.

    The segment must also cross the sphere's plane from its front.

    Args:
        start, way: first point and vector of each segment [m], shape (n, 3).
        middle, radius: centres and radii of the spheres [m], shapes (3, m) and (m,).
        front: unit normals of the planes through the centres, towards the side from which segments come, shape (3, m).

    Returns:
        Indices of segment and sphere of each pair, shape (k,) each.
    """
    far = np.sqrt(np.einsum("ni,ni->n", way, way))
    line = way / np.maximum(far, 1e-300)[:, None]
    origin = start.mean(axis=0)  # a near origin avoids cancellation
    start, middle = start - origin, middle - origin[:, None]
    along = line @ middle - np.einsum("ni,ni->n", line, start)[:, None]
    square = np.einsum("in,in->n", middle, middle) - 2.0 * (start @ middle)
    square += np.einsum("ni,ni->n", start, start)[:, None] - along * along
    close = (square <= radius * radius) & (along >= -radius) & (along <= far[:, None] + radius)
    above = start @ front - np.einsum("in,in->n", middle, front)
    close &= (above >= -NEAR) & (above + way @ front <= NEAR)
    return close.nonzero()


def _dot(a: NDArray[np.floating], b: NDArray[np.floating]) -> Array:
    return np.einsum("in,in->n", a, b)

"""How far a surface stays flat about points of it: what need not be looked at again while it moves no farther."""

from __future__ import annotations

import numpy as np

from ...arrays import Array, Indices
from ...surface.gap import Surface

# Triangles whose normals differ by less than this are one plane.
LEVEL = 1e-9


def flat_reach(surface: Surface, triangle: Indices, points: Array) -> Array:
    """Return how far it is from points of triangles to where the surface may turn, at least [m], shape (n,).

    Args:
        triangle: that each point lies on, shape (n,). points: in the surface's space [m], shape (n, 3).
    """
    own, other = _distances(surface, triangle, points), surface.topology.across[triangle]
    normals = surface.table.bounds[3:6]
    across = np.einsum("kn,kne->ne", normals.take(triangle, axis=1), normals.take(other, axis=1))
    flat = (other >= 0) & (across > 1.0 - LEVEL)
    reach = np.where(flat, np.inf, own).min(axis=1)
    point, edge = flat.nonzero()
    if len(point):
        next_ = other[point, edge]
        beyond = _distances(surface, next_, points[point])
        beyond[surface.topology.across[next_] == triangle[point, None]] = np.inf
        np.minimum.at(reach, point, beyond.min(axis=1))
    return reach


def _distances(surface: Surface, triangle: Indices, points: Array) -> Array:
    """Return the distances from points to the lines of a triangle's edges [m], shape (n, 3)."""
    rows = surface.table.rows[:9].take(triangle, axis=1)
    a, ab, ac = rows[0:3].T, rows[3:6].T, rows[6:9].T
    start = np.stack([a, a + ab, a + ac], axis=1)
    way = np.stack([ab, ac - ab, -ac], axis=1)
    to = points[:, None] - start
    square = np.einsum("nek,nek->ne", way, way)
    along = np.einsum("nek,nek->ne", to, way)
    apart = np.einsum("nek,nek->ne", to, to) - along * along / np.maximum(square, 1e-300)
    distance: Array = np.sqrt(np.maximum(apart, 0.0))
    return distance

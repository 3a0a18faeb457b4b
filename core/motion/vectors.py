"""Operations on many 3-vectors at once, component by component.

NumPy's inner loop over an axis of length 3 costs more than the sums in it. These functions return arrays of shape
(n, 3) whose components are contiguous in memory (Fortran order). Later operations on these arrays also loop over n.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array


def dot(a: Array, b: Array) -> Array:
    """Return the dot products of rows, shape (n,)."""
    first, *others = (a * b).T
    total: Array = first.copy()
    for part in others:
        total += part
    return total


def scaled(vectors: Array, factor: float | Array) -> Array:
    """Return each row times a factor, shape (n, k).

    Args:
        vectors: the rows, shape (n, k).
        factor: one factor for all rows, or one for each row, shape (n,).
    """
    return np.multiply(vectors.T, factor, out=np.empty(vectors.shape[::-1])).T


def cross(a: Array, b: Array) -> Array:
    """Return the cross products of rows, shape (n, 3)."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    out = np.empty((3, len(a)))
    for row, i, j, k, m in zip(out, (ay, az, ax), (bz, bx, by), (az, ax, ay), (by, bz, bx), strict=True):
        np.multiply(i, j, out=row)
        row -= k * m
    return out.T


def turn(rotation: Array, vectors: Array) -> Array:
    """Return rotation @ vector for each row, shape (n, 3).

    Args:
        rotation: shape (n, 3, 3).
        vectors: shape (n, 3).
    """
    return _product(np.swapaxes(rotation, 1, 2), vectors)


def turn_back(rotation: Array, vectors: Array) -> Array:
    """Return rotation transposed @ vector for each row, shape (n, 3).

    Args:
        rotation: shape (n, 3, 3).
        vectors: shape (n, 3).
    """
    return _product(rotation, vectors)


def turn_map_back(rotation: Array, linear: Array) -> Array:
    """Return rotation transposed @ linear map for each pair, shapes (n, 3, 3)."""
    out: Array = rotation[:, 0, :, None] * linear[:, 0, None]
    for i in (1, 2):
        out += rotation[:, i, :, None] * linear[:, i, None]
    return out


def _product(rotation: Array, vectors: Array) -> Array:
    by_row = rotation.transpose(1, 2, 0)
    out = np.multiply(by_row[0], vectors[:, 0], out=np.empty((3, len(vectors))))
    part = np.empty_like(out)
    for i in (1, 2):
        out += np.multiply(by_row[i], vectors[:, i], out=part)
    return out.T

"""Many 3-vectors at once, component by component.

numpy's inner loop over an axis of length 3 costs more than the sums in it. These return arrays of shape (n, 3) whose
components lie together in memory (Fortran order), so what follows runs along n as well.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array


def dot(a: Array, b: Array) -> Array:
    """Return the dot products of rows, shape (n,)."""
    total: Array = a[:, 0] * b[:, 0]
    for i in range(1, a.shape[1]):
        total += a[:, i] * b[:, i]
    return total


def scaled(vectors: Array, factor: Array) -> Array:
    """Return each row times its own factor, shape (n, k)."""
    out = np.empty(vectors.shape[::-1])
    for i, row in enumerate(out):
        np.multiply(vectors[:, i], factor, out=row)
    return out.T


def cross(a: Array, b: Array) -> Array:
    """Return the cross products of rows, shape (n, 3)."""
    out = np.empty((3, len(a)))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(a[:, j], b[:, k], out=out[i])
        out[i] -= a[:, k] * b[:, j]
    return out.T


def turn(rotation: Array, vectors: Array) -> Array:
    """Return rotation @ vector for each row; rotation (n, 3, 3), vectors (n, 3)."""
    return _product(np.swapaxes(rotation, 1, 2), vectors)


def turn_back(rotation: Array, vectors: Array) -> Array:
    """Return rotation transposed @ vector for each row; rotation (n, 3, 3), vectors (n, 3)."""
    return _product(rotation, vectors)


def _product(rotation: Array, vectors: Array) -> Array:
    out = np.empty((3, len(vectors)))
    for i, row in enumerate(out):
        np.multiply(rotation[:, 0, i], vectors[:, 0], out=row)
        row += rotation[:, 1, i] * vectors[:, 1]
        row += rotation[:, 2, i] * vectors[:, 2]
    return out.T

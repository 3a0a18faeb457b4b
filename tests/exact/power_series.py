"""Truncated power series of tensors: what a deformation gradient that is one in a parameter t makes of itself.

A series is an array whose first axis is the power of t; what belongs to higher powers than it has is left out. All
recursions are exact: the coefficient of t^n needs those up to n only.
"""

from __future__ import annotations

import numpy as np

from core.arrays import Array


def product(first: Array, second: Array) -> Array:
    """Return the series of the product of two series of numbers, shapes (k, ...)."""
    out = np.zeros(np.broadcast_shapes(first.shape, second.shape), np.result_type(first, second))
    for n in range(len(out)):
        for k in range(n + 1):
            out[n] += first[k] * second[n - k]
    return out


def matrix_product(first: Array, second: Array) -> Array:
    """Return the series of the product of two series of matrices, shapes (k, ..., 3, 3)."""
    out = np.zeros_like(first)
    for n in range(len(out)):
        for k in range(n + 1):
            out[n] += first[k] @ second[n - k]
    return out


def determinant(matrix: Array) -> Array:
    """Return the series of the determinant of 3x3 matrices, (k, ..., 3, 3) to (k, ...)."""
    a = np.moveaxis(matrix, (-2, -1), (0, 1))
    out = np.zeros(matrix.shape[:-2], matrix.dtype)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out += product(a[0, i], product(a[1, j], a[2, k]) - product(a[1, k], a[2, j]))
    return out


def inverse(matrix: Array) -> Array:
    """Return the series of the inverse of matrices, shape (k, ..., 3, 3)."""
    out = np.zeros_like(matrix)
    first = np.linalg.inv(matrix[0])
    out[0] = first
    for n in range(1, len(out)):
        rest = matrix[1] @ out[n - 1]
        for k in range(2, n + 1):
            rest += matrix[k] @ out[n - k]
        out[n] = -first @ rest
    return out


def logarithm(values: Array) -> Array:
    """Return the series of the natural logarithm, shape (k, ...)."""
    out = np.zeros_like(values)
    out[0] = np.log(values[0])
    for n in range(1, len(out)):
        rest = values[n].copy()
        for k in range(1, n):
            rest -= (k / n) * out[k] * values[n - k]
        out[n] = rest / values[0]
    return out


def reciprocal(values: Array) -> Array:
    """Return the series of one over the values, shape (k, ...)."""
    out = np.zeros_like(values)
    out[0] = 1.0 / values[0]
    for n in range(1, len(out)):
        rest = values[1] * out[n - 1]
        for k in range(2, n + 1):
            rest += values[k] * out[n - k]
        out[n] = -rest * out[0]
    return out

"""Compliance of a skin, as the contact solver uses it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Floats32
from ...errors import DermisError
from .cone import carrying


def refuse_indefinite(matrix: NDArray[np.float64], name: str) -> None:
    """Raise an error if a compliance matrix is not positive definite; `name` is its owner.

    Raises:
        DermisError: the matrix is not positive definite.
    """
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError as error:
        raise DermisError("the compliance is not positive definite", where=name) from error


def own_compliance(matrix: NDArray[np.floating]) -> Array:
    """Return the mean compliance of each node to its own force [m/N], shape (m,), from C, shape (3 m, 3 m)."""
    own = matrix.diagonal()  # along rows of three, NumPy's `mean` takes three times as long
    return np.asarray((own[::3] + own[1::3] + own[2::3]) / np.float32(3.0), dtype=np.float64)


def displaced(matrix: Floats32, force: Array) -> Array:
    """Return the displacement C f [m], shape (n, 3).

    Args:
        matrix: C [m/N], symmetric, in single precision, shape (3 n, 3 n).
        force: forces f on the points [N], shape (n, 3).
    """
    loaded = carrying(force).nonzero()[0]
    if len(loaded) == 0:
        return np.zeros_like(force)
    if 2 * len(loaded) > len(force):
        return (matrix @ force.reshape(-1).astype(np.float32)).reshape(-1, 3).astype(np.float64)
    # The matrix is symmetric, and rows are contiguous in memory.
    rows = matrix.reshape(len(force), 3, -1)[loaded].reshape(3 * len(loaded), -1)
    return (force[loaded].reshape(-1).astype(np.float32) @ rows).reshape(-1, 3).astype(np.float64)

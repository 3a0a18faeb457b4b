"""What the contact solver needs of a skin: its compliance, an offset that may depend on the state, and its spectrum."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...errors import DermisError


class Compliance(Protocol):
    """A skin whose displacement under force is C f plus an offset that may depend on the state."""

    @property
    def compliance(self) -> Array:
        """C [m/N], symmetric positive definite, shape (3 m, 3 m)."""
        ...

    def offset(self, force: Array) -> Array | float:
        """Return the displacement beyond C f at the last forces [N], shape (m, 3); 0 where skin is linear."""
        ...


@dataclass(frozen=True, eq=False)
class Linear:
    """Linear skin as a `Compliance`: no offset."""

    compliance: Array

    def offset(self, force: Array) -> Array | float:
        """Return zero: all displacement is C f."""
        return 0.0


def ends(matrix: NDArray[np.float64], name: str) -> tuple[float, float]:
    """Smallest and largest eigenvalue to a few per cent, by iterating with the Cholesky factor."""
    from scipy.linalg import cho_solve
    from scipy.linalg.lapack import dpotrf

    factor, info = dpotrf(matrix, lower=1)
    if info != 0:
        raise DermisError("the compliance is not positive definite", where=name)
    low: Array = np.asarray(np.random.default_rng(0).normal(size=matrix.shape[:1]), dtype=np.float64)
    high = low
    for _ in range(20):
        high = _unit(matrix @ high)
        low = _unit(cho_solve((factor, True), low, check_finite=False))
    return float(low @ matrix @ low), float(high @ matrix @ high)


def own_compliance(matrix: NDArray[np.floating]) -> Array:
    """Return the mean compliance of each node to its own force [m/N], shape (m,), of one of shape (3 m, 3 m)."""
    return np.asarray(matrix.diagonal().reshape(-1, 3).mean(axis=1), dtype=np.float64)


def _unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector)

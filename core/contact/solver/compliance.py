"""What the contact solver needs of a skin: its compliance, an offset that may depend on the state."""

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


def refuse_indefinite(matrix: NDArray[np.float64], name: str) -> None:
    """Refuse a compliance that is not positive definite.

    Raises:
        DermisError: it is not.
    """
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError as error:
        raise DermisError("the compliance is not positive definite", where=name) from error


def own_compliance(matrix: NDArray[np.floating]) -> Array:
    """Return the mean compliance of each node to its own force [m/N], shape (m,), of one of shape (3 m, 3 m)."""
    return np.asarray(matrix.diagonal().reshape(-1, 3).mean(axis=1), dtype=np.float64)

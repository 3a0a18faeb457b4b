"""Patterns: a few ways in which skin is displaced, at every point of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Floats32
from ..errors import DermisError


@dataclass(frozen=True, eq=False)
class Patterns:
    """Displacement of the skin under unit loads at E = 1 [m], smooth between the places at which it is known.

    Attributes:
        centres: places of the skin [m], shape (c, 3).
        weights: of each centre's cubic |r|^3 (r in mm), shape (c, 3, k).
    """

    centres: Array
    weights: Array

    @property
    def count(self) -> int:
        """Number of patterns k."""
        return int(self.weights.shape[2])

    @classmethod
    def through(cls, positions: Array, values: Array) -> Patterns:
        """Return patterns that have given values (c, 3, k) at places of the skin (c, 3).

        Raises:
            DermisError: places that are one and the same, so that nothing can go through all values.
        """
        positions = np.asarray(positions, np.float64)
        flat = np.asarray(values, np.float64).reshape(len(positions), -1)
        try:
            weights = np.asarray(np.linalg.solve(_kernel(positions, positions), flat), np.float64)
        except np.linalg.LinAlgError:
            weights = np.full_like(flat, np.nan)
        if not np.isfinite(weights).all():
            raise DermisError("patterns of skin need places that differ", where="patterns", value=len(positions))
        return cls(positions, weights.reshape(len(positions), 3, -1))

    def at(self, positions: Array) -> Floats32:
        """Return the patterns at points of the skin, shape (n, 3, k)."""
        kernel = _kernel(np.asarray(positions, np.float64), self.centres)  # large terms cancel
        out = kernel @ self.weights.reshape(len(self.centres), -1)
        return np.asarray(out.reshape(len(positions), 3, self.count), np.float32)


def _kernel(first: Array, second: Array) -> Array:
    squares = np.zeros((len(first), len(second)))
    for k in range(3):
        squares += (1e3 * (first[:, k, None] - second[None, :, k])) ** 2
    return np.asarray(squares * np.sqrt(squares), np.float64)

"""Patterns: a few ways in which skin is displaced, at every point of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Floats32


@dataclass(frozen=True, eq=False)
class Patterns:
    """Displacement of the skin under unit loads at E = 1 [m], smooth between the places at which it is known.

    Attributes:
        centres: places of the skin [m], shape (c, 3).
        weights: of each centre's cubic |r|^3 (r in mm), shape (c, 3, k).
    """

    centres: Array
    weights: Floats32

    @property
    def count(self) -> int:
        """Number of patterns k."""
        return int(self.weights.shape[2])

    @classmethod
    def through(cls, positions: Array, values: Array) -> Patterns:
        """Return patterns that have given values (c, 3, k) at places of the skin (c, 3)."""
        kernel = _kernel(positions, positions)
        flat = np.linalg.solve(kernel, values.reshape(len(positions), -1))
        return cls(positions, flat.reshape(values.shape).astype(np.float32))

    def at(self, positions: Array) -> Floats32:
        """Return the patterns at points of the skin, shape (n, 3, k)."""
        kernel = _kernel(np.asarray(positions, np.float64), self.centres)  # large terms cancel
        out = kernel @ self.weights.reshape(len(self.centres), -1)
        return np.asarray(out.reshape(len(positions), 3, -1), np.float32)


def _kernel(first: Array, second: Array) -> Array:
    squares = np.zeros((len(first), len(second)))
    for k in range(3):
        squares += (1e3 * (first[:, k, None] - second[None, :, k])) ** 2
    return np.asarray(squares * np.sqrt(squares), np.float64)

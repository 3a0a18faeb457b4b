"""StressChannels: a few linear channels of the stress beyond linear tissue's, with their slope in the amounts."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from .stress_series import StressSeries


class StressChannels:
    """Channels that are linear in how much there is of each field of stress.

    Args:
        series: of the tissue. weights: of its fields in each channel, shape (c, r).
    """

    def __init__(self, series: StressSeries, weights: Array) -> None:
        squares, cubes = series.squares, series.cubes
        self._weights: Array | None = weights
        if len(weights) < len(squares):  # what there are fewer of is asked
            self._weights = None
            squares = weights.astype(squares.dtype) @ squares
            cubes = np.tensordot(weights.astype(cubes.dtype), cubes, axes=1)
        k = cubes.shape[2]
        i, j = np.triu_indices(k)
        self._squares = np.zeros((len(squares), k, k), squares.dtype)
        self._squares[:, i, j] += 0.5 * squares
        self._squares[:, j, i] += 0.5 * squares
        self._cubes, self._features = cubes, series.features

    def at(self, q: Array) -> tuple[Array, Array]:
        """Return the channels at E = 1, shape (c,), and their slope by the amounts, shape (c, k)."""
        short = q.astype(self._squares.dtype)
        count, features, k = self._cubes.shape
        linear, along = (self._squares.reshape(count * k, k) @ short).reshape(count, k), self._features.along(q)
        twice = (self._cubes.reshape(count * features, k) @ short).reshape(count, features)
        once = np.asarray((along @ short) @ self._cubes)
        value, slope = (linear + once) @ short, 2.0 * (linear + twice @ along) + once
        if self._weights is None:
            return value.astype(np.float64), slope.astype(np.float64)
        return self._weights @ value, self._weights @ slope

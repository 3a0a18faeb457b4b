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
        squares, (_, features, k) = weights @ series.squares, series.cubes.shape
        i, j = np.triu_indices(k)
        self._squares = np.zeros((len(weights), k, k))
        self._squares[:, i, j] += 0.5 * squares
        self._squares[:, j, i] += 0.5 * squares
        self._cubes = (weights @ series.cubes.reshape(weights.shape[1], features * k)).reshape(-1, features, k)
        self._features = series.features

    def at(self, q: Array) -> tuple[Array, Array]:
        """Return the channels at E = 1, shape (c,), and their slope by the amounts, shape (c, k)."""
        linear, along = self._squares @ q, self._features.along(q)
        twice, once = self._cubes @ q, (along @ q) @ self._cubes
        return (linear + once) @ q, 2.0 * (linear + twice @ along) + once

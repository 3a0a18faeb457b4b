"""StressChannels: a few linear channels of the stress beyond linear tissue's, with their slope in the amounts."""

from __future__ import annotations

import itertools

import numpy as np

from ..arrays import Array
from .stress_series import StressSeries


class StressChannels:
    """Channels that are linear in how much there is of each field of stress.

    Args:
        series: of the tissue. weights: of its fields in each channel, shape (c, r).
    """

    def __init__(self, series: StressSeries, weights: Array) -> None:
        squares, cubes = weights @ series.squares, weights @ series.cubes
        k = int(np.sqrt(2 * squares.shape[1]))
        i, j = np.triu_indices(k)
        self._squares = np.zeros((len(weights), k, k))
        self._squares[:, i, j] += 0.5 * squares
        self._squares[:, j, i] += 0.5 * squares
        few = 1
        while few * (few + 1) * (few + 2) // 6 < cubes.shape[1]:
            few += 1
        a, b, c = np.array(list(itertools.combinations_with_replacement(range(few), 3))).T
        whole = np.zeros((len(weights), few, few, few))
        for x, y, z in ((a, b, c), (a, c, b), (b, a, c), (b, c, a), (c, a, b), (c, b, a)):
            whole[:, x, y, z] += cubes / 6.0
        self._pairs = np.triu_indices(few)
        twice = np.where(self._pairs[0] == self._pairs[1], 1.0, 2.0)
        kept = whole[:, :, self._pairs[0], self._pairs[1]] * twice
        self._cubes = np.ascontiguousarray(kept.reshape(-1, len(twice)), np.float32)
        self._shape = len(weights), few

    def at(self, q: Array) -> tuple[Array, Array]:
        """Return the channels at E = 1, shape (c,), and their slope by the amounts, shape (c, k)."""
        i, j = self._pairs
        linear = self._squares @ q
        value, slope = linear @ q, 2.0 * linear
        few = self._shape[1]
        scale = float(np.abs(q).max()) or 1.0  # so that single precision sees numbers near one
        head = q[:few] / scale
        once = scale**2 * (self._cubes @ (head[i] * head[j]).astype(np.float32)).reshape(self._shape).astype(np.float64)
        value = value + once @ q[:few]
        slope[:, :few] += 3.0 * once
        return value, slope

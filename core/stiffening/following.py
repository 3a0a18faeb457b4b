"""Following: how tissue follows a skin that is displaced, beyond linear tissue, a polynomial in q."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Floats32
from .features import Features
from .symmetric import polynomial


@dataclass(frozen=True, eq=False)
class Following:
    """Displacement and pressure of the second and third power at E = 1, the pad being held in the patterns.

    Both are smooth, and the law makes stress of them: where tissue is sheared far, a series of the stress itself fails.

    Attributes:
        fields: displacement x, y, z [m] and pressure at the nodes of the stress series' mesh, shape (n, 4, r + m).
        squares: how much of each field a product q_a q_b, a <= b, brings, of the first r, shape (r, k (k + 1) / 2).
        cubes: that of each feature y_j times q_a, of the first c fields, shape (c, f, k).
        features: y of q.
        learned: how much there is of the last m; None where there are none.
    """

    fields: Floats32
    squares: Floats32
    cubes: Floats32
    features: Features
    learned: Learned | None = None

    def amounts(self, q: Array) -> Array:
        """Return how much of each field there is, shape (r + m,)."""
        powers = polynomial(self.squares, self.cubes, self.features, q)
        return powers if self.learned is None else np.concatenate([powers, self.learned.amounts(q)])


@dataclass(frozen=True, eq=False)
class Learned:
    """Amounts by how much q is like states that were seen: x^2 + x^3, x = c q with each of them.

    Attributes:
        centres: c, shape (s, k). weights: of each, shape (s, m).
    """

    centres: Floats32
    weights: Floats32

    def amounts(self, q: Array) -> Array:
        """Return the amounts, shape (m,)."""
        x = self.centres.astype(np.float64) @ q
        return np.asarray((x * x * (1.0 + x)) @ self.weights)

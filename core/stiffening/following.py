"""Following: how tissue follows a skin that is displaced, beyond linear tissue, a polynomial in q."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from ..arrays import Array, Floats32
from .features import Features
from .symmetric import polynomial


class Follows(Protocol):
    """What is asked of how tissue follows, told by powers or found."""

    @property
    def fields(self) -> Floats32:
        """Displacement x, y, z [m] and pressure at the nodes of the stress series' mesh, shape (n, 4, r)."""
        ...

    def amounts(self, q: Array) -> Array:
        """Return how much of each field there is, shape (r,)."""
        ...


@dataclass(frozen=True, eq=False)
class Following:
    """Displacement and pressure of the second and third power at E = 1, the pad being held in the patterns.

    Both are smooth, and the law makes stress of them: where tissue is sheared far, a series of the stress itself fails.

    Attributes:
        fields: displacement x, y, z [m] and pressure at the nodes of the stress series' mesh, shape (n, 4, r).
        squares: how much of each field a product q_a q_b, a <= b, brings, shape (r, k (k + 1) / 2).
        cubes: that of each feature y_j times q_a, of the first c fields, shape (c, f, k).
        features: y of q.
    """

    fields: Floats32
    squares: Floats32
    cubes: Floats32
    features: Features

    def amounts(self, q: Array) -> Array:
        """Return how much of each field there is, shape (r,)."""
        return polynomial(self.squares, self.cubes, self.features, q)

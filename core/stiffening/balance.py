"""Balance: how much of each pattern skin is displaced by under forces, followed from one force to the next.

q + n(q) = z, z the work of the forces in the patterns at E = 1 and n the slope of the energy beyond linear tissue's.
Under dead loads tissue may be unstable, and then several q balance one z: what is found is next to the last.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arrays import Array
from .energy import Energy

TOLERANCE = 2e-4  # of q + n(q) - z, relative to z
STEPS = 3  # of Newton's method at one z, while tissue is stable
FLOOR = 0.1  # of the stiffness over linear tissue's: below it a step would go anywhere
RAMP = 8  # parts that a force from nowhere comes in


class Balance:
    """The displacement of skin in a few patterns.

    Args:
        energy: beyond linear tissue's.

    Attributes:
        q: how much of each pattern, shape (k,). force: n(q). left: |q + n(q) - z| over |z|, for the last z.
    """

    def __init__(self, energy: Energy) -> None:
        self.energy = energy
        self.reset()

    def reset(self) -> None:
        """Go back to rest."""
        zero = np.zeros(self.energy.count)
        self.q, self.force, self._stiffness, self.left = zero, zero, np.zeros((len(zero), len(zero))), 0.0
        self._known: tuple[bool, Array, Array] | None = None

    def save(self) -> tuple[Any, ...]:
        """Return the state, for `restore`."""
        return self.q, self.force, self._stiffness, self.left, self._known

    def restore(self, state: tuple[Any, ...]) -> None:
        """Go back to a saved state."""
        self.q, self.force, self._stiffness, self.left, self._known = state

    def follow(self, z: Array) -> Array:
        """Go towards other forces and return n, with what the next step would bring, shape (k,).

        Where tissue is unstable under dead loads it takes one short step: who holds its displacement asks again, and
        then q is where it is held after two.
        """
        size = float(np.linalg.norm(z))
        if size == 0.0:
            self.reset()
            return self.force
        for _ in range(STEPS):
            left = z - self.q - self.force
            if float(np.linalg.norm(left)) <= TOLERANCE * size:
                break
            stable, values, vectors = self._factors()
            self.q = self.q + _solved(stable, values, vectors, left)
            self.force, self._stiffness = self.energy.force_and_stiffness(self.q)
            self._known = None
            if not stable:
                break
        left = z - self.q - self.force
        self.left = float(np.linalg.norm(left)) / size
        return self.force + left - _solved(*self._factors(), left)

    def ramp(self, z: Array) -> None:
        """Go from rest to forces that nothing else is known of."""
        self.reset()
        for part in range(1, RAMP + 1):
            self.follow(z * (part / RAMP))

    def softening(self) -> Array:
        """Return M = 1 - (1 + n')^-1, by which stiffening skin gives way less than linear skin, shape (k, k)."""
        stable, values, vectors = self._factors()
        one = np.eye(len(self.q))
        return one - (_solved(stable, values, vectors, one) if stable else (vectors / values) @ vectors.T)

    def _factors(self) -> tuple[bool, Array, Array]:
        """Return whether 1 + n' is above the floor, and its Cholesky factor, or values with a floor and vectors."""
        if self._known is None:
            from scipy.linalg.lapack import dpotrf

            whole = self._stiffness.copy()
            whole[np.diag_indices(len(whole))] += 1.0 - FLOOR
            if dpotrf(whole, lower=1)[1] == 0:
                whole[np.diag_indices(len(whole))] += FLOOR
                self._known = True, whole, np.asarray(dpotrf(whole, lower=1)[0])
            else:
                values, vectors = np.linalg.eigh(self._stiffness)
                self._known = False, np.maximum(1.0 + values, FLOOR), vectors
        return self._known


def _solved(stable: bool, values: Array, vectors: Array, right: Array) -> Array:
    if stable:
        from scipy.linalg.lapack import dpotrs

        return np.asarray(dpotrs(vectors, right, lower=1)[0])
    return np.asarray(vectors @ ((vectors.T @ right) / values))

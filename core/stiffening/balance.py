"""Balance: how much of each pattern skin is displaced by under forces, followed from one force to the next.

q + n(q) = z, z the work of the forces in the patterns at E = 1 and n the slope of the energy beyond linear tissue's.
Under dead loads tissue may be unstable, and then several q balance one z: what is found is next to the last.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arrays import Array
from .energy import Energy

TOLERANCE = 1e-5  # of q + n(q) - z, relative to z
MAX_STEPS = 25
FLOOR = 0.1  # of the stiffness over linear tissue's: below it a step would go anywhere


class Balance:
    """The displacement of skin in a few patterns.

    Args:
        energy: beyond linear tissue's.

    Attributes:
        q: how much of each pattern, shape (k,). force: n(q). settled: whether the last z was balanced.
    """

    def __init__(self, energy: Energy) -> None:
        self.energy = energy
        self.reset()

    def reset(self) -> None:
        """Go back to rest."""
        zero = np.zeros(self.energy.count)
        self.q, self.force, self._stiffness, self.settled = zero, zero, np.zeros((len(zero), len(zero))), True

    def save(self) -> tuple[Any, ...]:
        """Return the state, for `restore`."""
        return self.q, self.force, self._stiffness, self.settled

    def restore(self, state: tuple[Any, ...]) -> None:
        """Go back to a saved state."""
        self.q, self.force, self._stiffness, self.settled = state

    def follow(self, z: Array) -> Array:
        """Go to other forces; return n(q), shape (k,)."""
        if not z.any():
            self.reset()
            return self.force
        goal = TOLERANCE * float(np.linalg.norm(z))
        left = z - self.q - self.force
        size = float(np.linalg.norm(left))
        for _ in range(MAX_STEPS):
            if size <= goal:
                break
            step = self._step(left)
            share = 1.0
            while True:
                q = self.q + share * step
                force, stiffness = self.energy.force_and_stiffness(q)
                left = z - q - force
                tried = float(np.linalg.norm(left))
                if tried <= (1.0 - 0.1 * share) * size or share < 1e-2:
                    break
                share *= 0.5
            self.q, self.force, self._stiffness, size = q, force, stiffness, tried
        self.settled = size <= goal
        return self.force

    def softening(self) -> Array:
        """Return M = 1 - (1 + n')^-1, by which stiffening skin gives way less than linear skin, shape (k, k)."""
        one = np.eye(len(self.q))
        factor = self._factor()
        if factor is None:
            values, vectors = self._floored()
            return one - (vectors / values) @ vectors.T
        from scipy.linalg.lapack import dpotri

        inverse = dpotri(factor, lower=1)[0]
        inverse = np.tril(inverse) + np.tril(inverse, -1).T
        return one - inverse

    def _step(self, left: Array) -> Array:
        factor = self._factor()
        if factor is None:
            values, vectors = self._floored()
            return vectors @ ((vectors.T @ left) / values)
        from scipy.linalg.lapack import dpotrs

        return np.asarray(dpotrs(factor, left, lower=1)[0])

    def _factor(self) -> Array | None:
        """Return the lower Cholesky factor of 1 + n'; None where it is not above the floor."""
        from scipy.linalg.lapack import dpotrf

        size = len(self.q)
        shifted = self._stiffness.copy()
        shifted[np.diag_indices(size)] += 1.0 - FLOOR
        if dpotrf(shifted, lower=1, overwrite_a=1)[1] != 0:
            return None
        whole = self._stiffness.copy()
        whole[np.diag_indices(size)] += 1.0
        return np.asarray(dpotrf(whole, lower=1)[0])

    def _floored(self) -> tuple[Array, Array]:
        values, vectors = np.linalg.eigh(self._stiffness)
        return np.maximum(1.0 + values, FLOOR), vectors

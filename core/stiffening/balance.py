"""The balance of skin in a few patterns under dead loads: how much of each there is.

q + n(q) = z, z the work of the forces in the patterns at E = 1 and n the slope of the energy beyond linear tissue's.
Tissue may be unstable under dead loads, and then several q balance one z: what is found lies downhill from rest.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from .energy import Energy

TOLERANCE = 1e-5  # of q + n(q) - z, relative to z
FLOOR = 0.1  # of the stiffness over linear tissue's: below it a step would go anywhere
MAX_STEPS, SHORTEST = 60, 1e-4  # the least share of a step that is tried


def balanced(energy: Energy, z: Array) -> Array:
    """Return how much there is of each pattern under forces, from their work in it, shapes (k,) to (k,)."""
    q, force, stiffness = (np.zeros(shape) for shape in (len(z), len(z), (len(z), len(z))))
    size, stored = float(np.linalg.norm(z)), 0.0  # energy less work
    for _ in range(MAX_STEPS):
        left = z - q - force
        if float(np.linalg.norm(left)) <= TOLERANCE * size:
            break
        step, share = Factors.of(stiffness).solved(left), 1.0
        while share > SHORTEST:
            there = q + share * step
            now = float(there @ (0.5 * there - z)) + energy.value(there)
            if now < stored - 1e-4 * share * float(left @ step):
                break
            share *= 0.5
        q, stored = there, now
        force, stiffness = energy.force_and_stiffness(q)
    return q


class Factors(NamedTuple):
    """1 + n', ready to be solved with; where it is below the floor, with that in its place.

    Attributes:
        stable: it is above the floor. whole: 1 + n', or its values, none below the floor. root: its lower Cholesky
            factor, or vectors, shape (k, k).
    """

    stable: bool
    whole: Array
    root: Array

    @classmethod
    def of(cls, stiffness: Array) -> Factors:
        """Return those of n', shape (k, k)."""
        from scipy.linalg.lapack import dpotrf

        whole = stiffness.copy()
        whole[np.diag_indices(len(whole))] += 1.0 - FLOOR
        if dpotrf(whole, lower=1)[1] == 0:
            whole[np.diag_indices(len(whole))] += FLOOR
            return cls(True, whole, np.asarray(dpotrf(whole, lower=1)[0]))
        values, vectors = np.linalg.eigh(stiffness)
        return cls(False, np.maximum(1.0 + values, FLOOR), vectors)

    @property
    def softening(self) -> Array:
        """M = 1 - (1 + n')^-1, shape (k, k)."""
        if self.stable:
            from scipy.linalg.lapack import dpotri

            lower = dpotri(self.root, lower=1)[0]
            out = -np.where(_above(len(lower)), lower.T, lower)
        else:
            out = -((self.root / self.whole) @ self.root.T)
        out[np.diag_indices(len(out))] += 1.0
        return out

    def solved(self, right: Array) -> Array:
        """Return (1 + n')^-1 times a vector or columns."""
        if self.stable:
            from scipy.linalg.lapack import dpotrs

            return np.asarray(dpotrs(self.root, right, lower=1)[0])
        return np.asarray(self.root @ ((self.root.T @ right) / self.whole))


@lru_cache(maxsize=8)
def _above(count: int) -> NDArray[np.bool_]:
    return np.triu(np.ones((count, count), bool), 1)


def softening(stiffness: Array) -> Array:
    """Return M = 1 - (1 + n')^-1 of a stiffness n', shape (k, k)."""
    return Factors.of(stiffness).softening

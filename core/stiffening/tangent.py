"""StiffTangent: skin that stiffens, near one state of it: there what stiffening takes is a line in the forces' work."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from .balance import softening
from .energy import Energy

# Of M: patterns on points are told to some digits only, and their compliance must stay positive definite.
STIFFEST = 0.95
# A step that multiplies what is left by more is made shorter, down to a share.
WORSE, SHORT = 3.0, 0.02


@dataclass(frozen=True, eq=False)
class StiffTangent:
    """n(z) = n + M (z - q - n) near amounts q of each pattern, with z = q + n(q) the forces' work in the patterns.

    What it says of amounts and of force adds up to z exactly, however far from q it is asked.

    Attributes:
        q: amounts, shape (k,). force: n(q), shape (k,).
        stiffness: n'(q). softening: M = 1 - (1 + n')^-1, shapes (k, k).
        bend: what it is off by, as whoever laid it measures that, over the square of how far off forces are; inf where
            nobody measured it.
    """

    q: Array
    force: Array
    stiffness: Array
    softening: Array
    bend: float = np.inf

    @classmethod
    def rest(cls, count: int) -> StiffTangent:
        """Return that of skin at rest, which is linear."""
        zero, none = np.zeros(count), np.zeros((count, count))
        return cls(zero, zero, none, none)

    @classmethod
    def at(cls, energy: Energy, q: Array) -> StiffTangent:
        """Return that of given amounts."""
        return cls.of(q, *energy.force_and_stiffness(q))

    @classmethod
    def of(cls, q: Array, force: Array, stiffness: Array) -> StiffTangent:
        """Return that of given amounts, with what an energy says there."""
        soft = softening(stiffness)
        # no value of a matrix is above the largest sum of a row: then none of M is too near to 1
        firm = 1.0 + float(np.abs(stiffness).sum(axis=1).max(initial=0.0)) < 1.0 / (1.0 - STIFFEST)
        return cls(q, force, stiffness, soft if firm else _bounded(soft))

    @property
    def offset(self) -> Array:
        """n(0) of the line, shape (k,)."""
        return self.force - self.softening @ (self.q + self.force)

    def force_at(self, z: Array) -> Array:
        """Return n for the work of other forces, shape (k,)."""
        return self.force + self.softening @ (z - self.q - self.force)

    def amounts_at(self, z: Array) -> Array:
        """Return q for the work of other forces, shape (k,)."""
        return z - self.force_at(z)

    def moved(self, energy: Energy, z: Array) -> StiffTangent:
        """Return the tangent where this one says that other forces lead: Newton's step, shorter where it is astray."""
        left, step, share = float(np.linalg.norm(z - self.q - self.force)), self.amounts_at(z) - self.q, 1.0
        while True:
            q = self.q + share * step
            force, stiffness = energy.force_and_stiffness(q)
            if share < SHORT or float(np.linalg.norm(z - q - force)) <= WORSE * left:
                return StiffTangent.of(q, force, stiffness)
            share *= 0.25


def _bounded(softening: Array) -> Array:
    """Return M with no eigenvalue above `STIFFEST`."""
    from scipy.linalg.lapack import dpotrf

    room = -softening
    room[np.diag_indices(len(room))] += STIFFEST
    if dpotrf(room, lower=1)[1] == 0:
        return softening
    values, vectors = np.linalg.eigh(softening)
    bounded: Array = (vectors * np.minimum(values, STIFFEST)) @ vectors.T
    return bounded

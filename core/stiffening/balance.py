"""Balance: how much of each pattern skin is displaced by under forces, followed from one force to the next.

q + n(q) = z, z the work of the forces in the patterns at E = 1 and n the slope of the energy beyond linear tissue's.
Under dead loads tissue may be unstable, and then several q balance one z: what is found is next to the last.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from .stored_energy import StoredEnergy

TOLERANCE = 1e-5  # of q + n(q) - z, relative to z
# A step that multiplies what is left by more, from where tissue is stable and where it is not, is made shorter, down to
# a share.
WORSE, FLOORED, SHORT = 3.0, 3.0, 0.02
STEPS = 3  # of Newton's method at one z, while tissue is stable
FLOOR = 0.1  # of the stiffness over linear tissue's: below it a step would go anywhere
MAX_STEPS, SHORTEST = 60, 1e-4  # of a force from nowhere, and the least share of a step that is tried


class Balance:
    """The displacement of skin in a few patterns.

    Args:
        energy: beyond linear tissue's.

    Attributes:
        q: how much of each pattern, shape (k,). force: n(q). left: |q + n(q) - z| over |z|, for the last z.
    """

    def __init__(self, energy: StoredEnergy) -> None:
        self.energy = energy
        self.reset()

    def reset(self) -> None:
        """Go back to rest."""
        zero = np.zeros(self.energy.count)
        self.q, self.force, self._stiffness, self.left = zero, zero, np.zeros((len(zero), len(zero))), 0.0
        self._known: Factors | None = None

    def save(self) -> tuple[Any, ...]:
        """Return the state, for `restore`."""
        return self.q, self.force, self._stiffness, self.left, self._known, self.energy.save()

    def restore(self, state: tuple[Any, ...]) -> None:
        """Go back to a saved state."""
        self.q, self.force, self._stiffness, self.left, self._known, remembered = state
        self.energy.restore(remembered)

    def follow(self, z: Array, tolerance: float = TOLERANCE, near: Array | None = None) -> Array:
        """Go towards other forces and return n, with what the next step would bring, shape (k,).

        Args:
            z: work of the forces in the patterns, shape (k,). tolerance: of the balance, relative to it.
            near: q that is expected; where tissue is stable it is taken in place of the first step.

        Where tissue is unstable under dead loads it takes one short step: who holds its displacement asks again, and
        then q is where it is held after two.
        """
        size = float(np.linalg.norm(z))
        if size == 0.0:
            self.reset()
            return self.force
        if near is not None and self.factors.stable:
            self._go(near)
        for part in range(STEPS):
            left = z - self.q - self.force
            if float(np.linalg.norm(left)) <= tolerance * size:
                break
            before, factors = self.q, self.factors
            if part > 0 and not factors.stable:
                break
            worse = WORSE if factors.stable else FLOORED
            step, share = factors.solved(left), 1.0
            self._go(before + step)
            while np.linalg.norm(z - self.q - self.force) > worse * np.linalg.norm(left) and share > SHORT:
                share *= 0.25
                self._go(before + share * step)
        left = z - self.q - self.force
        self.left = float(np.linalg.norm(left)) / size
        return self.force + left - self.factors.solved(left)

    def _go(self, q: Array) -> None:
        before = self._stiffness
        self.q = q
        self.force, self._stiffness = self.energy.force_and_stiffness(q)
        if self._stiffness is not before:
            self._known = None

    def hold(self, q: Array, z: Array) -> None:
        """Take over amounts that others found under forces whose work is z, with the stiffness there."""
        self.q, size = q, float(np.linalg.norm(z))
        self.force, self._stiffness = self.energy.force_and_stiffness(q)
        self._known = None
        self.left = float(np.linalg.norm(z - q - self.force)) / size if size > 0.0 else 0.0

    def sharpen(self) -> None:
        """Take the stiffness where it is now, in place of an older one."""
        self.force, self._stiffness = self.energy.sharpened(self.q)
        self._known = None

    def settle(self, z: Array) -> None:
        """Go from rest downhill to where forces that nothing else is known of are balanced."""
        self.reset()
        size = float(np.linalg.norm(z))
        stored = 0.0  # energy less work
        for _ in range(MAX_STEPS):
            left = z - self.q - self.force
            self.left = float(np.linalg.norm(left)) / max(size, 1e-300)
            if self.left <= TOLERANCE:
                break
            step, share = self.factors.solved(left), 1.0
            while share > SHORTEST:
                q = self.q + share * step
                now = float(q @ (0.5 * q - z)) + self.energy.value(q)
                if now < stored - 1e-4 * share * float(left @ step):
                    break
                share *= 0.5
            stored = now
            self._go(q)

    @property
    def stiffness(self) -> Array:
        """n' near q, the same array as long as it serves, shape (k, k)."""
        return self._stiffness

    @property
    def amounts(self) -> Array:
        """What a touch keeps of it."""
        return self.energy.amounts(self.q)

    def softening(self) -> Array:
        """Return M = 1 - (1 + n')^-1, by which stiffening skin gives way less than linear skin, shape (k, k)."""
        return self.factors.softening

    @property
    def factors(self) -> Factors:
        """1 + n' near q, the same as long as it serves."""
        if self._known is None:
            self._known = Factors.of(self._stiffness)
        return self._known


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
    def stiffness(self) -> Array:
        """n', shape (k, k)."""
        out = self.whole.copy() if self.stable else (self.root * self.whole) @ self.root.T
        out[np.diag_indices(len(out))] -= 1.0
        return out

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

"""StiffSkin: what stiffening adds to the compliance of the points that a contact is solved on."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...arrays import Array, Floats32, Indices
from ...skin.model import SkinModel
from ...skin.surface_compliance import SurfaceCompliance
from ...stiffening.balance import Balance
from ...stiffening.stiffening import Stiffening
from .candidates import CandidateInverse

# Of M, where a compliance must stay positive definite although patterns are told to some digits only.
STIFFEST = 0.95


CLOSE = 0.01  # of q, within which a tangent serves again


class Tangent:
    """(A - U M U' / E)^-1 as a product, from A^-1 = (C + softness + rho)^-1 (Woodbury)."""

    def __init__(self, inverse: Floats32, image: Floats32, middle: Floats32) -> None:
        self._inverse, self._image, self._middle = inverse, image, middle

    @property
    def dtype(self) -> np.dtype[np.float32]:
        """Of what it is multiplied with."""
        return np.dtype(np.float32)

    def __matmul__(self, values: Floats32) -> Floats32:
        return self._inverse @ values + self._image @ (self._middle @ (values @ self._image))


class StiffSkin:
    """Points of a skin that stiffens.

    Args:
        stiffening: of the skin. modulus: E alpha [Pa].

    Attributes:
        patterns: at the points, shape (n, 3, k). balance: of the last forces that were asked about.
    """

    def __init__(self, stiffening: Stiffening, modulus: float) -> None:
        self.stiffening, self.modulus = stiffening, modulus
        self.patterns = np.zeros((0, 3, stiffening.count), np.float32)
        self.balance = Balance(stiffening.energy)
        self._known: tuple[int, int, int, Floats32, Array] | None = None  # of A^-1 U
        self._middle: tuple[Array, Floats32] | None = None  # of the tangent, and the q that it belongs to

    @classmethod
    def of(cls, skin: SkinModel | SurfaceCompliance) -> StiffSkin | None:
        """Return what a skin does beyond its compliance; None where it is linear."""
        return None if skin.stiffening is None else cls(skin.stiffening, skin.material.modulus)

    def at(self, positions: Array) -> None:
        """Take other points of the skin [m], shape (n, 3)."""
        self.patterns = self.stiffening.patterns.at(positions)
        self._known = None

    def change(self, order: Indices, entering: Indices, pad: SurfaceCompliance) -> None:
        """Go over to other points: where each that stays was, and the cells of a pad that are new, shape (j,)."""
        new = pad.patterns(entering)
        self.patterns = np.concatenate([self.patterns[order], new])

    def reset(self) -> None:
        """Go back to rest."""
        self.balance.reset()

    def save(self) -> tuple[Any, ...]:
        """Return the state, for `restore`."""
        return self.balance.save(), self.patterns

    def restore(self, state: tuple[Any, ...]) -> None:
        """Go back to a saved state."""
        balance, self.patterns = state
        self.balance.restore(balance)
        self._known = None

    @property
    def amounts(self) -> Array:
        """How much of each pattern there is under the last forces, shape (k,)."""
        return self.balance.q

    def beyond(self, force: Array) -> Array:
        """Return by how much less than linear skin it gives way under forces [N], shapes (n, 3) to (n, 3) [m]."""
        loaded = np.flatnonzero(force.any(axis=1))
        rows = self.patterns if 2 * len(loaded) > len(force) else self.patterns[loaded]
        carried = force if len(rows) == len(force) else force[loaded]
        work = carried.reshape(-1).astype(np.float32) @ rows.reshape(carried.size, self.stiffening.count)
        beyond = self.balance.follow(work.astype(np.float64) / self.modulus)
        out = self.patterns.reshape(force.size, -1) @ beyond.astype(np.float32)
        return out.reshape(-1, 3).astype(np.float64)

    def tangent(self, candidates: CandidateInverse) -> Tangent:
        """Return the inverse for small changes from the last forces, over the members of a linear one."""
        image, gram = self._image(candidates)
        q = self.balance.q
        if self._middle is None or np.linalg.norm(q - self._middle[0]) > CLOSE * np.linalg.norm(q):
            softening = self.balance.softening() / self.modulus
            middle = np.linalg.solve(np.eye(len(gram)) - softening @ gram, softening)
            self._middle = q, middle.astype(np.float32)
        return Tangent(candidates.matrix, image, self._middle[1])

    def past_tangent(self, force: Array, rows: Indices) -> Array:
        """Return U n(q) - U M U' f / E at some points, which alone carry forces [N]: what is off a line through rest.

        Args:
            force: shape (n, 3). rows: points, shape (j,).

        Returns:
            [m], shape (j, 3).
        """
        return self.beyond(force)[rows] - (self.matrix(rows) @ force[rows].reshape(-1)).reshape(-1, 3)

    def matrix(self, rows: Indices) -> Array:
        """Return U M U' / E at some points, to be taken off their compliance [m/N], shape (3 j, 3 j)."""
        few = self.patterns[rows].reshape(3 * len(rows), -1).astype(np.float64)
        values, vectors = np.linalg.eigh(self.balance.softening())
        half = few @ vectors
        return (half * (np.minimum(values, STIFFEST) / self.modulus)) @ half.T

    def _image(self, candidates: CandidateInverse) -> tuple[Floats32, Array]:
        """Return A^-1 U over the members, and U' A^-1 U."""
        now = (id(candidates), candidates.updates, candidates.rebuilds)
        known = self._known
        if known is None or known[:3] != now:
            rows = self.patterns[candidates.members].reshape(3 * len(candidates.members), -1)
            image = candidates.matrix @ rows
            known = (*now, image, (rows.T @ image).astype(np.float64))
            self._known, self._middle = known, None
        return known[3], known[4]

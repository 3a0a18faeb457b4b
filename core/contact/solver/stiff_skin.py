"""StiffSkin: what stiffening adds to the compliance of the points that a contact is solved on."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...arrays import Array, Floats32, Indices
from ...skin.model import SkinModel
from ...skin.surface_compliance import SurfaceCompliance
from ...stiffening.balance import TOLERANCE, Balance, Factors
from ...stiffening.stiffening import Stiffening
from ...stiffening.tangent import StiffTangent
from .candidates import CandidateInverse

CLOSE = 0.01  # of q, within which a tangent serves again


class Tangent:
    """(A - U M U' / E)^-1 as a product, from A^-1 = (C + softness + rho)^-1 (Woodbury)."""

    def __init__(self, inverse: Floats32, image: Floats32, middle: _Middle) -> None:
        self._inverse, self._image, self._middle = inverse, image, middle

    @property
    def dtype(self) -> np.dtype[np.float32]:
        """Of what it is multiplied with."""
        return np.dtype(np.float32)

    def __matmul__(self, values: Floats32) -> Floats32:
        return self._inverse @ values + self._image @ self._middle.product(values @ self._image)


class _Middle(NamedTuple):
    """What a tangent has between A^-1 U and its transpose: (1 - M G)^-1 M = (1 + n' (1 - G))^-1 n', with G of it.

    The latter asks for no M, and a frame has fewer iterations than it would take to pay for the matrix.

    Attributes:
        of: which state of the candidates. q: where it was taken. stiffness: n' there as the balance gave it.
        factors: of it. right: n' / E. lower, pivots: 1 + n' (1 - G), in LU factors.
    """

    of: tuple[int, ...]
    q: Array
    stiffness: Array
    factors: Factors
    right: Floats32
    lower: Floats32
    pivots: Indices

    @classmethod
    def at(cls, of: tuple[int, ...], balance: Balance, gram: Floats32, modulus: float) -> _Middle:
        """Return that of where a balance is, with G = U' A^-1 U / E, shape (k, k)."""
        from scipy.linalg.lapack import sgetrf

        factors = balance.factors
        firm = factors.stiffness.astype(np.float32)
        whole = firm - firm @ gram
        whole[np.diag_indices(len(whole))] += 1.0
        lower, pivots, _ = sgetrf(whole)
        return cls(of, balance.q, balance.stiffness, factors, firm / np.float32(modulus), lower, pivots)

    def product(self, along: Floats32) -> Floats32:
        """Return it times a vector, shape (k,)."""
        from scipy.linalg.lapack import sgetrs

        return np.asarray(sgetrs(self.lower, self.pivots, self.right @ along)[0])

    def softened(self, change: Array) -> Array:
        """Return M times a change of the forces' work, shape (k,)."""
        return change - self.factors.solved(change)


class StiffSkin:
    """Points of a skin that stiffens.

    Args:
        stiffening: of the skin. modulus: E alpha [Pa]. patterns: at the points, where these stay, shape (n, 3, k).

    Attributes:
        patterns: at the points, shape (n, 3, k). balance: of the last forces that were asked about.
        tolerance: of the balance, relative to the forces' work.
        still: it is linear skin for now. lost: the last frame was solved so, since nothing was balanced.
    """

    def __init__(self, stiffening: Stiffening, modulus: float, patterns: Floats32 | None = None) -> None:
        self.stiffening, self.modulus = stiffening, modulus
        self.patterns = np.zeros((0, 3, stiffening.count), np.float32) if patterns is None else patterns
        self.balance, self.tolerance = Balance(stiffening.energy.followed()), TOLERANCE
        self._image: tuple[tuple[int, ...], Floats32, Floats32] | None = None  # A^-1 U and U' A^-1 U, and of what
        self._middle: _Middle | None = None
        self.reset()

    @classmethod
    def of(cls, skin: SkinModel | SurfaceCompliance) -> StiffSkin | None:
        """Return what a skin does beyond its compliance; None where it is linear."""
        if skin.stiffening is None:
            return None
        patterns = None
        if isinstance(skin, SkinModel):  # at the nodes of its pad
            patterns = skin.stiff.pad.reshape(-1, 3, skin.stiffening.count).astype(np.float32)
        return cls(skin.stiffening, skin.material.modulus, patterns)

    def change(self, order: Indices, entering: Indices, pad: SurfaceCompliance) -> None:
        """Go over to other points: where each that stays was, and the cells of a pad that are new, shape (j,)."""
        new = pad.patterns(entering)
        self.patterns = np.concatenate([self.patterns[order], new])

    def reset(self) -> None:
        """Go back to rest."""
        self.balance.reset()
        none = np.zeros(self.stiffening.count)
        self._last = self._start = none, none  # work of the last forces and n there; where the frame began
        self._bent, self._first, self._before = none, True, self.balance.save()
        self.still = self.lost = False

    def save(self) -> tuple[Any, ...]:
        """Return the state, for `restore`."""
        return self.balance.save(), self.patterns, self._middle, self._last, self._bent, self.lost

    def restore(self, state: tuple[Any, ...]) -> None:
        """Go back to a saved state."""
        balance, self.patterns, self._middle, self._last, self._bent, self.lost = state
        self.balance.restore(balance)
        self._image = None

    @property
    def amounts(self) -> Array:
        """How much there is of each pattern under the last forces, and of what is beneath where that is kept."""
        return self.balance.amounts

    def beyond(self, force: Array) -> Array:
        """Return by how much less than linear skin it gives way under forces [N], shapes (n, 3) to (n, 3) [m]."""
        if self.still:
            return np.zeros((len(self.patterns), 3))
        z, near = self._work(force), None
        if self._first and self._middle is not None:  # on the frame's first line, bent as in the last frame
            z0, n0 = self._start
            near = z - n0 - self._middle.softened(z - z0) - self._bent
        beyond = self.balance.follow(z, self.tolerance, near)
        self._last = z, beyond
        return self._moved(beyond)

    def _work(self, force: Array) -> Array:
        """Return the work of forces in the patterns at E = 1, shape (k,)."""
        loaded = np.flatnonzero(force.any(axis=1))
        rows = self.patterns if 2 * len(loaded) > len(force) else self.patterns[loaded]
        carried = force if len(rows) == len(force) else force[loaded]
        work = carried.reshape(-1).astype(np.float32) @ rows.reshape(carried.size, self.stiffening.count)
        return work.astype(np.float64) / self.modulus

    def begin(self) -> Array:
        """Begin a frame: return how far its first line will miss what skin does, as in the last frame, (n, 3) [m]."""
        self._start, self._first, self._before = self._last, True, self.balance.save()
        return self._moved(self._bent)

    def go_back(self) -> None:
        """Go back to where the frame began."""
        self.balance.restore(self._before)
        self._last, self._first = self._start, False

    def rest(self) -> None:
        """Be linear skin while `still`: nothing was balanced."""
        self.reset()
        self.still = self.lost = True

    def learn(self) -> None:
        """Note by how much the frame's first line missed what skin does under the forces that it led to."""
        if self._first and self._middle is not None:
            (z, n), (z0, n0) = self._last, self._start
            self._bent = n - n0 - self._middle.softened(z - z0)
        self._first = False

    def _moved(self, beyond: Array) -> Array:
        out = self._flat() @ beyond.astype(np.float32)
        return out.reshape(-1, 3).astype(np.float64)

    def tangent(self, candidates: CandidateInverse) -> Tangent:
        """Return the inverse for small changes from the last forces, over the members of a linear one."""
        now = (id(candidates), candidates.updates, candidates.rebuilds)
        if self._image is None or self._image[0] != now:
            rows = self._flat(candidates.members)
            image = candidates.matrix @ rows
            gram = np.asarray((rows.T @ image) / np.float32(self.modulus), np.float32)
            self._image = now, image, gram
        _, image, gram = self._image
        q, known = self.balance.q, self._middle
        same = known is not None and (
            known.stiffness is self.balance.stiffness or np.linalg.norm(q - known.q) <= CLOSE * np.linalg.norm(q)
        )
        if known is None or known.of != now[1:] or not same:
            self._middle = known = _Middle.at(now[1:], self.balance, gram, self.modulus)
        return Tangent(candidates.matrix, image, known)

    def line(self) -> StiffTangent:
        """Return the line through the tissue's law where it is now."""
        self.balance.sharpen()
        return StiffTangent.of(self.balance.q, self.balance.force, self.balance.stiffness)

    def along(self, line: StiffTangent, force: Array) -> Array:
        """Go where a line leads under forces [N], and return what `beyond` does there, (n, 3) to (n, 3) [m].

        Skin under a load may be unstable that is held by what it lies on: there no balance of the load is sought.
        """
        z = self._work(force)
        new = line.moved(self.balance.energy, z)
        self.balance.hold(new.q, z)
        self._last = z, new.force_at(z)
        return self._moved(self._last[1])

    def offset(self, line: StiffTangent, rows: Indices) -> Array:
        """Return by how much less than on a line through rest some points give way [m], shape (j, 3)."""
        return np.asarray(self._flat(rows).astype(np.float64) @ line.offset).reshape(-1, 3)

    def matrix(self, line: StiffTangent, rows: Indices) -> Array:
        """Return U M U' / E at some points, to be taken off their compliance [m/N], shape (3 j, 3 j)."""
        few = self._flat(rows).astype(np.float64)
        return few @ (line.softening / self.modulus) @ few.T

    def _flat(self, points: Indices | None = None) -> Floats32:
        """Return the patterns at some points, at all where None, shape (3 j, k)."""
        rows = self.patterns if points is None else self.patterns[points]
        return rows.reshape(3 * len(rows), self.stiffening.count)

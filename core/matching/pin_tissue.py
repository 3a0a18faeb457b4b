"""PinTissue: what skin that stiffens changes in the matching of displacements.

Such skin moves by C (f - E F n): as linear skin does under other forces, those of the touch less what its tissue takes
(F: the patterns' loads). Displacements of two touches are as far apart as these forces say by the linear matrices; only
how they change with the pins' forces x is the tissue's, C A (x) becoming C (A - E F M B) x on its tangent, B x being
the pins' work in the patterns. Steps of Gauss and Newton end where the law holds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array
from ..skin.stiff_tables import StiffTables
from ..stiffening.tangent import StiffTangent

ROUNDS = 12
SETTLED = 1e-7  # of the displacement: what the tissue may be off its tangent


@dataclass(frozen=True, eq=False)
class PinTissue:
    """The tissue of one skin under pins.

    Attributes:
        stiff: tables of the skin. modulus: E alpha [Pa].
        pins: forces on the pad for unit forces of the active pins, A, shape (3 m, pins).
        target_gram: G'WG of the compared displacements, shape (3 m, 3 m).
    """

    stiff: StiffTables
    modulus: float
    pins: Array
    target_gram: Array

    @property
    def rest(self) -> StiffTangent:
        """The tangent of skin that nothing presses."""
        return StiffTangent.rest(self.stiff.stiffening.count)

    def taken_by(self, force: Array, amounts: Array | None = None) -> Array:
        """Return n(q) for forces on the pad [N], shape (3 m,), whose amounts may be known, shape (k,)."""
        if amounts is None:
            amounts = self.stiff.balanced(self.stiff.pad.T @ force / self.modulus)
        return self.stiff.stiffening.energy.force(amounts)

    def like(self, force: Array, taken: Array) -> Array:
        """Return the forces on linear skin that displace it as these do, less what the tissue takes [N], (3 m,)."""
        goal: Array = force - self._loads @ taken
        return goal

    def moved(self, tangent: StiffTangent, x: Array) -> tuple[StiffTangent, float]:
        """Return the tangent at other pin forces [N], and how far the old one was off there, relative."""
        z = self._work @ x
        new = tangent.moved(self.stiff.stiffening.energy, z)
        apart = new.force_at(z) - tangent.force_at(z)
        moved = self.pins @ x - self._loads @ new.force_at(z)
        size, off = float(moved @ self.target_gram @ moved), float(apart @ self._gram @ apart)
        return new, float(np.sqrt(max(off, 0.0) / max(size, 1e-300)))

    def taken_at(self, tangent: StiffTangent, x: Array) -> Array:
        """Return n for pin forces near a tangent, shape (k,)."""
        return tangent.force_at(self._work @ x)

    def settled(self, x: Array) -> Array:
        """Return n for pin forces that nothing else is known of, shape (k,)."""
        return self.taken_by(self.pins @ x)

    def quadratic(self, tangent: StiffTangent, goal: Array) -> tuple[Array, Array]:
        """Return H and c of min 1/2 x'Hx - c'x on a tangent, for a goal from `like` and what the target's tissue takes.

        Args:
            goal: f - E F n of the target [N], shape (3 m,).
        """
        bent = self._bent(tangent)
        pulled = bent.T @ self.target_gram
        gram = pulled @ bent
        return 0.5 * (gram + gram.T), pulled @ (goal + self._loads @ tangent.offset)

    def least_squares(self, tangent: StiffTangent, goal: Array, patterns: Array, tolerance: float) -> Array:
        """Return pin forces without bounds, of some patterns of pins (pins, p), on a tangent."""
        root = self._root
        matrix, wanted = root @ (self._bent(tangent) @ patterns), root @ (goal + self._loads @ tangent.offset)
        found: Array = patterns @ np.linalg.lstsq(matrix, wanted, rcond=tolerance)[0]
        return found

    def _bent(self, tangent: StiffTangent) -> Array:
        return self.pins - self._loads @ (tangent.softening @ self._work)

    @cached_property
    def _loads(self) -> Array:
        return self.modulus * self.stiff.loads

    @cached_property
    def _work(self) -> Array:
        return np.asarray(self.stiff.pad.T @ self.pins / self.modulus)

    @cached_property
    def _gram(self) -> Array:
        return np.asarray(self._loads.T @ self.target_gram @ self._loads)

    @cached_property
    def _root(self) -> Array:
        values, vectors = np.linalg.eigh(self.target_gram)
        return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T

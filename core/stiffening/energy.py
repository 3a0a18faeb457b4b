"""Energy: what tissue stores beyond linear tissue when its skin is displaced by a few patterns, to the fourth power.

Displacement q_a U_a of the skin, with all beneath free to follow, stores |q|^2 / 2 + Phi3(q) + Phi4(q) + ... at E = 1.
A series in displacement is worth several times one in force: skin that stiffens takes ever more force, and so its
displacement is a root of the force, which powers follow badly.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array, Floats
from .cubic import Cubic
from .damping import Damping
from .features import Features
from .power import Power


@dataclass(frozen=True, eq=False)
class Energy:
    """Phi3 and Phi4 of some patterns.

    Phi4 is told by a few features of q, squared: touches go few ways among all products of four patterns.

    About `reach`, where t = |q / reach| is 1, the series is followed no further: `Damping`.

    Attributes:
        third: of Phi3.
        features: y of Phi4 = sum s_j y_j^2. signs: s, 1 or -1, shape (r,).
        reach: amounts up to which the series is followed, shape (k,); anywhere where None.
        press: what presses bring most of, as `Damping` has it, shape (k,); where None, nothing is known of them.

    In single precision it takes half the time.
    """

    third: Cubic
    features: Features
    signs: Array
    reach: Array | None = None
    press: Array | None = None

    @classmethod
    def of_forms(cls, cubic: Array, quartic: Array, even: int | None = None) -> Energy:
        """Return the energy of whole forms.

        Args:
            cubic: T of Phi3 = sum T_abc q_a q_b q_c, symmetric, shape (k, k, k).
            quartic: Phi4 as a form of products q_a q_b, a <= b, of the first l <= k patterns, symmetric, shape (p, p).
            even: number of patterns that a mirror keeps, which come first; all where None.
        """
        count = len(cubic)
        values, vectors = np.linalg.eigh(quartic)
        kept = np.abs(values) > 1e-12 * np.abs(values).max(initial=1e-300)
        i, j = np.triu_indices(int(np.sqrt(2 * len(quartic))))
        forms = np.zeros((int(kept.sum()), count, count))
        forms[:, i, j] += 0.5 * (vectors[:, kept] * np.sqrt(np.abs(values[kept]))).T
        forms += forms.transpose(0, 2, 1)
        even = count if even is None else even
        return cls(Cubic.of(cubic, even), Features.of(forms, even, 0), np.sign(values[kept]))

    @property
    def count(self) -> int:
        """Number of patterns k."""
        return self.third.count

    @property
    def cubic(self) -> Array:
        """T of Phi3 = sum T_abc q_a q_b q_c, symmetric, shape (k, k, k)."""
        return self.third.tensor

    def far(self, q: Array) -> float:
        """Return t = |q / reach|, 0 where nothing bounds it."""
        return 0.0 if self.reach is None else float(np.linalg.norm(q / self.reach))

    def value(self, q: Array) -> float:
        """Return Phi3 + Phi4."""
        return self._powers(q).value

    def force(self, q: Array) -> Array:
        """Return the slope of Phi3 + Phi4, the force beyond linear tissue's, shape (k,)."""
        return self.force_and_stiffness(q)[0]

    def stiffness(self, q: Array) -> Array:
        """Return the slope of `force`, symmetric, shape (k, k)."""
        return self.force_and_stiffness(q)[1]

    def force_and_stiffness(self, q: Array) -> tuple[Array, Array]:
        """Return `force` and `stiffness`, for the price of one, and for none where q is that of the last time."""
        known = self._last.get("")
        if known is not None and np.array_equal(known[0], q):
            return known[1], known[2]
        _, force, stiffness = self._powers(q)
        self._last[""] = q.copy(), force, stiffness  # what is shown asks again for what contact was solved with
        return force, stiffness

    @cached_property
    def _last(self) -> dict[str, tuple[Array, Array, Array]]:
        return {}

    def _powers(self, q: Array) -> Power:
        """Return the sum of both powers."""
        along = self.features.along(q)
        much = along @ q.astype(along.dtype)
        weights = self.signs.astype(along.dtype) * much
        bend = along.T @ (self._twice * along)
        bend += self.features.summed(4.0 * weights)
        fourth = Power(float(weights @ much), 4.0 * (weights @ along).astype(np.float64), bend)
        third = Power.of(3, q, self.third.along(q))
        return third.plus(fourth) if self.damping is None else self.damping.ended(q, third, fourth)

    @cached_property
    def _twice(self) -> Floats:
        return (8.0 * self.signs[:, None]).astype(self.features.first.dtype)

    @cached_property
    def damping(self) -> Damping | None:
        """How the powers end; None where nothing bounds them."""
        if self.reach is None:
            return None
        return Damping(self.reach, np.zeros_like(self.reach) if self.press is None else self.press)

"""Stiffening: all that skin of one shape and Poisson's ratio does beyond linear skin.

Forces f [N] on skin of modulus E displace it by u = C f - U n(q), where q + n(q) = U' f / E: U holds a few patterns of
displacement, n is the force that stiffening takes in them. E only scales; the mesh that skin is solved on, or points of
the smooth skin, ask for the patterns where they need them.
"""

from __future__ import annotations

from dataclasses import dataclass

from .energy import Energy
from .patterns import Patterns
from .stress_series import StressSeries

VERSION = 1


@dataclass(frozen=True, eq=False)
class Stiffening:
    """What a skin's tissue adds to its linearisation at rest, at E = 1.

    Attributes:
        energy: beyond linear tissue's. patterns: of displacement. stress: beyond linear tissue's.
        key: of the shape and Poisson's ratio that it was made for.
    """

    energy: Energy
    patterns: Patterns
    stress: StressSeries
    key: str = ""

    @property
    def count(self) -> int:
        """Number of patterns k."""
        return self.energy.count

"""Elastic: linear isotropic material of the pulp."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..parameters.skin import TISSUE


@dataclass(frozen=True)
class Elastic:
    """Linear isotropic material.

    `parameters/skin.py` has the ranges and the sources of its values.

    Attributes:
        young: Young's modulus E [Pa].
        poisson: Poisson's ratio.
        alpha: personal stiffness factor, by which E is multiplied.

    Raises:
        DermisError: a value is out of range.
    """

    young: float = TISSUE["young"].default
    poisson: float = TISSUE["poisson"].default
    alpha: float = TISSUE["alpha"].default

    def __post_init__(self) -> None:
        for name, row in TISSUE.items():
            row.check(getattr(self, name), "skin material")

    @property
    def modulus(self) -> float:
        """Young's modulus of this person's skin, alpha E [Pa]."""
        return self.young * self.alpha

    @property
    def lame(self) -> tuple[float, float]:
        """Lame's first parameter and the shear modulus [Pa]."""
        return lame(self.modulus, self.poisson)

    @property
    def unit(self) -> Elastic:
        """The same material with a modulus of 1 Pa.

        Costly computations are done for this material, and their results are scaled to any modulus.
        """
        return replace(self, young=1.0, alpha=1.0)


def lame(young: float, poisson: float) -> tuple[float, float]:
    """Return Lame's first parameter and the shear modulus.

    Both have the unit of `young`.
    """
    first = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    return first, young / (2.0 * (1.0 + poisson))

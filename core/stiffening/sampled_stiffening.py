"""SampledStiffening: a skin's stiffening by the exact law in a few fields, with the series of the same tissue."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Floats32
from ..parameters.error_bands import NEO_HOOKEAN_EXACT
from .sampled_tissue import SampledTissue
from .stiffening import Stiffening


@dataclass(frozen=True, eq=False)
class SampledFollowing:
    """How tissue follows a skin where what is beneath is part of the amounts: as `Following`, without powers.

    Attributes:
        count: number of patterns k.
        fields: displacement x, y, z [m] and pressure beyond linear tissue's at the nodes of the mesh, (n, 4, j + r).
    """

    count: int
    fields: Floats32

    def amounts(self, q: Array) -> Array:
        """Return how much of each field there is, shape (j + r,)."""
        return q[self.count :]


@dataclass(frozen=True, eq=False)
class SampledStiffening(Stiffening):
    """Stiffening whose amounts are those of k patterns and of what is beneath them, shape (k + j + r,).

    Devices ask for tissue hundreds of times a frame: they are matched in the series of the same tissue.

    Attributes:
        series: of the same shape and Poisson's ratio.
    """

    series: Stiffening | None = None

    @property
    def tissue(self) -> str:
        """What tissue it is of."""
        return NEO_HOOKEAN_EXACT

    @property
    def matched(self) -> Stiffening:
        """The series."""
        assert self.series is not None
        return self.series


def following_of(tissue: SampledTissue, beneath: Array, pressure: Array) -> SampledFollowing:
    """Return how tissue follows: fields of displacement (j, n, 3) [m], then fields of pressure (r, n)."""
    j, n, _ = beneath.shape
    fields = np.zeros((n, 4, j + len(pressure)), np.float32)
    fields[:, :3, :j] = beneath.transpose(1, 2, 0)
    fields[:, 3, j:] = pressure.T
    return SampledFollowing(tissue.count, fields)

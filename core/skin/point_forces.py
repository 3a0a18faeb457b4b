"""PointForces: forces on cells of the smooth pad, and the stress below."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Indices
from .surface_compliance import SurfaceCompliance


@dataclass(frozen=True, eq=False)
class PointForces:
    """Forces of a touch on points of the smooth skin.

    On a mesh, a force is spread over the elements around a node, so the stress is not valid as near to the skin as the
    Meissner and Merkel endings are. Below points of the smooth skin, the stress is known in closed form up to a smooth
    remainder.

    Attributes:
        surface: the smooth pad.
        cells: indices of the pad's cells that carry force, shape (n,). No cell is within another, except in a mixture
            of two touches.
        force: forces on these cells in the finger's frame [N], shape (n, 3).
        amounts: correction of nonlinear skin at the pad nodes [m], see `Stimulus.given`, shape (3 m,); None for linear
            skin.
    """

    surface: SurfaceCompliance
    cells: Indices
    force: Array
    amounts: Array | None = None

    def stress_below(self, positions: Array, depths: Array) -> Array:
        """Return the stress below points of the skin [Pa], shape (k, 6).

        The columns are xx, yy, zz, yz, xz, xy.

        Args:
            positions: points on or near the skin, such as the nodes of a mesh [m], shape (k, 3).
            depths: depths below the smooth skin [m], above zero, shape (k,).

        Raises:
            DermisError: a position is far from the pad.
        """
        positions, which = np.unique(positions, axis=0, return_inverse=True)
        places, _ = self.surface.chart.project(positions)
        probes = self.surface.probes(places[which.reshape(-1)], depths)
        return self.surface.beneath(probes, self.cells, self.force)[1]

"""PointForces: the forces of a touch on cells of the smooth pad, and what is felt beneath them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Indices
from .surface_compliance import SurfaceCompliance


@dataclass(frozen=True, eq=False)
class PointForces:
    """What presses on points of the smooth skin.

    A force on a mesh's node is felt as if it were spread over the elements around it, which tells nothing as near to
    the skin as Meissner's and Merkel's endings lie. Beneath points stress is known in closed form, but for a smooth
    remainder.

    Attributes:
        surface: the smooth pad. cells: of its tree, that carry force, shape (n,). None lies within another, but where
            two touches are mixed.
        force: on them in the finger's frame [N], shape (n, 3).
        amounts: how much of each pattern skin that stiffens is displaced by, shape (k,); None of linear skin.
    """

    surface: SurfaceCompliance
    cells: Indices
    force: Array
    amounts: Array | None = None

    def stress_below(self, positions: Array, depths: Array) -> Array:
        """Return the stress below some points of the skin [Pa], xx, yy, zz, yz, xz, xy, shape (k, 6).

        Args:
            positions: on the skin, or next to it as nodes of a mesh are [m], shape (k, 3).
            depths: below the smooth skin [m], above zero, shape (k,).

        Raises:
            DermisError: a position that is far from the pad.
        """
        positions, which = np.unique(positions, axis=0, return_inverse=True)
        places, _ = self.surface.chart.project(positions)
        probes = self.surface.probes(places[which.reshape(-1)], depths)
        return self.surface.beneath(probes, self.cells, self.force)[1]

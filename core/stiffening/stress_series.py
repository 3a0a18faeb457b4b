"""StressSeries: stress in stiffening tissue beyond that of the same forces on linear tissue, a polynomial in q.

It lies in the elements of a mesh: averaging it around the nodes and back would lose half of what neighbours differ by.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32
from .features import Features
from .symmetric import polynomial


@dataclass(frozen=True, eq=False)
class StressSeries:
    """Stress beyond linear tissue's at E = 1, with no load on the skin, told in the elements of a mesh.

    Attributes:
        nodes, tetrahedra: of the mesh [m], shapes (n, 3) and (e, 4).
        fields: stress of the elements, xx, yy, zz, yz, xz, xy, shape (e, 6, r).
        squares: how much of each field a product q_a q_b, a <= b, brings, shape (r, k (k + 1) / 2).
        cubes: that of each feature y_j times q_a, shape (r, f, k).
        features: y of q.
    """

    nodes: Array
    tetrahedra: NDArray[np.integer]
    fields: Floats32
    squares: Floats32
    cubes: Floats32
    features: Features

    def amounts(self, q: Array) -> Array:
        """Return how much of each field there is, shape (r,)."""
        return polynomial(self.squares, self.cubes, self.features, q)

    @cached_property
    def nodal(self) -> Floats32:
        """The fields averaged around the nodes by volume, which is what other meshes and probes read, (n, 6, r)."""
        corners = self.nodes[self.tetrahedra]
        volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])).astype(np.float32)
        sums = np.zeros((len(self.nodes), *self.fields.shape[1:]), np.float32)
        weights = np.zeros(len(self.nodes), np.float32)
        for corner in self.tetrahedra.T:
            np.add.at(sums, corner, volumes[:, None, None] * self.fields)
            np.add.at(weights, corner, volumes)
        return sums / np.maximum(weights, np.float32(1e-30))[:, None, None]

"""StressSeries: stress in stiffening tissue beyond that of the same forces on linear tissue, a polynomial in q."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32, Indices
from .symmetric import rising, side


@dataclass(frozen=True, eq=False)
class StressSeries:
    """Stress beyond linear tissue's at E = 1, with no load on the skin: smooth, told at the nodes of a mesh.

    Attributes:
        nodes, tetrahedra: of the mesh [m], shapes (n, 3) and (e, 4).
        fields: stress at the nodes, xx, yy, zz, yz, xz, xy, shape (n, 6, r).
        squares: how much of each field a product q_a q_b, a <= b, brings, shape (r, k (k + 1) / 2).
        cubes: that of q_a q_b q_c, a <= b <= c, of the first l patterns, shape (r, l (l + 1) (l + 2) / 6).
    """

    nodes: Array
    tetrahedra: NDArray[np.integer]
    fields: Floats32
    squares: Floats32
    cubes: Floats32

    def amounts(self, q: Array) -> Array:
        """Return how much of each field there is, shape (r,)."""
        i, j = np.triu_indices(len(q))
        a, b, c = self._triples
        return np.asarray(
            self.squares @ (q[i] * q[j]).astype(np.float32) + self.cubes @ (q[a] * q[b] * q[c]).astype(np.float32),
            np.float64,
        )

    @cached_property
    def _triples(self) -> tuple[Indices, Indices, Indices]:
        a, b, c = rising(side(self.cubes.shape[1], 3), 3)
        return a, b, c

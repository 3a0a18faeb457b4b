"""SecondForces: the forces of the second power that linear fields of patterns leave in tissue, pair after pair."""

from __future__ import annotations

import numpy as np

from ..arrays import Floats
from ..skin.assembly import degrees
from .neo_hookean import NeoHookean

_DIAGONAL = (0, 4, 8)


class SecondForces:
    """Forces of the second-order stress P2 of displacements that are linear in amounts of patterns.

    P2 = lambda (j1 (t 1 - H') + (j2 - 3/2 j1^2) 1) - mu (H')^2, H the gradient, t its trace, j the powers of a nodal J.

    Args:
        tissue: of the mesh. patterns: displacement of all nodes [m], shape (k, n, 3); its precision is kept.
    """

    def __init__(self, tissue: NeoHookean, patterns: Floats) -> None:
        from scipy.sparse import csr_array

        mesh, slopes, kind = tissue.mesh, tissue.geometry.gradients, patterns.dtype
        self._tissue, self._averaging = tissue, mesh.averaging.astype(kind)
        corners = np.ascontiguousarray(patterns[:, mesh.tetrahedra].transpose(1, 3, 2, 0))  # e, axis, corner, k
        turned = np.swapaxes(slopes, 1, 2).astype(kind)
        self._gradient: Floats = turned[:, None] @ corners  # last are patterns: products are of long rows
        self._trace: Floats = np.einsum("eiik->ek", self._gradient)
        self._nodal: Floats = self._averaging @ self._trace
        self._mean: Floats = self._nodal[mesh.tetrahedra].mean(axis=1)
        count, volumes = len(mesh.tetrahedra), tissue.geometry.volumes
        values = np.broadcast_to((slopes * volumes[:, None, None])[:, :, None], (count, 4, 3, 3))
        rows = np.broadcast_to(degrees(mesh.tetrahedra.ravel()).reshape(count, 4, 3, 1), values.shape)
        columns = np.broadcast_to(np.arange(9 * count).reshape(count, 1, 3, 3), values.shape)
        self._gather = csr_array(
            (values.ravel().astype(kind), (rows.ravel(), columns.ravel())), shape=(3 * len(mesh.nodes), 9 * count)
        )

    def of(self, a: int) -> Floats:
        """Return what multiplies q_a q_b in the forces of all nodes, for all b from a on, shape (3 n, b)."""
        first, shear = self._tissue.lame
        gradient, trace, nodal, mean = (x[..., a:] for x in (self._gradient, self._trace, self._nodal, self._mean))
        count, _, _, many = gradient.shape
        share = np.where(np.arange(many) == 0, 0.5, 1.0).astype(gradient.dtype)
        others = np.ascontiguousarray(gradient)
        one = others[..., 0]
        square = (one @ others.reshape(count, 3, 3 * many)).reshape(others.shape)
        square += np.swapaxes(one, 1, 2)[:, None] @ others
        square *= share
        widening = share * trace[:, :1] * trace - 0.5 * np.einsum("eiik->ek", square)
        spread = self._averaging @ widening - 3.0 * share * nodal[:, :1] * nodal
        own = first * spread[self._tissue.mesh.tetrahedra].mean(axis=1)
        own += first * share * (mean[:, :1] * trace + mean * trace[:, :1])
        square *= shear
        square += (first * share * mean[:, 0, None])[:, None, None] * others
        square += (first * share * mean)[:, None, None] * one[..., None]
        stress = -np.swapaxes(square, 1, 2).reshape(count, 9, many)
        for place in _DIAGONAL:
            stress[:, place] += own
        return np.asarray(self._gather @ stress.reshape(9 * count, many))

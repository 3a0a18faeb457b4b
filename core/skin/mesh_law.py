"""MeshLaw: the forces of neo-Hookean tissue at E = 1, node by node, in a fraction of a millisecond.

W = sum_e V_e mu/2 (I1 - 3 - 2 ln J_e) + sum_a V_a lambda/2 (ln J_a)^2, J_a the volume average of J around node a, in
single precision. It is told in the gradient H of displacement, F = 1 + H: of J - 1 = tr H + ... no large numbers
cancel, so that a light touch is as right as a deep one. `core/tissue/neo_hookean.py` has the same law in double
precision, with its tangent.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..arrays import Array, Floats, Floats32
from .assembly import geometry
from .material import lame
from .mesh import TetraMesh

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# Below it ln J goes on as its parabola: an element that a step would turn inside out is hard, and its force is finite.
FLATTEST = 0.06
_NEXT = ((1, 2), (2, 0), (0, 1))
_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))  # xx, yy, zz, yz, xz, xy


class _Strain(NamedTuple):
    """Of the elements: H and its cofactor, shape (3, 3, e), tr H, J - 1 and what the latter has beyond it, (e,)."""

    h: Floats32
    cofactor: Floats32
    trace: Floats32
    more: Floats32
    widening: Floats32


class MeshLaw:
    """The law on a mesh.

    Args:
        mesh: the tissue at rest. poisson: ratio.
    """

    def __init__(self, mesh: TetraMesh, poisson: float) -> None:
        self.mesh = mesh
        self._first, self._shear = (np.float32(value) for value in lame(1.0, poisson))

    def forces(self, displacement: Floats32) -> Floats32:
        """Return the forces that hold a displacement of the nodes [m], shapes (n, 3) to (n, 3)."""
        s = self._strain(displacement)
        _, over = _logarithm(s.widening)
        push = self._shear * over  # mu / J
        pressure = self._mean @ self._pressure(s)
        # P = mu F + (p - mu / J) cof F with cof F = (1 + tr H) 1 - H' + cof H, and mu - mu / J of what is left of J - 1
        less = pressure - push
        out = s.cofactor * less
        out -= s.h.transpose(1, 0, 2) * less
        out += s.h * self._shear
        along = pressure * (1.0 + s.trace)
        along += push * s.more
        flat = s.widening < FLATTEST - 1.0
        if flat.any():
            along[flat] = (self._shear + less * (1.0 + s.trace))[flat]
        for i in range(3):
            out[i, i] += along
        held = [self._gather @ out[i].reshape(-1) for i in range(3)]
        return np.stack(held, axis=1)

    def stress(self, displacement: Floats32) -> Array:
        """Return the Cauchy stress mu (b - 1) / J + p of the elements, xx, yy, zz, yz, xz, xy, shape (e, 6)."""
        s = self._strain(displacement)
        push = self._shear / np.maximum(1.0 + s.widening, np.float32(FLATTEST))
        pressure = self._mean @ self._pressure(s)
        out = np.empty((len(push), 6))
        for column, (i, j) in enumerate(_PAIRS):
            left = s.h[i, j] + s.h[j, i]
            for k in range(3):
                left += s.h[i, k] * s.h[j, k]
            left *= push
            out[:, column] = left + pressure if i == j else left
        return out

    def energy(self, displacement: Floats32) -> float:
        """Return the strain energy."""
        s = self._strain(displacement)
        wide = s.widening.astype(np.float64)
        log, _ = _logarithm(wide)
        square = np.einsum("ije,ije->e", s.h, s.h)
        nodal, _ = _logarithm(self.mesh_average @ s.widening)
        # I1 - 3 - 2 ln J = 2 (J - 1 - ln J) + H:H - 2 (J - 1 - tr H): each is of second order by itself
        own = float(self._shear) * ((wide - log) + (0.5 * square - s.more))
        whole = own @ self._volumes
        return float(whole + 0.5 * float(self._first) * (nodal.astype(np.float64) ** 2 @ self._nodal_volumes))

    def flattest(self, displacement: Floats32) -> float:
        """Return the least J of the elements."""
        return 1.0 + float(self._strain(displacement).widening.min())

    def _strain(self, displacement: Floats32) -> _Strain:
        h = np.empty((3, 3, len(self.mesh.tetrahedra)), np.float32)
        for i in range(3):
            h[i] = (self._slopes @ np.ascontiguousarray(displacement[:, i])).reshape(3, -1)
        cofactor, part = np.empty_like(h), np.empty_like(h[0, 0])
        for i, (a, b) in enumerate(_NEXT):
            for j, (c, d) in enumerate(_NEXT):
                np.multiply(h[a, c], h[b, d], out=cofactor[i, j])
                cofactor[i, j] -= np.multiply(h[a, d], h[b, c], out=part)
        trace = h[0, 0] + h[1, 1] + h[2, 2]
        more = cofactor[0, 0] + cofactor[1, 1] + cofactor[2, 2]
        for j in range(3):
            more += np.multiply(h[0, j], cofactor[0, j], out=part)
        return _Strain(h, cofactor, trace, more, trace + more)

    def _pressure(self, s: _Strain) -> Floats32:
        """Return lambda ln J / J of the nodes, shape (n,)."""
        log, over = _logarithm(self.mesh_average @ s.widening)
        return np.asarray(self._first * log * over, np.float32)

    @cached_property
    def mesh_average(self) -> csr_array:
        """Takes values of the elements to their volume average around each node, sparse (n, e)."""
        out: csr_array = self.mesh.averaging.astype(np.float32)
        return out

    @cached_property
    def _mean(self) -> csr_array:
        """Takes the mean of the corners of each element, sparse (e, n)."""
        from scipy.sparse import csr_array as csr

        corners = self.mesh.tetrahedra
        starts = np.arange(0, corners.size + 1, 4)
        return csr((np.full(corners.size, 0.25, np.float32), corners.ravel(), starts), (len(corners), self._count))

    @cached_property
    def _slopes(self) -> csr_array:
        """Takes values of the nodes to their slopes in x, then y, then z, in the elements [1/m], sparse (3 e, n)."""
        from scipy.sparse import csr_array as csr

        corners, slopes = self.mesh.tetrahedra, geometry(self.mesh).gradients
        starts = np.arange(0, 3 * corners.size + 1, 4)
        values = np.ascontiguousarray(slopes.transpose(2, 0, 1), np.float32).ravel()
        return csr((values, np.tile(corners.ravel(), 3), starts), (3 * len(corners), self._count))

    @cached_property
    def _gather(self) -> csr_array:
        """Sums what stress in x, then y, then z asks of the nodes, sparse (n, 3 e)."""
        from scipy.sparse import diags_array

        weights = np.tile(self.mesh.volumes, 3).astype(np.float32)
        return (diags_array(weights) @ self._slopes).T.tocsr().astype(np.float32)

    @cached_property
    def _volumes(self) -> Array:
        return self.mesh.volumes

    @cached_property
    def _nodal_volumes(self) -> Array:
        return geometry(self.mesh).nodal_volumes

    @property
    def _count(self) -> int:
        return len(self.mesh.nodes)


def _logarithm(widening: Floats) -> tuple[Floats, Floats]:
    """Return ln J and its slope of J - 1, a parabola below `FLATTEST`."""
    least = widening.dtype.type(FLATTEST)
    if float(widening.min(initial=0.0)) >= FLATTEST - 1.0:
        return np.log1p(widening), 1.0 / (1.0 + widening)
    kept = np.maximum(1.0 + widening, least)
    below = np.minimum(1.0 + widening - least, 0.0) / least
    log = np.where(below < 0.0, np.log(least) + below - 0.5 * below * below, np.log1p(np.maximum(widening, least - 1)))
    return np.asarray(log, widening.dtype), (1.0 - below) / kept

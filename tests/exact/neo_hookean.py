"""NeoHookean: tissue that stiffens, on linear tetrahedra with averaged nodal pressure.

W = sum_e V_e mu/2 (I1 - 3 - 2 ln J_e) + sum_a V_a lambda/2 (ln J_a)^2, J_a the volume average of J around node a: its
linearisation at rest is the linear skin of `assembly`, to the last bit of the law. Everything is told at E = 1: forces
over E are the only variable.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from core.arrays import Array
from core.skin.assembly import Geometry, degrees, geometry
from core.skin.material import lame
from core.skin.mesh import TetraMesh

from . import power_series as series

if TYPE_CHECKING:
    from scipy.sparse import csr_array

_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))  # components of stress: xx, yy, zz, yz, xz, xy


@dataclass(frozen=True, eq=False)
class Response:
    """Stresses of a displacement that is a power series in t; the first axis is the power.

    Attributes:
        piola: first Piola-Kirchhoff stress of each element, shape (k, b, e, 3, 3).
        pressure: lambda ln J / J of each element, the mean of its nodes', shape (k, b, e).
        nodal: the same of the nodes, shape (k, b, n).
        gradient: the deformation gradient F, shape (k, b, e, 3, 3). volume: J of each element, shape (k, b, e).
    """

    piola: Array
    pressure: Array
    nodal: Array
    gradient: Array
    volume: Array
    shear: float

    def cauchy(self) -> Array:
        """Return the Cauchy stress mu (b - I) / J + p I, xx, yy, zz, yz, xz, xy, shape (k, b, e, 6)."""
        f = self.gradient
        left = series.matrix_product(f, np.swapaxes(f, -1, -2))
        left[0] -= np.eye(3)
        over = series.reciprocal(self.volume)
        out = np.stack([self.shear * series.product(left[..., i, j], over) for i, j in _PAIRS], axis=-1)
        out[..., :3] += self.pressure[..., None]
        return out


@dataclass(frozen=True, eq=False)
class NeoHookean:
    """Neo-Hookean tissue of a mesh at E = 1.

    Attributes:
        mesh: the tissue at rest. poisson: ratio.
    """

    mesh: TetraMesh
    poisson: float

    @cached_property
    def geometry(self) -> Geometry:
        """Gradients and volumes of the mesh."""
        return geometry(self.mesh)

    @property
    def lame(self) -> tuple[float, float]:
        """Lame's first parameter and the shear modulus at E = 1."""
        return lame(1.0, self.poisson)

    def response(self, displacement: Array) -> Response:
        """Return the stresses of a displacement [m] that is a power series in t, shape (k, b, n, 3).

        Its last coefficients may be zero where they are still sought: their part in the stress is the linear one.
        """
        first, shear = self.lame
        order, many = displacement.shape[:2]
        tetra = self.mesh.tetrahedra
        f = np.einsum("kbeai,eaj->kbeij", displacement[:, :, tetra], self.geometry.gradients, optimize=True)
        f[0] += np.eye(3)
        volume = series.determinant(f)
        turned = np.swapaxes(series.inverse(f), -1, -2)
        nodal = self._average(volume.reshape(order * many, -1)).reshape(order, many, -1)
        nodal = first * series.product(series.logarithm(nodal), series.reciprocal(nodal))
        pressure = nodal[..., tetra].mean(axis=-1)
        squeeze = series.product(pressure, volume)
        squeeze[0] -= shear
        piola = series.product(squeeze[..., None, None], turned)
        piola += shear * f
        return Response(piola, pressure, nodal, f, volume, shear)

    def forces(self, piola: Array) -> Array:
        """Return the forces that hold such stresses, one for each node, (..., e, 3, 3) to (..., n, 3)."""
        shape = piola.shape[:-3]
        own = np.einsum("ceij,eaj,e->ceai", piola.reshape(-1, *piola.shape[-3:]), *self._weighed, optimize=True)
        flat = self._gather @ own.transpose(1, 2, 0, 3).reshape(4 * len(self.mesh.tetrahedra), -1)
        out: Array = flat.reshape(len(self.mesh.nodes), -1, 3).transpose(1, 0, 2)
        return np.ascontiguousarray(out).reshape(*shape, len(self.mesh.nodes), 3)

    def energy(self, displacement: Array) -> float:
        """Return the strain energy of a displacement, shape (n, 3)."""
        first, shear = self.lame
        g = self.geometry
        f = np.einsum("eai,eaj->eij", displacement[self.mesh.tetrahedra], g.gradients) + np.eye(3)
        volume = np.linalg.det(f)
        own = 0.5 * shear * (np.einsum("eij,eij->e", f, f) - 3.0 - 2.0 * np.log(volume))
        nodal = np.log(self._average(volume[None])[0])
        return float(own @ g.volumes + 0.5 * first * (nodal * nodal) @ g.nodal_volumes)

    def tangent(self, displacement: Array) -> csr_array:
        """Return the stiffness about a displacement (n, 3), sparse (3 n, 3 n)."""
        from scipy.sparse import coo_array, diags_array

        first, shear = self.lame
        g, tetra = self.geometry, self.mesh.tetrahedra
        f = np.einsum("eai,eaj->eij", displacement[tetra], g.gradients) + np.eye(3)
        volume = np.linalg.det(f)
        turned = np.swapaxes(np.linalg.inv(f), -1, -2)
        slopes = np.einsum("eij,eaj->eai", turned, g.gradients)  # of the shape functions, in the deformed tissue
        nodal = self._average(volume[None])[0]
        pressure = (first * np.log(nodal) / nodal)[tetra].mean(axis=1) * volume
        across = np.einsum("eaj,ebi->eaibj", slopes, slopes)
        blocks = (shear - pressure)[:, None, None, None, None] * across
        blocks += pressure[:, None, None, None, None] * np.einsum("eai,ebj->eaibj", slopes, slopes)
        dots = shear * np.einsum("eak,ebk->eab", g.gradients, g.gradients)
        for i in range(3):
            blocks[:, :, i, :, i] += dots
        blocks *= g.volumes[:, None, None, None, None]
        rows = degrees(tetra.ravel()).reshape(-1, 12)
        size = 3 * len(self.mesh.nodes)
        at = (np.repeat(rows, 12, axis=1).ravel(), np.tile(rows, (1, 12)).ravel())
        matrix = coo_array((blocks.reshape(-1, 144).ravel(), at), shape=(size, size)).tocsr()
        spread = (g.volumes * volume)[:, None, None, None] / 4.0 * slopes[:, None]  # e, node of average, corner, axis
        spread = np.broadcast_to(spread, (len(tetra), 4, 4, 3)) / g.nodal_volumes[tetra][:, :, None, None]
        at = (np.repeat(tetra.ravel(), 12), np.tile(rows, (1, 4)).ravel())
        widening = coo_array((spread.ravel(), at), shape=(size // 3, size)).tocsr()
        stiffer = diags_array(g.nodal_volumes * first * (1.0 - np.log(nodal)) / (nodal * nodal))
        return (matrix + widening.T.tocsr() @ (stiffer @ widening)).tocsr()

    def _average(self, values: Array) -> Array:
        """Return the volume average around each node of values of the elements, (b, e) to (b, n)."""
        return np.ascontiguousarray((self.mesh.averaging @ values.T).T)

    @cached_property
    def _weighed(self) -> tuple[Array, Array]:
        return self.geometry.gradients, self.geometry.volumes

    @cached_property
    def _gather(self) -> csr_array:
        """Sums what the corners of the elements hold at their nodes, sparse (n, 4 e)."""
        from scipy.sparse import csr_array as csr

        corners = self.mesh.tetrahedra.ravel()
        ones, starts = np.ones(len(corners)), np.arange(len(corners) + 1)
        return csr((ones, corners, starts), (len(corners), len(self.mesh.nodes))).T.tocsr()

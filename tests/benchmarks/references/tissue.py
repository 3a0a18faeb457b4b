"""Linear tissue of quadratic elements, condensed to where a shape may touch it. Lengths in mm, forces in N.

Quadratic elements alone are too stiff by some percent where Poisson's ratio is near a half, so pressures are unknowns,
too, linear between the corners (Taylor and Hood 1973): [[A, B'], [B, -W]], A of the shear modulus, W the volume over
Lame's first parameter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.sparse import block_array, coo_array, csr_array

from core.skin.assembly import degrees
from core.skin.material import Elastic
from core.tissue.dissection import Dissection, fill_upper

from .quadratic import NODES, RULE, QuadraticMesh, shape_values

Array = NDArray[np.float64]
Index = NDArray[np.integer]
MATERIAL = Elastic(young=1e5, poisson=0.48)  # [Pa]
PA = 1e-6  # [N/mm^2]
CHUNK = 4_000  # elements assembled at once
MIRRORED = np.array([1.0, 1.0, 1.0, 1.0, -1.0, -1.0])  # stress on the other side of x = 0


class Tissue:
    """A mesh, ready to be pressed on some of its nodes.

    Args:
        mesh: [mm]. touched: nodes that may carry force, rising, none of them held, shape (k,).
        half: the mesh is the half at positive x of a symmetric one, which moves symmetrically.

    Attributes:
        compliance: displacement of the touched nodes for forces on them [mm/N], shape (3 k, 3 k). Of a half, the forces
            on nodes of the cut are those on the half; nodes of the cut do not move along x.
    """

    def __init__(self, mesh: QuadraticMesh, touched: Index, half: bool = False) -> None:
        self.mesh, self.touched, self.half = mesh, touched, half
        free = degrees(np.flatnonzero(~mesh.held))
        if half:
            free = free[(free % 3 != 0) | (mesh.nodes[free // 3, 0] != 0.0)]
        self.free, self.corners = free, np.unique(mesh.elements[:, :4])
        owner = np.concatenate([free // 3, self.corners])
        negative = np.arange(len(owner)) >= len(free)
        kept = np.isin(owner, touched) & ~negative
        self.dissection = Dissection(mixed(mesh, free, self.corners), owner, negative, kept, mesh.nodes)
        factor, info = dpotrf(self.dissection.schur, lower=1, clean=0, overwrite_a=1)
        if info:
            raise ArithmeticError("the condensed stiffness is not positive definite")
        inverse, _ = dpotri(factor, lower=1, overwrite_c=1)
        fill_upper(inverse)
        own = np.isin(degrees(touched), free)
        self.compliance = inverse
        if not own.all():
            self.compliance = np.zeros((len(own), len(own)))
            self.compliance[np.ix_(own, own)] = inverse
        self._own = own
        self.dissection.schur = np.zeros((0, 0))

    def deformed(self, touched: Array) -> tuple[Array, Array, float]:
        """Return what all nodes do where the touched ones moved so.

        Returns:
            Displacement, shape (n, 3), pressure at the corners, tension positive [Pa], shape (n,), the residual [N].
        """
        found, residual = self.dissection.solve(touched.ravel()[self._own])
        moved, pressure = np.zeros(3 * len(self.mesh.nodes)), np.zeros(len(self.mesh.nodes))
        moved[self.free] = found[: len(self.free)]
        pressure[self.corners] = found[len(self.free) :] / PA
        return moved.reshape(-1, 3), pressure, residual

    def stress(self, displacement: Array, pressure: Array, points: Array) -> Array:
        """Return the stress [Pa] at points [mm]: strain averaged at the nodes by volume, shape (p, 6)."""
        other = (points[:, 0] < 0.0) & self.half
        points = np.where(other[:, None], points * [-1.0, 1.0, 1.0], points)
        element, at = self.mesh.locate(points)
        own = self.mesh.elements[element]
        wanted = np.zeros(len(self.mesh.nodes), bool)
        wanted[own] = True
        near = self.mesh.elements[wanted[self.mesh.elements].any(axis=1)]
        slope, volume = self.mesh.slopes(near, NODES[None])
        gradient = np.einsum("eax,eqay->eqxy", displacement[near], slope)
        weight = np.repeat(volume.mean(axis=1), 10)
        total, shares = np.zeros((len(wanted), 6)), np.zeros(len(wanted))
        np.add.at(total, near.ravel(), weight[:, None] * _shear_stress(gradient).reshape(-1, 6))
        np.add.at(shares, near.ravel(), weight)
        nodal = total / np.maximum(shares, 1e-300)[:, None]
        if self.half:
            nodal[self.mesh.nodes[:, 0] == 0.0, 4:] = 0.0
        found = np.einsum("pa,pac->pc", shape_values(at), nodal[own])
        found[:, :3] += np.einsum("pa,pa->p", at, pressure[own[:, :4]])[:, None]
        return np.where(other[:, None], found * MIRRORED, found)


def _shear_stress(gradient: Array) -> Array:
    """Return twice the shear modulus times strain, xx, yy, zz, yz, xz, xy [Pa], shape (..., 3, 3) to (..., 6)."""
    sides = [gradient[..., i, j] + gradient[..., j, i] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))]
    return MATERIAL.lame[1] * np.stack(sides, axis=-1)


def mixed(mesh: QuadraticMesh, free: Index, corners: Index) -> csr_array:
    """Return the matrix of free displacements, then of pressures at the corners."""
    first, shear = (PA * value for value in MATERIAL.lame)
    size, count = 3 * len(mesh.nodes), len(mesh.nodes)
    stiff, coupling, volumes = csr_array((size, size)), csr_array((count, size)), csr_array((count, count))
    for start in range(0, len(mesh.elements), CHUNK):
        elements = mesh.elements[start : start + CHUNK]
        slope, volume = mesh.slopes(elements, RULE[None])
        weight = volume / 24.0
        across = np.einsum("eqai,eqbj,eq->eaibj", slope, slope, weight, optimize=True)
        own = shear * across.transpose(0, 1, 4, 3, 2)
        along = shear * np.einsum("eaibi->eab", across)
        for i in range(3):
            own[:, :, i, :, i] += along
        rows = degrees(elements.ravel()).reshape(-1, 30)
        stiff = stiff + _sum(own.reshape(-1, 30, 30), rows, rows, (size, size))
        widening = np.einsum("qc,eqai,eq->ecai", RULE, slope, weight, optimize=True)
        coupling = coupling + _sum(widening.reshape(-1, 4, 30), elements[:, :4], rows, (count, size))
        filled = np.einsum("qc,qd,eq->ecd", RULE, RULE, weight)
        volumes = volumes + _sum(filled, elements[:, :4], elements[:, :4], (count, count))
    b = coupling[corners][:, free]
    return block_array([[stiff[free][:, free], b.T], [b, volumes[corners][:, corners] / -first]]).tocsr()


def _sum(values: Array, rows: Index, columns: Index, shape: tuple[int, int]) -> csr_array:
    """Return a matrix with the values of elements, shape (e, r, c), added at rows (e, r) and columns (e, c)."""
    i, j = np.broadcast_to(rows[:, :, None], values.shape), np.broadcast_to(columns[:, None], values.shape)
    return coo_array((values.ravel(), (i.ravel(), j.ravel())), shape=shape).tocsr()

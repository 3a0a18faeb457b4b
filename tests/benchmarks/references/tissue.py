"""Linear tissue with averaged nodal pressure, condensed to where a shape may touch it. Lengths in mm, forces in N.

The product's energy, sum_e V mu e:e + sum_a V_a lambda/2 J_a^2, with the nodal pressures p = lambda J kept as unknowns:
[[A, B'], [B, -V/lambda]]. So a node is coupled to its neighbours only, not to theirs, and separators are half as thick.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.sparse import block_array, csr_array, diags_array

from core.skin.assembly import degrees, geometry, stiffness
from core.skin.material import Elastic
from core.skin.mesh import TetraMesh
from core.skin.stress import StressOperator, locate, nodal_average

from .dissection import Dissection, fill_upper

Array = NDArray[np.float64]
MATERIAL = Elastic(young=1e5, poisson=0.48)  # [Pa]
PA = 1e-6  # [N/mm^2]
CHUNK = 50_000  # tetrahedra assembled at once


class Tissue:
    """A mesh, ready to be pressed on some of its nodes.

    Args:
        mesh: [mm]. touched: nodes that may carry force, rising, none of them fixed, shape (k,).
        half: the mesh is the half at positive x of a symmetric one, which moves symmetrically.

    Attributes:
        compliance: displacement of the touched nodes for forces on them [mm/N], shape (3 k, 3 k). Of a half, the forces
            on nodes of the cut are those on the half; nodes of the cut do not move along x.
    """

    def __init__(self, mesh: TetraMesh, touched: NDArray[np.integer], half: bool = False) -> None:
        self.mesh, self.touched, self.half = mesh, touched, half
        matrix, free = _mixed(mesh, half)
        count = len(mesh.nodes)
        owner = np.concatenate([free // 3, np.arange(count)])
        negative = np.arange(len(owner)) >= len(free)
        kept = np.isin(owner, touched) & ~negative
        self.free = free
        self.dissection = Dissection(matrix, owner, negative, kept, mesh.nodes)
        schur = self.dissection.schur
        factor, info = dpotrf(schur, lower=1, clean=0, overwrite_a=1)
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

    def displacement(self, touched: Array) -> tuple[Array, float]:
        """Return the displacement of all nodes where the touched ones moved so, shape (n, 3), and the residual [N]."""
        found, residual = self.dissection.solve(touched.ravel()[self._own])
        out = np.zeros(3 * len(self.mesh.nodes))
        out[self.free] = found[: len(self.free)]
        return out.reshape(-1, 3), residual

    def stress(self, displacement: Array, points: Array) -> Array:
        """Return the stress [Pa] at points [mm], averaged at the nodes as in the product, shape (p, 6)."""
        mesh, displacement = mirrored(self.mesh, displacement) if self.half else (self.mesh, displacement)
        element, weights = locate(mesh, points)
        if (element < 0).any():
            raise ValueError("a probe lies outside the tissue")
        # two rings of tetrahedra: a node's pressure takes the first, an element of the first ring its nodes' pressures
        wanted = np.zeros(len(mesh.nodes), bool)
        wanted[mesh.tetrahedra[element]] = True
        for _ in range(2):
            part = wanted[mesh.tetrahedra].any(axis=1)
            wanted[mesh.tetrahedra[part]] = True
        near = replace(mesh, tetrahedra=mesh.tetrahedra[part])
        nodal = nodal_average(near, StressOperator(near, MATERIAL).stress(displacement))
        return np.einsum("kj,kjc->kc", weights, nodal[mesh.tetrahedra[element]])


def mirrored(mesh: TetraMesh, displacement: Array) -> tuple[TetraMesh, Array]:
    """Return the whole of a half mesh at positive x, and its displacement."""
    other = np.flatnonzero(mesh.nodes[:, 0] != 0.0)
    number = np.arange(len(mesh.nodes))
    number[other] = len(mesh.nodes) + np.arange(len(other))
    sign = np.array([-1.0, 1.0, 1.0])
    tetrahedra = number[mesh.tetrahedra][:, [1, 0, 2, 3]].astype(np.int32)
    whole = replace(
        mesh,
        nodes=np.concatenate([mesh.nodes, mesh.nodes[other] * sign]),
        tetrahedra=np.concatenate([mesh.tetrahedra, tetrahedra]),
    )
    return whole, np.concatenate([displacement, displacement[other] * sign])


def _mixed(mesh: TetraMesh, half: bool) -> tuple[csr_array, NDArray[np.int64]]:
    """Return the matrix of free displacements and all pressures, and which displacements are free."""
    first, shear = MATERIAL.lame
    plain = Elastic(young=2.0 * shear, poisson=0.0)  # its stiffness is 2 mu e:e alone
    size = 3 * len(mesh.nodes)
    shears, pressures = csr_array((size, size)), csr_array((len(mesh.nodes), size))
    volumes = np.zeros(len(mesh.nodes))
    for start in range(0, len(mesh.tetrahedra), CHUNK):
        part = replace(mesh, tetrahedra=mesh.tetrahedra[start : start + CHUNK])
        shape = geometry(part)
        shears = shears + PA * stiffness(part, plain, "p1", shape)
        pressures = pressures + diags_array(shape.nodal_volumes) @ shape.divergence
        volumes += shape.nodal_volumes
    free = degrees(mesh.free)
    if half:
        free = free[(free % 3 != 0) | (mesh.nodes[free // 3, 0] != 0.0)]
    b = pressures[:, free]
    return block_array([[shears[free][:, free], b.T], [b, diags_array(-volumes / (PA * first))]]).tocsr(), free

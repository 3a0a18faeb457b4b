"""Linear tissue of hexahedra with mean dilatation, condensed to where a shape may touch it. Lengths in mm, forces in N.

Eight-node elements lock where Poisson's ratio is near a half; with the dilatation averaged over each element (B-bar;
Hughes 1980) they do not. Stress is read at the middles of elements, where it converges fastest, and brought to a point by a
quadratic fit over the elements around it (after Zienkiewicz and Zhu 1992).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.sparse import coo_array, csr_array

from core.skin.assembly import degrees
from core.skin.material import Elastic
from core.tissue.dissection import Dissection, fill_upper

from .hexahedra import GAUSS, HexMesh

Array = NDArray[np.float64]
Index = NDArray[np.integer]
MATERIAL = Elastic(young=1e5, poisson=0.48)  # [Pa]
PA = 1e-6  # [N/mm^2]
CHUNK = 4_000  # elements assembled at once
MIRRORED = np.array([1.0, 1.0, 1.0, 1.0, -1.0, -1.0])  # stress on the other side of x = 0
CENTRE = np.zeros((1, 3))
ROWS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))  # xx, yy, zz, yz, xz, xy


class Tissue:
    """A mesh, ready to be pressed on some of its nodes.

    Args:
        mesh: [mm]. touched: nodes that may carry force, rising, none of them held, shape (k,).

    Attributes:
        compliance: displacement of the touched nodes for forces on them [mm/N], shape (3 k, 3 k). Of half a finger, the
            forces on nodes of the cut are those on the half; nodes of the cut do not move along x.
    """

    def __init__(self, mesh: HexMesh, touched: Index) -> None:
        self.mesh, self.touched = mesh, touched
        free = degrees(np.flatnonzero(~mesh.held))
        self.free = free[(free % 3 != 0) | ~mesh.cut[free // 3]]
        self.stiffness = stiffness(mesh)[self.free][:, self.free].tocsr()
        owner = self.free // 3
        kept = np.isin(owner, touched)
        self._parts = Dissection(self.stiffness, owner, np.zeros(len(owner), bool), kept, mesh.nodes)
        factor, info = dpotrf(self._parts.schur, lower=1, clean=0, overwrite_a=1)
        if info:
            raise ArithmeticError("the condensed stiffness is not positive definite")
        inverse, _ = dpotri(factor, lower=1, overwrite_c=1)
        fill_upper(inverse)
        self._parts.schur = np.zeros((0, 0))
        self._own = np.isin(degrees(touched), self.free)
        self.compliance = np.zeros((len(self._own), len(self._own)))
        self.compliance[np.ix_(self._own, self._own)] = inverse

    def deformed(self, force: Array) -> tuple[Array, float]:
        """Return what all nodes do under forces on the touched ones [N], shape (k, 3).

        Returns:
            Displacement [mm], shape (n, 3), and the largest force that is left on a degree of freedom, over the norm of
            the forces: as the stiffness has it, whatever solved for them.
        """
        load = np.zeros(3 * len(self.mesh.nodes))
        load[degrees(self.touched)] = force.ravel()
        moved = np.zeros_like(load)
        moved[self.free] = self._parts.solve((self.compliance @ force.ravel())[self._own])[0]
        left = self.stiffness @ moved[self.free] - load[self.free]
        return moved.reshape(-1, 3), float(np.abs(left).max() / max(np.linalg.norm(force), 1e-30))

    def stress(self, displacement: Array, points: Array) -> Array:
        """Return the stress [Pa] at points [mm], shape (p, 6)."""
        mesh = self.mesh
        slope, _ = mesh.slopes(mesh.elements, CENTRE)
        gradient = np.einsum("eai,eaj->eij", displacement[mesh.elements], slope[:, 0])
        return interpolated(mesh, cauchy(gradient), points)


def cauchy(gradient: Array) -> Array:
    """Return the stress of displacement gradients [Pa], shape (n, 3, 3) to (n, 6)."""
    first, shear = MATERIAL.lame
    out = shear * np.stack([gradient[:, i, j] + gradient[:, j, i] for i, j in ROWS], axis=1)
    out[:, :3] += first * np.trace(gradient, axis1=1, axis2=2)[:, None]
    return out


def interpolated(mesh: HexMesh, own: Array, points: Array) -> Array:
    """Return stress at points [mm], shape (p, 6), from that at the middles of the elements, shape (e, 6)."""
    other = (points[:, 0] < 0.0) & mesh.half
    points = np.where(other[:, None], points * [-1.0, 1.0, 1.0], points)
    element, _ = mesh.locate(points)
    middles = mesh.nodes[mesh.elements].mean(axis=1)
    around = csr_array(
        (np.ones(mesh.elements.size, bool), (mesh.elements.ravel(), np.repeat(np.arange(len(mesh.elements)), 8)))
    )
    found = np.zeros((len(points), 6))
    for row, (point, corners) in enumerate(zip(points, mesh.elements[element], strict=True)):
        near = np.unique(np.concatenate([around.indices[slice(*around.indptr[node : node + 2])] for node in corners]))
        places, values = middles[near], own[near]
        if mesh.cut[corners].any():
            places, values = np.vstack([places, places * [-1.0, 1.0, 1.0]]), np.vstack([values, values * MIRRORED])
        x = (places - point) / np.ptp(places, axis=0)
        fit = np.column_stack([np.ones(len(x)), x, x**2, x * np.roll(x, 1, axis=1)])
        found[row] = np.linalg.lstsq(fit, values, rcond=None)[0][0]
    return np.where(other[:, None], found * MIRRORED, found)


def stiffness(mesh: HexMesh) -> csr_array:
    """Return the stiffness of all degrees of freedom [N/mm], sparse (3 n, 3 n)."""
    first, shear = (PA * value for value in MATERIAL.lame)
    law = np.zeros((6, 6))
    law[:3, :3] = first
    law[np.arange(6), np.arange(6)] += shear * np.array([2.0, 2.0, 2.0, 1.0, 1.0, 1.0])
    size = 3 * len(mesh.nodes)
    total = csr_array((size, size))
    for start in range(0, len(mesh.elements), CHUNK):
        elements = mesh.elements[start : start + CHUNK]
        slope, volume = mesh.slopes(elements, GAUSS)
        strain = mean_dilatation(slope, volume)
        own = np.einsum("eqir,ij,eqjs,eq->ers", strain, law, strain, volume, optimize=True)
        rows = degrees(elements.ravel()).reshape(-1, 24)
        i, j = np.broadcast_to(rows[:, :, None], own.shape), np.broadcast_to(rows[:, None], own.shape)
        total = total + coo_array((own.ravel(), (i.ravel(), j.ravel())), shape=(size, size)).tocsr()
    return total


def mean_dilatation(slope: Array, volume: Array) -> Array:
    """Return strain for displacement of the corners, its dilatation averaged over each element.

    Args:
        slope: gradients of the shape functions, shape (e, q, 8, 3). volume: of the points, shape (e, q).

    Returns:
        Shape (e, q, 6, 24): xx, yy, zz, then twice yz, xz, xy.
    """
    out = np.zeros((*slope.shape[:2], 6, 24))
    for row, (i, j) in enumerate(ROWS):
        out[..., row, i::3] = slope[..., j]
        out[..., row, j::3] = slope[..., i]
    flat = slope.reshape(*slope.shape[:2], 24)
    mean = np.einsum("eqr,eq->er", flat, volume) / volume.sum(axis=1)[:, None]
    out[..., :3, :] += ((mean[:, None] - flat) / 3.0)[..., None, :]
    return out

"""Linear tissue of hexahedra with mean dilatation, condensed to where a shape may touch it. Lengths in mm, forces in N.

Eight-node elements lock where Poisson's ratio is near a half; with the dilatation averaged over each element (B-bar;
Hughes 1980) they do not. Stress is read at the middles of elements, where it converges fastest, and brought to a point
by a quadratic fit over the elements around it (after Zienkiewicz and Zhu 1992).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.sparse import coo_array, csr_array

from core.skin.assembly import degrees
from core.skin.material import Elastic
from tests.exact.dissection import Dissection, fill_upper

from .hexahedra import GAUSS, HexMesh

Array = NDArray[np.float64]
Index = NDArray[np.integer]
MATERIAL = Elastic(young=1e5, poisson=0.48)  # [Pa]
PA = 1e-6  # [N/mm^2]
CHUNK = 4_000  # elements assembled at once
MIRRORED = np.array([1.0, 1.0, 1.0, 1.0, -1.0, -1.0])  # stress on the other side of x = 0
BED = 10.0  # of springs under the nail's border [N/mm^3]: a millimetre of tissue gives way a hundred times as far
CENTRE = np.zeros((1, 3))
ENOUGH = 18  # elements about a point for a quadratic fit; in a corner of the mesh it is linear
ROWS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))  # xx, yy, zz, yz, xz, xy


class Condensed:
    """A stiffness, factorised and condensed to some nodes.

    Args:
        stiffness: of all degrees of freedom [N/mm], sparse (3 n, 3 n). touched: nodes that may carry force, rising,
            none of them held, shape (k,).

    Attributes:
        free: degrees of freedom that move. compliance: displacement of the touched nodes for forces on them [mm/N],
            shape (3 k, 3 k). Of half a finger, the forces on nodes of the cut are those on the half; nodes of the cut
            do not move along x.
    """

    def __init__(self, mesh: HexMesh, stiffness: csr_array, touched: Index) -> None:
        free = degrees(np.flatnonzero(~mesh.held))
        self.free = free[(free % 3 != 0) | ~mesh.cut[free // 3]]
        self.stiffness = stiffness[self.free][:, self.free].tocsr()
        owner = self.free // 3
        self._kept = np.isin(owner, touched)
        self._parts = Dissection(self.stiffness, owner, np.zeros(len(owner), bool), self._kept, mesh.nodes)
        factor, info = dpotrf(self._parts.schur, lower=1, clean=0, overwrite_a=1)
        if info:
            raise ArithmeticError("the condensed stiffness is not positive definite")
        inverse, _ = dpotri(factor, lower=1, overwrite_c=1)
        fill_upper(inverse)
        self._parts.schur = np.zeros((0, 0))
        own = np.isin(degrees(touched), self.free)
        self._own = own
        self.compliance = np.zeros((len(own), len(own)))
        self.compliance[np.ix_(own, own)] = inverse

    def solve(self, load: Array) -> tuple[Array, float]:
        """Return the displacement of all nodes under forces on them, flat as those, shape (3 n,).

        With it comes the largest force that is left on a degree of freedom, over the norm of the forces: as the
        stiffness has it, whatever solved for them.
        """
        own = load[self.free]
        inner = np.where(self._kept, 0.0, own)
        still, _ = self._parts.solve(np.zeros(np.count_nonzero(self._kept)), inner)
        handed = (own - self.stiffness @ still)[self._kept]
        whole = np.zeros(len(self._own))
        whole[self._own] = handed
        found, _ = self._parts.solve((self.compliance @ whole)[self._own], inner)
        moved = np.zeros(len(load))
        moved[self.free] = found
        left = np.abs(self.stiffness @ found - own).max()
        return moved, float(left / max(np.linalg.norm(own), 1e-30))


class Tissue:
    """A mesh of linear tissue, ready to be pressed on some of its nodes.

    Args:
        mesh: [mm]. touched: nodes that may carry force, rising, none of them held, shape (k,).

    Attributes:
        compliance: as `Condensed` has it.
    """

    def __init__(self, mesh: HexMesh, touched: Index) -> None:
        self.mesh, self.touched = mesh, touched
        self._condensed = Condensed(mesh, stiffness(mesh), touched)
        self.compliance = self._condensed.compliance

    def deformed(self, force: Array) -> tuple[Array, float]:
        """Return what all nodes do under forces on the touched ones [N], shape (k, 3).

        Returns:
            Displacement [mm], shape (n, 3), and what is left of the forces, as `Condensed.solve` has it.
        """
        load = np.zeros(3 * len(self.mesh.nodes))
        load[degrees(self.touched)] = force.ravel()
        moved, left = self._condensed.solve(load)
        return moved.reshape(-1, 3), left

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
        if mesh.cut[corners].any():  # the elements on the other side of the cut are as near as those on it
            beside = mesh.cut[mesh.elements[near]].any(axis=1)
            places = np.vstack([places, places[beside] * [-1.0, 1.0, 1.0]])
            values = np.vstack([values, values[beside] * MIRRORED])
        x = (places - point) / np.ptp(places, axis=0)
        fit = np.column_stack([np.ones(len(x)), x, x**2, x * np.roll(x, 1, axis=1)])
        if len(x) < ENOUGH:
            fit = fit[:, :4]
        found[row] = np.linalg.lstsq(fit, values, rcond=None)[0][0]
    return np.where(other[:, None], found * MIRRORED, found)


def stiffness(mesh: HexMesh) -> csr_array:
    """Return the stiffness of all degrees of freedom [N/mm], sparse (3 n, 3 n)."""
    first, shear = (PA * value for value in MATERIAL.lame)
    law = np.zeros((6, 6))
    law[:3, :3] = first
    law[np.arange(6), np.arange(6)] += shear * np.array([2.0, 2.0, 2.0, 1.0, 1.0, 1.0])
    total = csr_array((mesh.nodes.size, mesh.nodes.size))
    for start in range(0, len(mesh.elements), CHUNK):
        elements = mesh.elements[start : start + CHUNK]
        slope, volume = mesh.slopes(elements, GAUSS)
        strain = mean_dilatation(slope, volume)
        own = np.einsum("eqir,ij,eqjs,eq->ers", strain, law, strain, volume, optimize=True)
        total = total + assembled(own, elements, mesh)
    return total if mesh.bed is None else total + BED * mesh.bed


def assembled(own: Array, elements: Index, mesh: HexMesh) -> csr_array:
    """Return the sum of the elements' matrices, shape (e, 24, 24), over all degrees of freedom."""
    rows = degrees(elements.ravel()).reshape(-1, 24)
    i, j = np.broadcast_to(rows[:, :, None], own.shape), np.broadcast_to(rows[:, None], own.shape)
    return coo_array((own.ravel(), (i.ravel(), j.ravel())), shape=(mesh.nodes.size, mesh.nodes.size)).tocsr()


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

"""Stress in the pulp: in each element, and at the depths of receptors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from .assembly import Element, Geometry, geometry
from .material import Elastic
from .mesh import TetraMesh
from .recovery import fitted

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Floats = NDArray[np.floating[Any]]

COMPONENTS = ("xx", "yy", "zz", "yz", "xz", "xy")
# Depths of SA1, RA and PC afferents below the skin, as fitted to their responses [m].
# Source: TouchSim; Saal, Delhaye, Rayhaun and Bensmaia 2017
RECEPTOR_DEPTHS = (0.3e-3, 1.6e-3, 2.0e-3)
_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
_SHEAR_WEIGHT = np.array([1.0, 1.0, 1.0, np.sqrt(2.0), np.sqrt(2.0), np.sqrt(2.0)])
INSIDE = 1e-9  # a point is in an element if its barycentric coordinates are at least minus this


@dataclass(frozen=True, eq=False)
class StressOperator:
    """Operator from nodal displacement to the stress of elements.

    Components of stress are xx, yy, zz, yz, xz, xy in the finger's frame. With averaged nodal pressure, the pressure of
    an element is the mean of the pressures at its nodes, as in the stiffness matrix.

    Attributes:
        mesh: mesh of the tissue.
        material: its material.
        element: 'anp' or 'p1'.
    """

    mesh: TetraMesh
    material: Elastic
    element: Element = "anp"

    def with_material(self, material: Elastic) -> StressOperator:
        """Return the operator for another material; common tables are shared."""
        other = StressOperator(self.mesh, material, self.element)
        shared = ("geometry", "strain_matrix", "mean", "volumetric_matrix", "weights")
        other.__dict__.update({name: self.__dict__[name] for name in shared if name in self.__dict__})
        return other

    @cached_property
    def geometry(self) -> Geometry:
        """Geometry of the mesh."""
        return geometry(self.mesh)

    @cached_property
    def strain_matrix(self) -> csr_array:
        """Matrix from displacement to strain, sparse, shape (6 e, 3 n).

        The rows are the six components of the strain tensor of each element.
        """
        from scipy.sparse import coo_array

        g, tetra = self.geometry.gradients, self.mesh.tetrahedra.astype(np.int64)
        count = len(tetra)
        rows, columns, values = [], [], []
        for k, (i, j) in enumerate(_PAIRS):
            row = np.broadcast_to(6 * np.arange(count)[:, None] + k, (count, 4))
            for a, b in ((i, j), (j, i)) if i != j else ((i, i),):
                rows.append(row)
                columns.append(3 * tetra + a)
                values.append(g[:, :, b] * (0.5 if i != j else 1.0))
        index = (np.concatenate(rows).ravel(), np.concatenate(columns).ravel())
        return coo_array((np.concatenate(values).ravel(), index), shape=(6 * count, 3 * len(self.mesh.nodes))).tocsr()

    @cached_property
    def mean(self) -> csr_array:
        """Matrix from nodal values to their mean in elements, sparse, shape (e, n)."""
        from scipy.sparse import csr_array as csr

        count = len(self.mesh.tetrahedra)
        starts = np.arange(0, 4 * count + 1, 4)
        return csr((np.full(4 * count, 0.25), self.mesh.tetrahedra.ravel(), starts), (count, len(self.mesh.nodes)))

    @cached_property
    def volumetric_matrix(self) -> csr_array:
        """Matrix from displacement u to div u of elements, sparse, shape (e, 3 n).

        For 'anp', div u is averaged at the nodes, and then in each element.
        """
        from scipy.sparse import csr_array as csr

        count = len(self.mesh.tetrahedra)
        if self.element == "anp":
            return (self.mean @ self.geometry.divergence).tocsr()
        trace = csr(
            (
                np.ones(3 * count),
                (6 * np.arange(count)[:, None] + np.arange(3)).ravel(),
                np.arange(0, 3 * count + 1, 3),
            ),
            (count, 6 * count),
        )
        return (trace @ self.strain_matrix).tocsr()

    def stress(self, displacement: Floats) -> Array:
        """Return the stress of each element [Pa], shape (e, 6).

        Args:
            displacement: displacement of the nodes [m], shape (n, 3).
        """
        first, shear = self.material.lame
        u = _flat(displacement)
        out = 2.0 * shear * (self.strain_matrix @ u).reshape(-1, 6)
        out[:, :3] += (first * self._dilatation(u))[:, None]
        return out

    def energy_density(self, displacement: Floats) -> Array:
        """Return the strain energy density of each element [J/m^3], shape (e,).

        Its sum, weighted with the volumes, is half the product of forces and displacements.

        Args:
            displacement: displacement of the nodes [m], shape (n, 3).
        """
        first, shear = self.material.lame
        u = _flat(displacement)
        strain = (self.strain_matrix @ u).reshape(-1, 6)
        density = shear * np.einsum("ij,ij,j->i", strain, strain, _SHEAR_WEIGHT**2)
        if self.element == "anp":
            nodal = 0.5 * first * (self.geometry.divergence @ u) ** 2
            return density + self.mean @ nodal
        return density + 0.5 * first * strain[:, :3].sum(axis=1) ** 2

    def _dilatation(self, u: Array) -> Array:
        if self.element == "anp":
            # Two products, first to the nodes and then to the elements, take a tenth of the time of a product with
            # `volumetric_matrix`.
            return self.mean @ (self.geometry.divergence @ u)
        return self.volumetric_matrix @ u

    @cached_property
    def matrix(self) -> csr_array:
        """Matrix from displacement to stress, sparse, shape (6 e, 3 n)."""
        from scipy.sparse import csr_array as csr

        first, shear = self.material.lame
        count = len(self.mesh.tetrahedra)
        rows = (6 * np.arange(count)[:, None] + np.arange(3)).ravel()
        spread = csr((np.ones(3 * count), (rows, np.repeat(np.arange(count), 3))), (6 * count, count))
        return (2.0 * shear * self.strain_matrix + first * (spread @ self.volumetric_matrix)).tocsr()

    @cached_property
    def weighted_matrix(self) -> csr_array:
        """`matrix` with weighted rows, sparse, shape (6 e, 3 n).

        The 2-norm of its product with a displacement is the volume-weighted L2 norm of the stress.
        """
        from scipy.sparse import diags_array

        return (diags_array(self.weights.ravel()) @ self.matrix).tocsr()

    @cached_property
    def weights(self) -> Array:
        """Weights of stress components for the L2 norm [m^1.5], shape (e, 6).

        The 2-norm of stresses multiplied by them is the volume-weighted L2 norm of the stress.
        """
        return np.sqrt(self.geometry.volumes)[:, None] * _SHEAR_WEIGHT


def von_mises(stress: Array) -> Array:
    """Return the von Mises stress [Pa], shape (...).

    Args:
        stress: stresses xx, yy, zz, yz, xz, xy [Pa], shape (..., 6).
    """
    xx, yy, zz, yz, xz, xy = np.moveaxis(stress, -1, 0)
    return np.sqrt(0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3.0 * (yz**2 + xz**2 + xy**2))


def stored(stress: Array, material: Elastic) -> Array:
    """Return the strain energy density of linear tissue [J/m^3], shape (...).

    Args:
        stress: stresses xx, yy, zz, yz, xz, xy [Pa], shape (..., 6).
        material: material of the tissue.
    """
    square = np.einsum("...i,i->...", stress * stress, _SHEAR_WEIGHT**2)
    trace = stress[..., :3].sum(axis=-1)
    young, poisson = material.modulus, material.poisson
    return np.asarray(((1.0 + poisson) * square - poisson * trace * trace) / (2.0 * young))


def nodal_average(mesh: TetraMesh, values: Array) -> Array:
    """Return the volume average of elements at each node, shape (n, ...).

    Args:
        mesh: mesh of the tissue.
        values: values of the elements, shape (e, ...).
    """
    count = len(mesh.tetrahedra)
    return (mesh.averaging @ values.reshape(count, -1)).reshape(len(mesh.nodes), *values.shape[1:])


@dataclass(frozen=True, eq=False)
class Probes:
    """Points in the tissue at which stress is evaluated.

    Attributes:
        points: positions [m], shape (k, 3).
        reading: matrix from values of elements to values at the points, sparse, shape (k, e), see `recovery.fitted`.
        depth: depth below the skin [m], shape (k,); nan if it is not known.
        pad: position in `mesh.pad` of the node above each point, shape (k,); -1 for none.
    """

    points: Array
    reading: csr_array
    depth: Array
    pad: NDArray[np.int64]

    def read(self, values: Array) -> Array:
        """Return values at the points, shape (k, ...).

        Args:
            values: values of the elements, shape (e, ...).
        """
        flat = self.reading @ values.reshape(len(values), -1)
        return np.asarray(flat.reshape(len(self.points), *values.shape[1:]))


def receptor_probes(mesh: TetraMesh, depths: Sequence[float] = RECEPTOR_DEPTHS) -> Probes:
    """Return probes below each pad node.

    Points in bone or outside the mesh are left out.

    Args:
        mesh: mesh of the tissue.
        depths: depths of the probes below the skin [m].
    """
    points = (mesh.nodes[mesh.pad][None] - np.asarray(depths)[:, None, None] * mesh.pad_normals[None]).reshape(-1, 3)
    depth = np.repeat(np.asarray(depths, float), len(mesh.pad))
    pad = np.tile(np.arange(len(mesh.pad)), len(depths))
    inside = locate(mesh, points)[0] >= 0
    return Probes(points[inside], fitted(mesh, points[inside]), depth[inside], pad[inside])


def locate(mesh: TetraMesh, points: Array) -> tuple[NDArray[np.int64], Array]:
    """Find the element that contains each point.

    Args:
        mesh: mesh of the tissue.
        points: the points [m], shape (k, 3).

    Returns:
        Indices of the elements, shape (k,), -1 for a point outside the mesh; barycentric coordinates of the points in
        them, shape (k, 4).
    """
    from scipy.spatial import cKDTree

    corners = mesh.nodes[mesh.tetrahedra]
    tree = cKDTree(corners.mean(axis=1))
    element = np.full(len(points), -1, np.int64)
    weights = np.zeros((len(points), 4))
    todo = np.arange(len(points))
    near = min(32, len(corners))
    while len(todo):
        candidates = tree.query(points[todo], k=near)[1].reshape(len(todo), near)
        coordinates = _barycentric(corners[candidates], points[todo][:, None])
        lowest = coordinates.min(axis=2)
        best = lowest.argmax(axis=1)
        rows = np.arange(len(todo))
        found = lowest[rows, best] >= -INSIDE
        element[todo[found]] = candidates[rows, best][found]
        weights[todo[found]] = coordinates[rows, best][found]
        todo = todo[~found]
        if near == len(corners):
            break
        # The centre of an elongated element can be far from a point in it. So eight times as many are tested next, and
        # finally all.
        near = min(8 * near, len(corners))
        if near * len(todo) > 20_000_000 and len(todo) > 1:
            half = len(todo) // 2
            for part in (todo[:half], todo[half:]):
                element[part], weights[part] = locate(mesh, points[part])
            break
    return element, weights


def _barycentric(corners: Array, points: Array) -> Array:
    a, b, c, d = (corners[..., i, :] - points for i in range(4))

    def volume(p: Array, q: Array, r: Array) -> Array:
        return np.einsum("...i,...i->...", np.cross(p, q), r)

    parts = np.stack([volume(b, d, c), volume(a, c, d), volume(a, d, b), volume(a, b, c)], axis=-1)
    return parts / parts.sum(axis=-1, keepdims=True)


def _flat(displacement: Floats) -> Array:
    return np.ascontiguousarray(displacement, np.float64).reshape(-1)

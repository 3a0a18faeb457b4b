"""Stiffness of linear tetrahedra, plain or with averaged nodal pressure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError
from .material import Elastic
from .mesh import TetraMesh

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Element = Literal["anp", "p1"]  # averaged nodal pressure, and plain linear tetrahedra
ELEMENTS: tuple[Element, ...] = ("anp", "p1")


@dataclass(frozen=True, eq=False)
class Geometry:
    """Geometry of a mesh, for stiffness and stress.

    Attributes:
        gradients: gradients of the four shape functions of each element [1/m], shape (e, 4, 3).
        volumes: volume of each element [m^3], shape (e,).
        nodal_volumes: a quarter of the volume of the elements around each node [m^3], shape (n,).
        divergence: maps nodal displacements to the volume average of div u around each node, sparse, shape (n, 3 n).
    """

    gradients: Array
    volumes: Array
    nodal_volumes: Array
    divergence: csr_array


def geometry(mesh: TetraMesh) -> Geometry:
    """Return the geometry of a mesh."""
    from scipy.sparse import coo_array

    corners = mesh.nodes[mesh.tetrahedra]
    edges = corners[:, 1:] - corners[:, :1]
    volumes = mesh.volumes
    # The rows of the inverse Jacobian are cross products of edges. For axis-parallel elements this is exact.
    inverse = np.stack([np.cross(edges[:, (i + 1) % 3], edges[:, (i + 2) % 3]) for i in range(3)], axis=1)
    inverse /= 6.0 * volumes[:, None, None]
    gradients = np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)

    count = len(mesh.nodes)
    nodal = np.zeros(count)
    np.add.at(nodal, mesh.tetrahedra, volumes[:, None] / 4.0)
    weight = (volumes / 4.0)[:, None, None] * gradients
    row = np.broadcast_to(mesh.tetrahedra[:, :, None, None], (len(volumes), 4, 4, 3))
    column = 3 * mesh.tetrahedra[:, None, :, None] + np.arange(3)
    values = np.broadcast_to(weight[:, None], row.shape) / nodal[row]
    column = np.broadcast_to(column, row.shape)
    divergence = coo_array((values.ravel(), (row.ravel(), column.ravel())), shape=(count, 3 * count)).tocsr()
    return Geometry(gradients, volumes, nodal, divergence)


def stiffness(mesh: TetraMesh, material: Elastic, element: Element = "anp") -> csr_array:
    """Return the stiffness matrix of all nodes [N/m], shape (3 n, 3 n).

    The matrix is sparse. Degrees of freedom are x, y and z of each node. The element 'anp' computes the pressure at
    each node a from J_a, the volume average of div u around it. With the strain e and Lame's parameters, the energy is
    W = sum_e V mu e:e + sum_a V_a lambda/2 J_a^2. This element does not lock for nearly incompressible tissue. The
    element 'p1' is the plain tetrahedron, for comparison.

    Args:
        mesh: mesh of the tissue.
        material: material of the tissue.
        element: 'anp' or 'p1'.

    Raises:
        DermisError: the element is unknown.
    """
    from scipy.sparse import coo_array, diags_array

    if element not in ELEMENTS:
        raise DermisError("unknown element", where="skin", value=element, limit=", ".join(ELEMENTS))
    shape = geometry(mesh)
    first, shear = material.lame
    g, v = shape.gradients, shape.volumes
    blocks = shear * np.einsum("eai,ebj->eabji", g, g)
    dots = shear * np.einsum("eak,ebk->eab", g, g)
    for i in range(3):
        blocks[..., i, i] += dots
    if element == "p1":
        blocks += first * np.einsum("eai,ebj->eabij", g, g)
    blocks *= v[:, None, None, None, None]
    degrees = (3 * mesh.tetrahedra[:, :, None] + np.arange(3)).astype(np.int32)
    row = np.broadcast_to(degrees[:, :, None, :, None], blocks.shape)
    column = np.broadcast_to(degrees[:, None, :, None, :], blocks.shape)
    size = 3 * len(mesh.nodes)
    matrix = coo_array((blocks.ravel(), (row.ravel(), column.ravel())), shape=(size, size)).tocsr()
    if element == "anp":
        pressure = diags_array(first * shape.nodal_volumes)
        matrix = matrix + shape.divergence.T.tocsr() @ (pressure @ shape.divergence)
    return matrix.tocsr()


def degrees(nodes: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return the indices of the degrees of freedom of nodes, shape (3 k,).

    They are x, y and z of each node.

    Args:
        nodes: indices of the nodes, shape (k,).
    """
    return (3 * np.asarray(nodes, np.int64)[:, None] + np.arange(3)).ravel()

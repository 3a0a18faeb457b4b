"""TetraMesh: tetrahedral mesh of soft tissue, with its node sets."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices32, feed

if TYPE_CHECKING:
    from scipy.sparse import csr_array


FACES = ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))  # corners of a tetrahedron's faces, counter-clockwise from outside
PAD_TILT = -0.1  # skin belongs to the pad if the Z component of its outward unit normal is below this value


@dataclass(frozen=True, eq=False)
class TetraMesh:
    """Tetrahedral mesh of soft tissue.

    Attributes:
        nodes: positions in the finger's frame [m], shape (n, 3).
        tetrahedra: node indices of each element, with positive volume, shape (e, 4), int32.
        fixed: indices of the nodes that are fixed to bone or nail, in rising order, shape (f,), int32.
        pad: indices of the nodes that may touch objects, in rising order, shape (m,), int32. None of them is fixed.
        surface: triangles of the skin, counter-clockwise from outside, shape (t, 3), int32.
        name: name of the mesh in messages.
    """

    nodes: Array
    tetrahedra: Indices32
    fixed: Indices32
    pad: Indices32
    surface: Indices32
    name: str = "fingertip"

    def __repr__(self) -> str:
        return f"TetraMesh({self.name}, {len(self.nodes)} nodes, {len(self.tetrahedra)} tetrahedra)"

    @cached_property
    def free(self) -> Indices32:
        """Indices of the free nodes, in rising order, shape (n - f,).

        They are the nodes that are not fixed.
        """
        held = np.zeros(len(self.nodes), bool)
        held[self.fixed] = True
        return np.flatnonzero(~held).astype(np.int32)

    @cached_property
    def volumes(self) -> Array:
        """Volume of each tetrahedron [m^3], shape (e,)."""
        return tetra_volumes(self.nodes, self.tetrahedra)

    @cached_property
    def hash(self) -> str:
        """SHA-256 of nodes, elements and node sets."""
        sha = hashlib.sha256(b"dermis-tetra-mesh 1\n")
        feed(sha, self.nodes, self.tetrahedra, self.fixed, self.pad, self.surface)
        return sha.hexdigest()

    @property
    def pad_vectors(self) -> Array:
        """Area vector of each pad node [m^2], shape (m, 3).

        It is a third of the sum of the area vectors of the triangles around the node.
        """
        return np.asarray(self._node_vectors[self.pad])

    @cached_property
    def pad_areas(self) -> Array:
        """Area of skin of each pad node [m^2], shape (m,).

        It is the length of the area vector of the node.
        """
        return np.linalg.norm(self.pad_vectors, axis=1)

    @cached_property
    def pad_normals(self) -> Array:
        """Outward unit normal of each pad node, shape (m, 3).

        It is the direction of the area vector of the node.
        """
        vectors = self.pad_vectors
        return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)

    @cached_property
    def averaging(self) -> csr_array:
        """Matrix of the averages around nodes, sparse, shape (n, e).

        It maps values of elements to their volume average around each node.
        """
        from scipy.sparse import csr_array as csr

        count = len(self.tetrahedra)
        nodal = np.bincount(self.tetrahedra.ravel(), np.repeat(self.volumes, 4), minlength=len(self.nodes))
        shares = np.repeat(self.volumes, 4) / nodal[self.tetrahedra.ravel()]
        starts = np.arange(0, 4 * count + 1, 4)
        return csr((shares, self.tetrahedra.ravel(), starts), (count, len(self.nodes))).T.tocsr()

    @cached_property
    def _node_vectors(self) -> Array:
        a, b, c = (self.nodes[self.surface[:, i]] for i in range(3))
        vectors = np.cross(b - a, c - a) / 6.0
        out = np.zeros_like(self.nodes)
        for corner in range(3):
            np.add.at(out, self.surface[:, corner], vectors)
        return out


def pad_nodes(mesh: TetraMesh, exclude: NDArray[np.integer] | None = None) -> Indices32:
    """Return the free nodes of the palmar skin, shape (m,).

    They are selected by `PAD_TILT` and are in rising order.

    Args:
        mesh: mesh with its skin and its fixed nodes.
        exclude: indices of nodes that do not belong to the pad.
    """
    vectors = mesh._node_vectors
    length = np.linalg.norm(vectors, axis=1)
    palmar = (length > 0) & (vectors[:, 2] < PAD_TILT * length)
    palmar[mesh.fixed] = False
    if exclude is not None:
        palmar[exclude] = False
    return np.flatnonzero(palmar).astype(np.int32)


def tetra_volumes(nodes: Array, tetrahedra: Indices32) -> Array:
    """Return the signed volume of tetrahedra [m^3], shape (e,).

    Args:
        nodes: positions of the nodes [m], shape (n, 3).
        tetrahedra: node indices of each tetrahedron, shape (e, 4).
    """
    a, b, c, d = (nodes[tetrahedra[:, i]] for i in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0


def boundary_faces(tetrahedra: Indices32) -> Indices32:
    """Return the boundary faces of a mesh, shape (b, 3).

    A boundary face belongs to a single tetrahedron. Its corners are counter-clockwise from outside.

    Args:
        tetrahedra: node indices of each tetrahedron, shape (e, 4).
    """
    faces = tetrahedra[:, FACES].reshape(-1, 3)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return faces[np.sort(first[count == 1])].astype(np.int32)

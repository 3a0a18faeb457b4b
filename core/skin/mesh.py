"""TetraMesh, and the graded mesh of a fingertip: a shell of hexahedra from bone to skin, each split into five."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError
from .disk import disk_quads, mirrored, split_hexahedra, split_quads
from .shape import FingertipShape

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Array = NDArray[np.float64]
Index = NDArray[np.int32]

DEPTH_GROWTH = 2.0  # thickness of the layer at the bone over that at the skin, under the pad; less where tissue is thin
PAD_TILT = -0.1  # skin whose outward normal has a smaller Z may touch


@dataclass(frozen=True)
class Level:
    """How fine a mesh is.

    Attributes:
        across, along: cells of the fine block across and along the pad, both even.
        rings: rings of cells from the block to the cut end.
        layers: from bone to skin.
    """

    across: int
    along: int
    rings: int
    layers: int

    @property
    def tetrahedra(self) -> int:
        """Number of tetrahedra."""
        return 5 * self.layers * (self.across * self.along + 2 * (self.across + self.along) * self.rings)


LEVELS: dict[str, Level] = {
    "draft": Level(4, 8, 3, 3),
    "standard": Level(8, 12, 4, 5),
    "fine": Level(14, 20, 7, 7),
    "reference": Level(20, 30, 10, 11),
}


@dataclass(frozen=True, eq=False)
class TetraMesh:
    """A tetrahedral mesh of soft tissue, with the nodes that are held and those that may touch.

    Attributes:
        nodes: [m] in the finger's frame, shape (n, 3).
        tetrahedra: node indices, positively oriented, shape (e, 4), int32.
        fixed: nodes that bone and nail hold, rising, shape (f,), int32.
        pad: nodes that may touch, rising, none of them fixed, shape (m,), int32.
        surface: triangles of the skin, counter-clockwise from outside, shape (t, 3), int32.
        name: what to call it in messages.
    """

    nodes: Array
    tetrahedra: Index
    fixed: Index
    pad: Index
    surface: Index
    name: str = "fingertip"

    def __repr__(self) -> str:
        return f"TetraMesh({self.name}, {len(self.nodes)} nodes, {len(self.tetrahedra)} tetrahedra)"

    @cached_property
    def free(self) -> Index:
        """Nodes that can move, rising, shape (n - f,)."""
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
        for array in (self.nodes, self.tetrahedra, self.fixed, self.pad, self.surface):
            sha.update(f"{array.dtype.str}{array.shape}".encode())
            sha.update(np.ascontiguousarray(array).data)
        return sha.hexdigest()

    @cached_property
    def pad_areas(self) -> Array:
        """A third of the skin around each pad node [m^2], shape (m,)."""
        return np.linalg.norm(self._node_vectors[self.pad], axis=1)

    @cached_property
    def pad_normals(self) -> Array:
        """Outward unit normal at each pad node, area-weighted, shape (m, 3)."""
        vectors = self._node_vectors[self.pad]
        return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)

    @cached_property
    def averaging(self) -> csr_array:
        """Takes values per element to their volume average around each node, sparse (n, e)."""
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


def fingertip_mesh(shape: FingertipShape | None = None, level: str | Level = "standard") -> TetraMesh:
    """Return the mesh of a fingertip, graded towards the pad and mirror-symmetric in x, bit for bit.

    Bone surface and nail are fixed. Pad nodes are those of the palmar skin, without the rim of the cut end.

    Args:
        level: 'draft' (about 1.6k tetrahedra), 'standard' (6.4k), 'fine' (26k), 'reference' (88k, for tests), or
            a `Level`.

    Raises:
        DermisError: an unknown level, or a shape so uneven that elements would be inverted.
    """
    shape = shape or FingertipShape()
    if isinstance(level, str):
        if level not in LEVELS:
            raise DermisError("unknown accuracy", where="fingertip mesh", value=level, limit=", ".join(LEVELS))
        level = LEVELS[level]
    if level.layers < 1:
        raise DermisError("too few layers", where="fingertip mesh", value=level.layers, limit=">= 1")
    disk = disk_quads(level.across, level.along, level.rings)
    count = len(disk.chart)
    skin, bone = (mirrored(surface, disk.mirror) for surface in (shape.skin(disk.chart), shape.bone(disk.chart)))
    thickness = np.linalg.norm(skin - bone, axis=1)
    rate = np.log(DEPTH_GROWTH) * np.minimum(1.0, thickness / shape.pulp)
    depth = np.linspace(1.0, 0.0, level.layers + 1)[:, None]
    share = 1.0 - np.expm1(rate * depth) / np.expm1(rate)
    nodes = (bone[None] + share[:, :, None] * (skin - bone)[None]).reshape(-1, 3)

    starts = (np.arange(level.layers, dtype=np.int32) * count)[:, None, None]
    hexahedra = np.concatenate([disk.quads[None] + starts, disk.quads[None] + starts + np.int32(count)], axis=2)
    colour = (disk.colour[None] + np.arange(level.layers + 1)[:, None]).ravel() % 2
    tetrahedra = split_hexahedra(hexahedra.reshape(-1, 8), colour)

    top = level.layers * count
    triangles = split_quads(disk.quads, (disk.colour + level.layers) % 2) + np.int32(top)
    nail = np.flatnonzero(shape.under_nail(skin)) + top
    fixed = np.concatenate([np.arange(count), nail]).astype(np.int32)
    mesh = TetraMesh(nodes, tetrahedra, fixed, np.zeros(0, np.int32), triangles.astype(np.int32))
    pad = pad_nodes(mesh, exclude=disk.rim + top)
    mesh = TetraMesh(nodes, tetrahedra, fixed, pad, mesh.surface)

    from .quality import check_mesh

    check_mesh(mesh)
    return mesh


def pad_nodes(mesh: TetraMesh, exclude: NDArray[np.integer] | None = None) -> Index:
    """Return the free nodes of the palmar skin: those whose outward normal points well away from the nail."""
    vectors = mesh._node_vectors
    length = np.linalg.norm(vectors, axis=1)
    palmar = (length > 0) & (vectors[:, 2] < PAD_TILT * length)
    palmar[mesh.fixed] = False
    if exclude is not None:
        palmar[exclude] = False
    return np.flatnonzero(palmar).astype(np.int32)


def tetra_volumes(nodes: Array, tetrahedra: Index) -> Array:
    """Return the signed volume of tetrahedra [m^3], shape (e,)."""
    a, b, c, d = (nodes[tetrahedra[:, i]] for i in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0


def boundary_faces(tetrahedra: Index) -> Index:
    """Return the faces that belong to one tetrahedron only, counter-clockwise from outside, shape (b, 3)."""
    faces = tetrahedra[:, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]].reshape(-1, 3)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return faces[np.sort(first[count == 1])].astype(np.int32)

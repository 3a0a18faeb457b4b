"""TetraMesh, and the graded mesh of a fingertip: a shell of hexahedra from bone to skin, each split into five."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError
from .shape import FingertipShape

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Array = NDArray[np.float64]
Index = NDArray[np.int32]
Complex = NDArray[np.complex128]

# The fine block in the chart, whose radius is 1: its half width, and how far it runs back from the pad's centre and
# forward over the tip.
PAD_HALF, PAD_BACK, PAD_FRONT = 0.17, 0.19, 0.26
PAD_BULGE = 0.10  # bows the block's sides outward, so that its corners come nearer to the ideal 120 degrees
DEPTH_GROWTH = 2.0  # thickness of the layer at the bone over that at the skin, under the pad; less where tissue is thin
PAD_TILT = -0.1  # skin whose outward normal has a smaller Z may touch

# Five tetrahedra of a hexahedron whose vertices 0, 2, 5, 7 (first) or 1, 3, 4, 6 (second) are of the even colour.
_SPLIT = (
    ((0, 2, 7, 5), (1, 2, 0, 5), (3, 0, 2, 7), (4, 7, 5, 0), (6, 5, 7, 2)),
    ((3, 1, 6, 4), (3, 0, 1, 4), (3, 1, 2, 6), (4, 6, 5, 1), (6, 4, 7, 3)),
)


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


@dataclass(frozen=True)
class DiskQuads:
    """A disk of quadrilaterals: a square in the middle and rings around it.

    Attributes:
        chart: vertices in the unit disk, shape (v,).
        quads: counter-clockwise in the chart, shape (q, 4).
        colour: 0 or 1; every edge joins both, so that diagonals between vertices of colour 0 agree across cells.
        rim: vertices on the rim, counter-clockwise.
        mirror: the vertex at the complex conjugate of each.
    """

    chart: Complex
    quads: Index
    colour: Index
    rim: Index
    mirror: Index


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


def disk_quads(across: int, along: int, rings: int) -> DiskQuads:
    """Return a graded disk of quadrilaterals, symmetric under conjugation.

    Raises:
        DermisError: an odd or too small number of cells (the mirror plane needs vertices on it), no rings.
    """
    for label, cells in (("across", across), ("along", along)):
        if cells < 2 or cells % 2:
            what = f"cells {label} the pad must be even"
            raise DermisError(what, where="fingertip mesh", value=cells, limit="2, 4, 6 ...")
    if rings < 1:
        raise DermisError("too few rings", where="fingertip mesh", value=rings, limit=">= 1")
    n, m = across, along
    # Rows run along the finger (real part: towards the cut end), columns across it.
    real, imag = np.meshgrid(np.linspace(-1.0, 1.0, m + 1), np.linspace(-1.0, 1.0, n + 1), indexing="ij")
    half = 0.5 * (PAD_BACK + PAD_FRONT)
    middle = 0.5 * (PAD_BACK - PAD_FRONT)
    block = middle + half * real * (1 + PAD_BULGE * (1 - imag**2))
    block = block + 1j * PAD_HALF * imag * (1 + PAD_BULGE * (1 - real**2))
    inner = (m + 1) * (n + 1)
    number = np.arange(inner, dtype=np.int32).reshape(m + 1, n + 1)
    around = np.concatenate([number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]])
    border = block.ravel()[around]
    length = len(around)

    # The rim is divided evenly between the angles of the block's corners.
    back, front = np.arctan2(PAD_HALF, PAD_BACK), np.pi - np.arctan2(PAD_HALF, PAD_FRONT)
    angle = np.concatenate([
        np.linspace(-front, -back, m + 1)[:-1], np.linspace(-back, back, n + 1)[:-1],
        np.linspace(back, front, m + 1)[:-1], np.linspace(front, 2 * np.pi - front, n + 1)[:-1],
    ])  # fmt: skip
    rim = np.exp(1j * angle)
    first = 2.0 * half / m / (1.0 - PAD_BACK)
    steps = np.cumsum(_growth(first, rings) ** np.arange(rings))
    outer = border[None] + (steps / steps[-1])[:, None] * (rim - border)[None]
    chart = np.concatenate([block.ravel(), outer.ravel()])

    loops = np.concatenate([around[None], inner + np.arange(rings * length).reshape(rings, -1)]).astype(np.int32)
    inner_quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    ring_quads = np.stack(
        [loops[:-1], loops[1:], np.roll(loops[1:], -1, axis=1), np.roll(loops[:-1], -1, axis=1)], axis=-1
    ).reshape(-1, 4)
    quads = np.concatenate([inner_quads, ring_quads]).astype(np.int32)

    i, j = np.divmod(np.arange(inner), n + 1)
    ring, place = np.divmod(np.arange(rings * length), length)
    colour = np.concatenate([i + j, place + ring + 1]) % 2
    # A loop starts at the front left corner, goes back, across, forward and across: conjugation reverses it about
    # the middle of the back side.
    reflected = (2 * m + n - place) % length
    mirror = np.concatenate([i * (n + 1) + n - j, inner + ring * length + reflected])
    return DiskQuads(chart, quads, colour.astype(np.int32), loops[-1], mirror.astype(np.int32))


def _growth(first: float, count: int) -> float:
    """Return the ratio of a geometric series of `count` terms, the first `first`, that sums to 1."""
    low, high = 0.5, 10.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        if first * float(np.sum(middle ** np.arange(count))) < 1.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def mirrored(points: Array, mirror: Index) -> Array:
    """Return points made exactly symmetric in x, so that rounding cannot tell left from right."""
    other = points[mirror] * np.array([-1.0, 1.0, 1.0])
    return 0.5 * (points + other)


def split_quads(quads: Index, colour: NDArray[np.integer]) -> Index:
    """Split quadrilaterals along the diagonal between vertices of colour 0, shape (2 q, 3)."""
    even = colour[quads[:, 0]] == 0
    a, b, c, d = quads.T
    first = np.where(even[:, None], np.stack([a, b, c], 1), np.stack([a, b, d], 1))
    second = np.where(even[:, None], np.stack([a, c, d], 1), np.stack([b, c, d], 1))
    return np.concatenate([first, second]).astype(np.int32)


def split_hexahedra(hexahedra: Index, colour: NDArray[np.integer]) -> Index:
    """Split hexahedra into five tetrahedra each, conforming where `colour` is a two-colouring of the edges' ends."""
    even = colour[hexahedra[:, 0]] == 0
    out = np.empty((len(hexahedra), 5, 4), np.int32)
    out[even] = hexahedra[even][:, np.array(_SPLIT[0])]
    out[~even] = hexahedra[~even][:, np.array(_SPLIT[1])]
    return out.reshape(-1, 4)


def tetra_volumes(nodes: Array, tetrahedra: Index) -> Array:
    """Return the signed volume of tetrahedra [m^3], shape (e,)."""
    a, b, c, d = (nodes[tetrahedra[:, i]] for i in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0


def boundary_faces(tetrahedra: Index) -> Index:
    """Return the faces that belong to one tetrahedron only, counter-clockwise from outside, shape (b, 3)."""
    faces = tetrahedra[:, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]].reshape(-1, 3)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return faces[np.sort(first[count == 1])].astype(np.int32)

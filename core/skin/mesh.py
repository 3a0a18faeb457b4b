"""TetraMesh, and the graded mesh of a fingertip: a shell of hexahedra from bone to skin, each split into five."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError
from .shape import FingertipShape

Array = NDArray[np.float64]
Index = NDArray[np.int32]
Complex = NDArray[np.complex128]

PAD_SIZE = 0.21  # half size of the fine square at the pad, as a fraction of the chart's radius
PAD_BULGE = 0.12  # bows the square's sides outward, so that its corners have 117 degrees, near the ideal 120
DEPTH_GROWTH = 2.6  # thickness of the layer at the bone over that at the skin
PAD_TILT = -0.1  # skin whose outward normal has a smaller Z may touch

# Five tetrahedra of a hexahedron whose vertices 0, 2, 5, 7 (first) or 1, 3, 4, 6 (second) are of the even colour.
_SPLIT = (
    ((0, 2, 7, 5), (1, 2, 0, 5), (3, 0, 2, 7), (4, 7, 5, 0), (6, 5, 7, 2)),
    ((3, 1, 6, 4), (3, 0, 1, 4), (3, 1, 2, 6), (4, 6, 5, 1), (6, 4, 7, 3)),
)


@dataclass(frozen=True)
class Level:
    """How fine a mesh is: cells across the pad (even), rings from the pad to the cut end, layers from bone to skin."""

    across: int
    rings: int
    layers: int

    @property
    def tetrahedra(self) -> int:
        """Number of tetrahedra."""
        return 5 * self.layers * self.across * (self.across + 4 * self.rings)


LEVELS: dict[str, Level] = {
    "draft": Level(6, 3, 3),
    "standard": Level(10, 5, 4),
    "fine": Level(16, 8, 7),
    "reference": Level(24, 12, 10),
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
        level: 'draft' (about 1.4k tetrahedra), 'standard' (6k), 'fine' (27k), 'reference' (88k), or a `Level`.

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
    disk = disk_quads(level.across, level.rings)
    count = len(disk.chart)
    skin, bone = (mirrored(surface, disk.mirror) for surface in (shape.skin(disk.chart), shape.bone(disk.chart)))
    depth = np.linspace(1.0, 0.0, level.layers + 1)
    share = 1.0 - np.expm1(np.log(DEPTH_GROWTH) * depth) / (DEPTH_GROWTH - 1.0)
    nodes = (bone[None] + share[:, None, None] * (skin - bone)[None]).reshape(-1, 3)

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


def disk_quads(across: int, rings: int) -> DiskQuads:
    """Return a graded disk of quadrilaterals, symmetric under conjugation.

    Raises:
        DermisError: `across` is odd (there would be no vertices on the mirror plane) or below 2, no rings.
    """
    if across < 2 or across % 2:
        raise DermisError("cells across the pad must be even", where="fingertip mesh", value=across, limit="2, 4, 6 ...")
    if rings < 1:
        raise DermisError("too few rings", where="fingertip mesh", value=rings, limit=">= 1")
    n = across
    line = np.linspace(-1.0, 1.0, n + 1)
    # Rows run along the finger (real part: towards the cut end), columns across it.
    real, imag = np.meshgrid(line, line, indexing="ij")
    square = PAD_SIZE * (real * (1 + PAD_BULGE * (1 - imag**2)) + 1j * imag * (1 + PAD_BULGE * (1 - real**2)))
    number = np.arange((n + 1) ** 2, dtype=np.int32).reshape(n + 1, n + 1)
    around = np.concatenate([number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]])
    start = -0.75 * np.pi
    circle = np.exp(1j * (start + 0.5 * np.pi * np.arange(4 * n) / n))
    border = square.ravel()[around]

    first = 2.0 * PAD_SIZE / n / (1.0 - PAD_SIZE * (1 + PAD_BULGE))
    growth = _growth(first, rings)
    steps = np.cumsum(growth ** np.arange(rings))
    shares = steps / steps[-1]
    outer = border[None] + shares[:, None] * (circle - border)[None]
    chart = np.concatenate([square.ravel(), outer.ravel()])

    loops = np.concatenate([around[None], (n + 1) ** 2 + np.arange(rings * 4 * n).reshape(rings, -1)]).astype(np.int32)
    inner_quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    ring_quads = np.stack(
        [loops[:-1], loops[1:], np.roll(loops[1:], -1, axis=1), np.roll(loops[:-1], -1, axis=1)], axis=-1
    ).reshape(-1, 4)
    quads = np.concatenate([inner_quads, ring_quads]).astype(np.int32)

    i, j = np.divmod(np.arange((n + 1) ** 2), n + 1)
    ring, place = np.divmod(np.arange(rings * 4 * n), 4 * n)
    colour = np.concatenate([i + j, place + ring + 1]) % 2
    mirror = np.concatenate([i * (n + 1) + n - j, (n + 1) ** 2 + ring * 4 * n + _reflect(place, n)])
    return DiskQuads(chart, quads, colour.astype(np.int32), loops[-1], mirror.astype(np.int32))


def _reflect(place: NDArray[np.integer], n: int) -> NDArray[np.integer]:
    """Return the place on a loop of 4 n vertices that conjugation takes each to: angle -3/4 pi + q to 3/4 pi - q."""
    return (3 * n - place) % (4 * n)


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

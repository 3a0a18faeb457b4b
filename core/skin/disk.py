"""DiskQuads: disk of quadrilaterals in the chart of a fingertip.

The quadrilaterals are finest at the pad.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices32
from ..errors import DermisError

Complex = NDArray[np.complex128]

# Fine block in the chart, which is a disk of radius 1. PAD_HALF is half the width of the block. PAD_BACK is its length
# from the pad's centre backwards, and PAD_FRONT that from the centre forwards over the tip.
PAD_HALF, PAD_BACK, PAD_FRONT = 0.17, 0.19, 0.26
PAD_BULGE = 0.10  # outward bow of the block's sides, so that its corners are nearer to the ideal 120 degrees

# Vertices of the five tetrahedra of a hexahedron. In the first row, the vertices 0, 2, 5 and 7 of the hexahedron have
# colour 0. In the second row, the vertices 1, 3, 4 and 6 have colour 0.
_SPLIT = (
    ((0, 2, 7, 5), (1, 2, 0, 5), (3, 0, 2, 7), (4, 7, 5, 0), (6, 5, 7, 2)),
    ((3, 1, 6, 4), (3, 0, 1, 4), (3, 1, 2, 6), (4, 6, 5, 1), (6, 4, 7, 3)),
)


@dataclass(frozen=True)
class DiskQuads:
    """Disk of quadrilaterals: a block in the middle, and rings around it.

    Attributes:
        chart: vertices in the unit disk, as complex numbers, shape (v,).
        quads: vertices of each quadrilateral, counter-clockwise in the chart, shape (q, 4).
        colour: 0 or 1 for each vertex, shape (v,). The ends of each edge differ in colour, so that diagonals between
            vertices of colour 0 match in adjacent cells.
        rim: indices of the vertices on the rim, counter-clockwise, shape (r,).
        mirror: index of the mirror image of each vertex, its complex conjugate, shape (v,).
    """

    chart: Complex
    quads: Indices32
    colour: Indices32
    rim: Indices32
    mirror: Indices32


def disk_quads(across: int, along: int, rings: int) -> DiskQuads:
    """Return a graded disk of quadrilaterals.

    The disk is symmetric under complex conjugation.

    Args:
        across, along: numbers of cells of the block across and along the finger. Both must be even, so that vertices
            lie in the mirror plane.
        rings: number of rings around the block.

    Raises:
        DermisError: a number of cells is odd or below 2, or there are no rings.
    """
    for label, cells in (("across", across), ("along", along)):
        if cells < 2 or cells % 2:
            what = f"cells {label} the pad must be even"
            raise DermisError(what, where="fingertip mesh", value=cells, limit="2, 4, 6 ...")
    if rings < 1:
        raise DermisError("too few rings", where="fingertip mesh", value=rings, limit=">= 1")
    n, m = across, along
    # Rows of the block run along the finger, and columns across it. The real part increases towards the cut end.
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
    angle = np.concatenate(
        [
            np.linspace(-front, -back, m + 1)[:-1],
            np.linspace(-back, back, n + 1)[:-1],
            np.linspace(back, front, m + 1)[:-1],
            np.linspace(front, 2 * np.pi - front, n + 1)[:-1],
        ]
    )
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
    # A loop starts at the front left corner and goes back, across, forward and across. Conjugation reverses the loop
    # about the middle of the back side.
    reflected = (2 * m + n - place) % length
    mirror = np.concatenate([i * (n + 1) + n - j, inner + ring * length + reflected])
    return DiskQuads(chart, quads, colour.astype(np.int32), loops[-1], mirror.astype(np.int32))


def _growth(first: float, count: int) -> float:
    """Return the ratio of a geometric series with the sum 1.

    Args:
        first: first term.
        count: number of terms.
    """
    low, high = 0.5, 10.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        if first * float(np.sum(middle ** np.arange(count))) < 1.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def mirrored(points: Array, mirror: Indices32) -> Array:
    """Return points that are exactly symmetric in x, shape (v, 3).

    Args:
        points: points that are symmetric except for rounding, shape (v, 3).
        mirror: index of the mirror image of each point, shape (v,).
    """
    other = points[mirror] * np.array([-1.0, 1.0, 1.0])
    return 0.5 * (points + other)


def split_quads(quads: Indices32, colour: NDArray[np.integer]) -> Indices32:
    """Split quadrilaterals into triangles, shape (2 q, 3).

    They are split along the diagonal between vertices of colour 0.

    Args:
        quads: vertices of each quadrilateral, shape (q, 4).
        colour: 0 or 1 for each vertex, shape (v,).
    """
    even = colour[quads[:, 0]] == 0
    a, b, c, d = quads.T
    first = np.where(even[:, None], np.stack([a, b, c], 1), np.stack([a, b, d], 1))
    second = np.where(even[:, None], np.stack([a, c, d], 1), np.stack([b, c, d], 1))
    return np.concatenate([first, second]).astype(np.int32)


def split_hexahedra(hexahedra: Indices32, colour: NDArray[np.integer]) -> Indices32:
    """Split hexahedra into five tetrahedra each, shape (5 h, 4).

    The result is conforming if the ends of each edge differ in `colour`.

    Args:
        hexahedra: vertices of each hexahedron, shape (h, 8).
        colour: 0 or 1 for each vertex, shape (v,).
    """
    even = colour[hexahedra[:, 0]] == 0
    out = np.empty((len(hexahedra), 5, 4), np.int32)
    out[even] = hexahedra[even][:, np.array(_SPLIT[0])]
    out[~even] = hexahedra[~even][:, np.array(_SPLIT[1])]
    return out.reshape(-1, 4)

"""Hexahedra of a fingertip, graded towards the place where a shape touches it. Lengths in mm.

A square in the middle of the fingertip's chart carries a tensor grid, rings lead from its border to the cut end, and
layers lead from the skin to the bone. All sizes follow from a `Grading` times one scale, growth included: half the
scale halves every element, so that meshes of a family converge.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from core.skin.shape import FingertipShape

Array = NDArray[np.float64]
Chart = NDArray[np.complex128]
Index = NDArray[np.int64]

BACK, FRONT, SIDE = 0.19, 0.26, 0.17  # of the square in the chart: towards the palm, the tip and the sides
BULGE = 0.10  # of its sides, outwards, over its half width
RINGS, RING_POWER = 8.0, 1.25  # round it at a scale of 1, and how they widen
POINTS = 8  # on a side of a face, where the nail's border is looked for
SIDEWALL = 8.0  # the skin above this height touches nothing [mm]
LOOKED = 4_001  # places along a line where its sizes are looked up
CORNERS = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], float
)
GAUSS = CORNERS / np.sqrt(3.0)
NEWTON, TRIED = 12, 600  # steps to a place within an element, and elements that are tried
INSIDE = 1.0 + 1e-6


@dataclass(frozen=True)
class Grading:
    """Sizes of elements along one direction [mm], at a scale of 1.

    Attributes:
        even: size about the places. half: half width of the part of even size about each.
        places: from the shape's origin. growth: of the size over the distance from there. most: largest size.
    """

    even: float
    half: float
    places: tuple[float, ...] = (0.0,)
    growth: float = 0.3
    most: float = 1.2

    def size(self, at: Array) -> Array:
        """Return the sizes at places along the direction, shape (n,)."""
        apart = np.abs(at[:, None] - np.array(self.places)).min(axis=1)
        return np.minimum(self.even + self.growth * np.maximum(apart - self.half, 0.0), self.most)

    def divided(self, lengths: Array, origin: float, scale: float) -> Array:
        """Return which of some rising lengths along a line to cut it at, as (fractional) indices.

        One cut is at the origin, unless that is beyond the ends.
        """
        density = 1.0 / (scale * self.size(lengths - origin))
        count = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(lengths) * (density[1:] + density[:-1]))])
        middle = float(np.interp(origin, lengths, count))
        cuts = [0.0]
        for low, high in ((0.0, middle), (middle, count[-1])):
            if high - low > 1e-9:
                cuts += list(np.linspace(low, high, max(int(np.ceil(high - low - 1e-6)), 1) + 1)[1:])
        return np.interp(cuts, count, np.arange(len(lengths)))


@dataclass(frozen=True)
class Gradings:
    """Sizes across the finger (X), along it (Y) and below the skin."""

    across: Grading
    along: Grading
    below: Grading


@dataclass(frozen=True, eq=False)
class HexMesh:
    """Hexahedra of eight nodes.

    Attributes:
        nodes: [mm], shape (n, 3). elements: in the order of `CORNERS`, shape (e, 8).
        held: which nodes do not move, shape (n,). pad: nodes of the skin that may be touched, rising.
        half: it is the half at positive x of a symmetric finger.
        bed: springs on the skin that the nail's border runs through, for a stiffness of 1 N/mm^3, sparse (3 n, 3 n).
    """

    nodes: Array
    elements: Index
    held: NDArray[np.bool_]
    pad: Index
    half: bool = False
    bed: csr_array | None = None

    def __repr__(self) -> str:
        return f"{len(self.nodes)} nodes, {len(self.elements)} hexahedra"

    @property
    def cut(self) -> NDArray[np.bool_]:
        """Which nodes lie on the mirror plane of a half, shape (n,)."""
        return (self.nodes[:, 0] == 0.0) & self.half

    def slopes(self, elements: Index, at: Array) -> tuple[Array, Array]:
        """Return gradients of the shape functions [1/mm], shape (e, q, 8, 3), and Jacobians [mm^3], shape (e, q).

        Args:
            elements: rows of corners, shape (e, 8). at: natural coordinates, shape (q, 3).
        """
        along = shape_slopes(at)
        jacobian = np.einsum("eai,qak->eqik", self.nodes[elements], along)
        return np.einsum("qak,eqki->eqai", along, np.linalg.inv(jacobian)), np.linalg.det(jacobian)

    def locate(self, points: Array) -> tuple[Index, Array]:
        """Return the element that holds each point [mm] and its natural coordinates there, shape (p, 3).

        Raises:
            ValueError: a point is in none.
        """
        from scipy.spatial import cKDTree

        element, at = np.full(len(points), -1), np.zeros((len(points), 3))
        count = min(TRIED, len(self.elements))
        _, near = cKDTree(self.nodes[self.elements].mean(axis=1)).query(points, k=count)
        for tried in near.reshape(len(points), count).T:
            left = np.flatnonzero(element < 0)
            corners, own = self.nodes[self.elements[tried[left]]], np.zeros((len(left), 3))
            for _ in range(NEWTON):
                off = points[left] - np.einsum("pa,pai->pi", shape_values(own), corners)
                jacobian = np.einsum("pai,pak->pik", corners, shape_slopes(own))
                own = np.clip(own + np.linalg.solve(jacobian, off[..., None])[..., 0], -3.0, 3.0)
            found = np.abs(own).max(axis=1) < INSIDE
            element[left[found]], at[left[found]] = tried[left[found]], own[found]
            if (element >= 0).all():
                return element, at
        raise ValueError("a point lies outside the tissue")


def shape_values(at: Array) -> Array:
    """Return the eight shape functions at natural coordinates, shape (q, 3) to (q, 8)."""
    return np.prod(1.0 + at[:, None] * CORNERS, axis=2) / 8.0


def shape_slopes(at: Array) -> Array:
    """Return their slopes along the natural coordinates, shape (q, 3) to (q, 8, 3)."""
    sides = 1.0 + at[:, None] * CORNERS
    return np.stack([CORNERS[:, k] * np.delete(sides, k, axis=2).prod(axis=2) for k in range(3)], axis=2) / 8.0


def places(shape: FingertipShape, chart: Chart, share: Array | float) -> Array:
    """Return places in the tissue [mm], from the bone (share 0) to the skin (1), shape (n, 3)."""
    skin, bone = shape.skin(chart), shape.bone(chart)
    return 1e3 * (bone + np.asarray(share)[..., None] * (skin - bone))


def chart_below(shape: FingertipShape, x: Array, y: Array) -> Chart:
    """Return the points of the chart whose skin is at x and y [mm], by Newton's method."""
    chart, step = np.zeros(len(x), complex), 1e-6
    for _ in range(50):
        at = places(shape, chart, 1.0)[:, :2]
        real, imag = ((places(shape, chart + d, 1.0)[:, :2] - at) / step for d in (step, 1j * step))
        off = np.stack([x, y], axis=1) - at
        det = real[:, 0] * imag[:, 1] - real[:, 1] * imag[:, 0]
        along = (off[:, 0] * imag[:, 1] - off[:, 1] * imag[:, 0]) / det
        chart += along + 1j * (real[:, 0] * off[:, 1] - real[:, 1] * off[:, 0]) / det
    return chart


def in_square(real: Array, imag: Array) -> Chart:
    """Return the chart's points for coordinates of the bulged square, both from -1 to 1."""
    middle, half = 0.5 * (BACK - FRONT), 0.5 * (BACK + FRONT)
    return middle + half * real * (1.0 + BULGE * (1.0 - imag**2)) + 1j * SIDE * imag * (1.0 + BULGE * (1.0 - real**2))


def graded_fingertip(
    shape: FingertipShape, gradings: Gradings, sideways: float, scale: float, *, half: bool
) -> HexMesh:
    """Return the mesh of a fingertip.

    Args:
        sideways: x of the shape's origin, about which `gradings` are [mm]. scale: of all sizes.
        half: only the half at positive x; `sideways` is then zero.

    Raises:
        RuntimeError: an element is inverted.
    """
    origin = chart_below(shape, np.array([sideways]), np.zeros(1))[0]
    real, imag = _square_of(origin)
    line = np.linspace(-1.0, 1.0, LOOKED)
    rows = _cut(shape, lambda t: in_square(t, np.full(len(t), imag)), line, real, gradings.along, scale, 1)
    cross = np.linspace(-1.0, 0.0, LOOKED) if half else line
    columns = _cut(shape, lambda t: in_square(np.full(len(t), real), t), cross, imag, gradings.across, scale, 0)
    chart, quads = _chart(rows, columns, max(round(RINGS / scale), 1), half)
    depths = np.linspace(0.0, 1e3 * shape.pulp, LOOKED)
    share = 1.0 - np.interp(gradings.below.divided(depths, 0.0, scale), np.arange(LOOKED), depths) / depths[-1]
    skin, count = places(shape, chart, 1.0), len(chart)
    nodes = np.concatenate([places(shape, chart, np.full(count, part)) for part in share])
    number = np.arange(len(share) - 1)[:, None, None] * count
    elements = np.concatenate([quads + number + count, quads + number], axis=2).reshape(-1, 8)  # the deeper face first
    under = _covered(shape, chart, quads)
    held = np.zeros(len(nodes), bool)
    held[-count:], held[quads[under.all(axis=1)]] = True, True
    if half:
        nodes[np.tile(chart.imag == 0.0, len(share)), 0] = 0.0
    bed = _springs(nodes, quads, under)
    mesh = HexMesh(nodes, elements, held, np.flatnonzero(~held[:count] & (skin[:, 2] < SIDEWALL)), half, bed)
    if (mesh.slopes(elements, GAUSS)[1] <= 0.0).any():
        raise RuntimeError("the mesh has inverted elements")
    return mesh


def _covered(shape: FingertipShape, chart: Chart, quads: Index) -> NDArray[np.bool_]:
    """Return which points of each face of the skin, a grid on it, are under the nail, shape (q, POINTS ** 2)."""
    inside = np.einsum("pa,qa->qp", _face_values(), chart[quads])
    return shape.under_nail(shape.skin(inside))


def _face_values() -> Array:
    """Return the shape functions of a face at the grid on it, shape (POINTS ** 2, 4)."""
    along = (2.0 * np.arange(POINTS) + 1.0) / POINTS - 1.0
    x, y = (a.ravel() for a in np.meshgrid(along, along))
    return 0.25 * np.stack([(1 + a * x) * (1 + b * y) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))], axis=1)


def _springs(nodes: Array, quads: Index, under: NDArray[np.bool_]) -> csr_array:
    """Return the springs of faces of which only a part is under the nail: the nail's border is where it is.

    Were it where nodes are, the force on a finger would differ by half a percent from mesh to mesh.
    """
    part = quads[under.any(axis=1) & ~under.all(axis=1)]
    share = under[under.any(axis=1) & ~under.all(axis=1)] / POINTS**2
    across = np.cross(nodes[part[:, 2]] - nodes[part[:, 0]], nodes[part[:, 3]] - nodes[part[:, 1]])
    area = 0.5 * np.linalg.norm(across, axis=1)
    own = np.einsum("q,qp,pa,pb->qab", area, share, _face_values(), _face_values(), optimize=True)
    rows = np.broadcast_to(part[:, :, None], own.shape), np.broadcast_to(part[:, None], own.shape)
    out = csr_array((nodes.size, nodes.size))
    for axis in range(3):
        at = tuple((3 * row + axis).ravel() for row in rows)
        out = out + coo_array((own.ravel(), at), shape=(nodes.size, nodes.size)).tocsr()
    return out


def _square_of(chart: complex) -> tuple[float, float]:
    """Return the square's coordinates of a point of the chart."""
    real = imag = 0.0
    for _ in range(50):
        real = (chart.real - 0.5 * (BACK - FRONT)) / (0.5 * (BACK + FRONT) * (1.0 + BULGE * (1.0 - imag**2)))
        imag = chart.imag / (SIDE * (1.0 + BULGE * (1.0 - real**2)))
    return real, imag


def _cut(
    shape: FingertipShape,
    chart: Callable[[Array], Chart],
    line: Array,
    origin: float,
    grading: Grading,
    scale: float,
    axis: int,
) -> Array:
    """Return where to cut a line of the square, graded by its length on the skin from the origin."""
    on_skin = places(shape, chart(line), 1.0)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(on_skin, axis=0), axis=1))])
    start = float(np.interp(origin, line, length))
    towards = 1.0 if on_skin[-1, axis] > on_skin[0, axis] else -1.0  # so that places have the sign of x and y
    signed = replace(grading, places=tuple(towards * place for place in grading.places))
    cuts = np.interp(signed.divided(length, start, scale), np.arange(len(line)), line)
    cuts[np.abs(cuts) < 1e-12] = 0.0
    return cuts


def _chart(rows: Array, columns: Array, rings: int, half: bool) -> tuple[Chart, Index]:
    """Return the nodes in the chart, and quadrilaterals of them: of the square, then of the rings."""
    real, imag = np.meshgrid(rows, columns, indexing="ij")
    square = in_square(real, imag)
    number = np.arange(square.size).reshape(square.shape)
    inner = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    back, front = np.arctan2(SIDE, BACK), np.pi - np.arctan2(SIDE, FRONT)
    by_row, by_column = 0.5 * (rows + 1.0), columns
    low = -front + by_row * (front - back)  # angles of the sides, on the rim
    if half:
        path = np.concatenate([number[0, :0:-1], number[:-1, 0], number[-1]])
        angle = np.concatenate([-np.pi - by_column[:0:-1] * (np.pi - front), low[:-1], back * by_column])
    else:
        path = np.concatenate([number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]])
        behind = np.pi + by_column[:0:-1] * (front - np.pi)
        angle = np.concatenate([low[:-1], back * by_column[:-1], -low[:0:-1], behind])
    border = square.ravel()[path]
    out = (np.arange(1, rings + 1) / rings)[:, None] ** RING_POWER
    around = border + out * (np.exp(1j * angle) - border)
    if half:
        around[:, [0, -1]] = around[:, [0, -1]].real
    loops = np.concatenate([path[None], square.size + np.arange(around.size).reshape(around.shape)])
    if not half:
        loops = np.concatenate([loops, loops[:, :1]], axis=1)
    outer = np.stack([loops[:-1, :-1], loops[1:, :-1], loops[1:, 1:], loops[:-1, 1:]], axis=-1).reshape(-1, 4)
    chart = np.concatenate([square.ravel(), around.ravel()])
    return chart, np.concatenate([inner, outer])

"""Hexahedra of a fingertip, graded towards the place where a shape touches it. Lengths in mm.

A square in the middle of the fingertip's chart carries a tensor grid, rings lead from its border to the cut end, and
layers lead from the skin to the bone. All sizes follow from a `Grading` times one scale, growth included: a mesh of half
the scale halves every element, so that what changes between meshes is their error.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.skin.shape import FingertipShape

Array = NDArray[np.float64]
Chart = NDArray[np.complex128]
Index = NDArray[np.int64]

BACK, FRONT, SIDE = 0.19, 0.26, 0.17  # of the square in the chart: towards the palm, the tip and the sides
BULGE = 0.10  # of its sides, outwards, over its half width
RINGS, RING_POWER = 3.0, 1.25  # round it at a scale of 1, and how they widen
SIDEWALL = 8.0  # the skin above this height touches nothing [mm]
LOOKED = 4_001  # places along a line where its sizes are looked up
CORNERS = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], float
)
GAUSS = CORNERS / np.sqrt(3.0)
NEWTON, TRIED = 12, 24  # steps to a place within an element, and elements that are tried
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
    """

    nodes: Array
    elements: Index
    held: NDArray[np.bool_]
    pad: Index
    half: bool = False

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

        _, near = cKDTree(self.nodes[self.elements].mean(axis=1)).query(points, k=TRIED)
        element, at, out = np.zeros(len(points), np.int64), np.zeros((len(points), 3)), np.full(len(points), np.inf)
        for tried in near.T:
            corners, own = self.nodes[self.elements[tried]], np.zeros((len(points), 3))
            for _ in range(NEWTON):
                off = points - np.einsum("pa,pai->pi", shape_values(own), corners)
                jacobian = np.einsum("pai,pak->pik", corners, shape_slopes(own))
                own = np.clip(own + np.linalg.solve(jacobian, off[..., None])[..., 0], -3.0, 3.0)
            beyond = np.abs(own).max(axis=1)
            better = beyond < out - 1e-9
            element[better], at[better], out[better] = tried[better], own[better], beyond[better]
            if (out < INSIDE).all():
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
    under = shape.under_nail(1e-3 * skin)
    held = np.zeros(len(nodes), bool)
    held[-count:], held[:count] = True, under
    if half:
        nodes[np.tile(chart.imag == 0.0, len(share)), 0] = 0.0
    mesh = HexMesh(nodes, elements, held, np.flatnonzero(~under & (skin[:, 2] < SIDEWALL)), half)
    if (mesh.slopes(elements, GAUSS)[1] <= 0.0).any():
        raise RuntimeError("the mesh has inverted elements")
    return mesh


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
    signed = Grading(grading.even, grading.half, tuple(towards * p for p in grading.places), grading.growth, grading.most)
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

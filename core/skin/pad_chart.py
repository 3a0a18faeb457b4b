"""PadChart: the smooth skin of a finger pad, with a tree of cells over it.

The nodes of a fingertip's mesh are a millimetre apart. Contact with an edge or the rim of a coin requires a finer
resolution. The smooth surface of the fingertip can be evaluated at any point, so its cells can be as small as needed.

The chart gives each point of the surface two coordinates: a position along the finger and an angle around it. They are
chosen such that squares of the chart are nearly square on the skin: `FingertipShape.skin` is applied to a function of
the exponential of a complex number, whose real and imaginary part are the coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..errors import DermisError
from .mesh import PAD_TILT
from .shape import FingertipShape
from .tiles import Tiles

CELL_SIDES = (0.8e-3, 0.4e-3, 0.2e-3, 0.1e-3)  # nominal sides of the cells of each level [m]
# The cells of level 0 are made by splitting larger squares, which have this many times their side. Squares of the chart
# are smaller on the skin towards the tip, so they are split less often there.
ROOTS = 8
LARGEST = 1.2  # largest side of a cell of level 0, relative to the nominal side
CUT_MARGIN = 2.0e-3  # margin at the cut end that does not belong to the pad [m], as in meshes
# Shapes of the arrays of a chart with n cells, see `PadChart.tables`; None stands for any length.
TABLES: Mapping[str, tuple[int | None, ...]] = {
    "places": (None, 2),
    "halves": (None, 2),
    "starts": (None,),
    "beside": (None, 3, 3),
    "positions": (None, 3),
    "normals": (None, 3),
    "sides": (None, 2, 3),
    "areas": (None,),
}
_STEP = 1e-5  # step of numerical derivatives in the chart; truncation and rounding errors are near 1e-10


@dataclass(frozen=True, eq=False)
class Patches:
    """Pieces of the smooth skin, such as the cells of a tree.

    Attributes:
        positions: centres of the pieces [m], shape (n, 3).
        normals: outward unit normals at the centres, shape (n, 3).
        sides: two side vectors of each piece in its tangent plane [m], shape (n, 2, 3).
        areas: areas of the pieces [m^2], shape (n,).
    """

    positions: Array
    normals: Array
    sides: Array
    areas: Array

    def __len__(self) -> int:
        return len(self.areas)

    @cached_property
    def extent(self) -> tuple[Array, Array, Array]:
        """Shorter side, longer side, and root of the area of each piece [m].

        The shape of each is (n,).
        """
        x, y, z = self.sides.reshape(-1, 3).T  # a sum over rows of three numbers takes six times as long
        one, other = np.sqrt(x * x + y * y + z * z).reshape(-1, 2).T
        return np.minimum(one, other), np.maximum(one, other), np.sqrt(self.areas)

    def take(self, index: NDArray[np.integer] | slice) -> Patches:
        """Return some of the pieces."""
        return Patches(self.positions[index], self.normals[index], self.sides[index], self.areas[index])


@dataclass(frozen=True, eq=False)
class PadChart:
    """Pad of a fingertip as a smooth surface with a tree of cells.

    The cells of level 0 come first, then their children in the same order, and so on. Cell i of a level has its four
    children at 4 i to 4 i + 3 of the next level. Bars come after all levels, see `Tiles`.

    Attributes:
        shape: the fingertip.
        places: centres of the cells in the chart, shape (n, 2). The first coordinate is the position along the finger:
            0 at the pad's centre, -y / `shape.tip` behind it, and falling without limit towards the tip. The second is
            the angle around the finger [rad]: 0 at the pad's centre, rising towards -X.
        halves: half the sides of the cells in the chart, shape (n, 2).
        starts: index of the first cell of each level, and of the first bar, length levels + 1.
    """

    shape: FingertipShape
    places: Array
    halves: Array
    starts: tuple[int, ...]

    @classmethod
    def of(cls, shape: FingertipShape, levels: int = len(CELL_SIDES)) -> PadChart:
        """Build the tree of cells of a fingertip's pad.

        Args:
            shape: the fingertip.
            levels: number of levels, 1 to 4.

        Raises:
            DermisError: the number of levels is out of range.
        """
        if not 1 <= levels <= len(CELL_SIDES):
            raise DermisError(
                "the number of levels is out of range", where="pad", value=levels, limit=f"1 to {len(CELL_SIDES)}"
            )
        side = CELL_SIDES[0]
        # The cells are squares on the skin near the pad's centre. A unit of the chart there has the length `tip` along
        # the finger, and the mean half size of the section around it.
        around = 0.25 * shape.width + 0.5 * shape.height_palm
        half = 0.5 * ROOTS * side / np.array([shape.tip, around])
        rows = 1 + np.arange(int(np.ceil((shape.reach + 4.0) / (2 * half[0]))))  # to -4 in the chart, near the tip
        columns = 1 + np.arange(int(np.ceil(0.5 * np.pi / (2 * half[1]))))
        columns = np.concatenate([-columns[::-1], columns - 1])
        a, b = np.meshgrid(shape.reach - (2 * rows - 1) * half[0], (2 * columns + 1) * half[1], indexing="ij")
        places, halves = np.stack([a.ravel(), b.ravel()], axis=1), np.tile(half, (a.size, 1))
        done = []
        while len(places):
            size = np.sqrt(_patches(shape, places, halves).areas)
            small = size <= LARGEST * side
            done.append((places[small], halves[small]))
            places, halves = quarters(places[~small], halves[~small])
        places, halves = (np.concatenate(parts) for parts in zip(*done, strict=True))
        found = _patches(shape, places, halves)
        pad = (found.normals[:, 2] < PAD_TILT) & (found.positions[:, 1] > shape.tip - shape.length + CUT_MARGIN)
        order = np.lexsort((places[pad, 1], -places[pad, 0]))
        tree = [(places[pad][order], halves[pad][order])]
        for _ in range(levels - 1):
            tree.append(quarters(*tree[-1]))
        starts = np.cumsum([0] + [len(level[0]) for level in tree])
        places, halves = (np.concatenate(parts) for parts in zip(*tree, strict=True))
        return cls(shape, *_with_bars(places, halves, starts.tolist()), tuple(starts.tolist()))

    @classmethod
    def restored(cls, shape: FingertipShape, tables: Mapping[str, Array]) -> PadChart:
        """Return the chart of a fingertip from its tables, see `tables`."""
        starts = tuple(int(start) for start in tables["starts"])
        chart = cls(shape, tables["places"], tables["halves"], starts)
        chart.__dict__["cells"] = Patches(*(tables[name] for name in ("positions", "normals", "sides", "areas")))
        chart.__dict__["beside"] = tables["beside"].astype(np.int64)
        return chart

    def tables(self) -> dict[str, Array]:
        """Return the chart as arrays by name in double precision, to be stored.

        They contain the pieces of skin and the neighbours, which take a tenth of a second to compute.
        """
        own = {"places": self.places, "halves": self.halves, "starts": np.array(self.starts), "beside": self.beside}
        named = {**own, **asdict(self.cells)}
        return {name: np.asarray(array, np.float64) for name, array in named.items()}

    def __repr__(self) -> str:
        return f"PadChart({self.starts[1]} cells, {len(self.starts) - 1} levels)"

    @cached_property
    def cells(self) -> Patches:
        """Pieces of skin of all cells and bars."""
        return _patches(self.shape, self.places, self.halves)

    @cached_property
    def tiles(self) -> Tiles:
        """Relations between cells and bars."""
        return Tiles(self.starts)

    @cached_property
    def levels(self) -> NDArray[np.int8]:
        """Level of each cell, shape (n,): 0 for the coarsest, -1 for bars."""
        levels = np.repeat(np.arange(len(self.starts) - 1, dtype=np.int8), np.diff(self.starts))
        return np.concatenate([levels, np.full(len(self.places) - len(levels), -1, np.int8)])

    @cached_property
    def beside(self) -> Indices:
        """Neighbours of each cell of level 0, shape (n, 3, 3); n for none.

        The axes are steps of -1, 0 and 1 along the finger and around it.
        """
        from scipy.spatial import cKDTree

        places, halves = self.places[self.base], self.halves[self.base]
        steps = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1], indexing="ij"), axis=2)
        wanted = (places[:, None, None] + 2.0 * steps * halves[:, None, None]).reshape(-1, 2)
        found = cKDTree(places).query(wanted)[1]
        inside = (np.abs(wanted - places[found]) <= 1.01 * halves[found]).all(axis=1)
        return np.where(inside, found, len(places)).reshape(-1, 3, 3)

    @property
    def base(self) -> Indices:
        """Indices of the cells of level 0, which cover the pad."""
        return np.arange(self.starts[1])

    def children(self, cells: Indices) -> Indices:
        """Return the four children of each cell, shape (n, 4).

        Raises:
            DermisError: a cell has the finest level, or is a bar.
        """
        level = self.levels[cells]
        if len(level) and (level.max() + 2 >= len(self.starts) or level.min() < 0):
            raise DermisError(
                "bars and cells of the finest level have no children", where="pad", value=int(level.max())
            )
        starts = np.array(self.starts)
        first = starts[level + 1] + 4 * (cells - starts[level])
        return first[:, None] + np.arange(4)

    def corners(self, cells: Indices) -> Array:
        """Return the points of the skin at the corners of cells [m], shape (n, 4, 3)."""
        signs = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
        return self.points(self.places[cells][:, None] + signs * self.halves[cells][:, None])

    def points(self, places: Array) -> Array:
        """Return points of the smooth skin [m], shape (n, 3).

        Args:
            places: places of the chart, shape (n, 2).
        """
        return _skin(self.shape, places)

    def surface(self, places: Array) -> Patches:
        """Return pieces of the smooth skin whose sides in the chart are 1.

        Args:
            places: centres of the pieces in the chart, shape (n, 2).
        """
        return _patches(self.shape, places, np.full_like(places, 0.5))

    def project(self, points: Array) -> tuple[Array, Array]:
        """Project points onto the smooth skin, along its normals.

        Args:
            points: points near the pad [m], shape (n, 3).

        Returns:
            Places in the chart of the points' feet, shape (n, 2), and depths of the points below the skin [m], shape
            (n,). The foot of a point is its projection.

        Raises:
            DermisError: the foot of a point is not unique, because the point is too deep or far from the pad.
        """
        from scipy.spatial import cKDTree

        points = np.asarray(points, np.float64)
        places = self.places[cKDTree(self.cells.positions[self.base]).query(points)[1]]
        for _ in range(60):
            foot, along, around = _frame(self.shape, places)
            metric = np.stack([along, around], axis=1)
            gram = metric @ metric.transpose(0, 2, 1)
            step = np.linalg.solve(gram, metric @ (points - foot)[:, :, None])[:, :, 0]
            places = places + np.clip(step, -0.2, 0.2)
            if not len(step) or np.abs(step).max() < 1e-10:
                normals = self.surface(places).normals
                return places, np.einsum("ij,ij->i", self.surface(places).positions - points, normals)
        lost = int(np.abs(step).max(axis=1).argmax())
        raise DermisError(
            "the nearest place of the skin is not unique for a point",
            where="pad",
            value=f"{np.round(points[lost] * 1e3, 3).tolist()} mm",
            remedy="Choose points nearer to the skin of the pad",
        )


def _frame(shape: FingertipShape, places: Array) -> tuple[Array, Array, Array]:
    """Return points of the skin and its derivatives in the chart.

    The derivatives are those along the finger and around it [m]. The shape of all three is (..., 3).
    """

    def slope(along: float, around: float) -> Array:
        return (_skin(shape, places, along, around) - _skin(shape, places, -along, -around)) / (2 * _STEP)

    return _skin(shape, places), slope(_STEP, 0.0), slope(0.0, _STEP)


def _skin(shape: FingertipShape, places: Array, along: float = 0.0, around: float = 0.0) -> Array:
    """Return points of the skin [m], shape (..., 3).

    Args:
        shape: the fingertip.
        places: places of the chart, shape (..., 2).
        along, around: shift of all places along the finger and around it.
    """
    p = np.exp(-shape.reach)
    plane = np.exp(places[..., 0] + along + 1j * (places[..., 1] + around))
    return shape.skin(p * (plane - 1.0) / (1.0 - p * p * plane))


def _patches(shape: FingertipShape, places: Array, halves: Array) -> Patches:
    points, along, around = _frame(shape, places)
    sides = 2 * halves[:, :, None] * np.stack([along, around], axis=1)
    vectors = np.cross(sides[:, 0], sides[:, 1])
    areas = np.linalg.norm(vectors, axis=1)
    return Patches(points, vectors / areas[:, None], sides, areas)


def _with_bars(places: Array, halves: Array, starts: Sequence[int]) -> tuple[Array, Array]:
    tiles = Tiles(starts)
    bars = slice(starts[-1], tiles.count)
    root, parts = tiles.root[bars], 1 << tiles.halved[bars]
    own = halves[root] / parts
    middle = places[root] - halves[root] + (2 * tiles.place[bars] + 1) * own
    return np.concatenate([places, middle]), np.concatenate([halves, own])


def quarters(places: Array, halves: Array) -> tuple[Array, Array]:
    """Return the centres and half sides of the quarters of squares.

    Args:
        places, halves: centres and half sides of the squares in the chart, shape (n, 2) each.

    Returns:
        Centres and half sides of the quarters in the chart, shape (4 n, 2) each.
    """
    signs = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    children = places[:, None] + 0.5 * signs * halves[:, None]
    return children.reshape(-1, 2), np.repeat(0.5 * halves, 4, axis=0)

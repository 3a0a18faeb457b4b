"""First touch: height at which a rising body meets a finger's undeformed skin.

The skin is divided into pieces. The gaps of two points differ by no more than their distance, so the gap at the centre
of a piece bounds that of all its points. Pieces that may contain the smallest gap are divided until it is known
accurately enough.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array, Indices
from ..errors import DermisError
from ..skin.model import SkinModel
from ..skin.pad_chart import PadChart, quarters
from ..surface.gap import Surface
from .solver.bodies import BONE, ContactBody

CLOSE = 1e-6  # accuracy of the gap at first touch [m]; 0.3 % of the force at a penetration of half a millimetre
STRETCH = 1.2  # largest ratio of a piece's true size to that by the metric at its centre
# Largest number of pieces that are divided at once. If a body is almost parallel to the skin, any of them is near
# enough.
MOST_PIECES = 500


@dataclass(frozen=True, eq=False)
class _Squares:
    """Pieces of the smooth skin: squares of the chart.

    Attributes:
        chart: chart of the pad.
        places: centres in the chart, shape (n, 2).
        halves: half the sides in the chart, shape (n, 2).
        sizes: largest distance of a point of each piece from its centre [m], shape (n,).
    """

    chart: PadChart
    places: Array
    halves: Array
    sizes: Array

    @classmethod
    def of(cls, chart: PadChart) -> _Squares:
        """Return the coarsest cells of a chart."""
        cells = chart.cells.take(chart.base)
        a, b = cells.sides[:, 0], cells.sides[:, 1]
        diagonals = np.maximum(np.linalg.norm(a + b, axis=1), np.linalg.norm(a - b, axis=1))
        return cls(chart, chart.places[chart.base], chart.halves[chart.base], 0.5 * STRETCH * diagonals)

    @property
    def middles(self) -> Array:
        """The middle of each piece [m], shape (n, 3)."""
        return self.chart.points(self.places)

    def split(self, some: Indices) -> _Squares:
        """Return the four quarters of some pieces."""
        places, halves = quarters(self.places[some], self.halves[some])
        return _Squares(self.chart, places, halves, np.repeat(0.5 * self.sizes[some], 4))


@dataclass(frozen=True, eq=False)
class _Triangles:
    """Pieces of a mesh's pad: triangles, by their corners [m], shape (n, 3, 3)."""

    corners: Array

    @property
    def middles(self) -> Array:
        """The middle of each piece [m], shape (n, 3)."""
        return self.corners.mean(axis=1)

    @property
    def sizes(self) -> Array:
        """Largest distance of a point of each piece from its centre [m], shape (n,)."""
        return np.linalg.norm(self.corners - self.middles[:, None], axis=2).max(axis=1)

    def split(self, some: Indices) -> _Triangles:
        """Return the four quarters of some pieces."""
        a, b, c = self.corners[some].transpose(1, 0, 2)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        parts = [np.stack(corners, axis=1) for corners in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))]
        return _Triangles(np.concatenate(parts))


def first_touch(skin: SkinModel, body: ContactBody) -> float:
    """Return the height at which a body first meets the undeformed pad from below [m].

    The body rises in steps no longer than the smallest gap, so that it cannot pass through the skin. The result is
    accurate to about `CLOSE`.

    Args:
        skin: model of the skin.
        body: the body; its height does not matter.

    Raises:
        DermisError: the body does not meet the pad.
    """
    assert isinstance(body.surface, Surface)
    pieces = _pieces(skin)
    middles = pieces.middles
    heights = (body.surface.vertices @ body.rotation.T)[:, 2]
    bottom, top = float(heights.min()), float(heights.max())
    # If the whole body is above the pad, it has passed beside it.
    height, highest = float(middles[:, 2].min()) - top - 2e-3, float(middles[:, 2].max()) - bottom
    start = replace(body, translation=np.array([*body.translation[:2], height]))
    side = start.side_of(BONE)
    while height <= highest:
        low, gap = _smallest(pieces, replace(body, translation=np.array([*body.translation[:2], height])), side)
        if gap <= 2.0 * CLOSE:
            return height + 0.5 * gap
        height += low
    raise DermisError(
        "the surface does not meet the pad from below",
        where="surface",
        value=str(body.surface),
        limit="wide enough to meet the pad",
        remedy="Move it with 'at', or make it larger. Lengths are in metres: a millimetre is 1e-3",
    )


def _pieces(skin: SkinModel) -> _Squares | _Triangles:
    if skin.shape is not None:
        return _Squares.of(PadChart.of(skin.shape, 1))
    mesh = skin.mesh
    pad = np.isin(mesh.surface, mesh.pad).all(axis=1)
    return _Triangles(mesh.nodes[mesh.surface[pad]])


def _smallest(pieces: _Squares | _Triangles, body: ContactBody, side: float) -> tuple[float, float]:
    """Return a lower and an upper bound of the smallest gap [m]; they differ by at most half of it, or `CLOSE`.

    Args:
        pieces: pieces of the skin.
        body: the body at its present height.
        side: -1 if an open surface is touched from behind, else 1.
    """
    assert isinstance(body.surface, Surface)
    while True:
        sizes, found = pieces.sizes, body.surface.query(body.local(pieces.middles)[0])
        gaps = (found if side > 0 else found.flipped()).gap  # a point beside a rim is outside on both sides
        most, least = float(gaps.min()), gaps - sizes
        some = np.flatnonzero(least <= most)
        if len(some) > MOST_PIECES:
            some = np.argpartition(least, MOST_PIECES)[:MOST_PIECES]
        if sizes[some].max() <= max(0.5 * most, CLOSE):
            return float(least[some].min()), most
        pieces = pieces.split(some)

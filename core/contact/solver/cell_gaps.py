"""CellGaps: mean gaps over whole cells beside edges.

The force of a cell is distributed over its whole area, and the constraint on its gap should be too. This matters beside
an edge. Skin over an edge is stretched to several times its width, so that the centres of cells slip off to both sides,
and the edge would penetrate between them. The gap of such a cell is therefore the mean along the cell across the edge.
Its normal remains that of the face below its centre. Points may then be twice as far apart for the same accuracy of the
force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from .bodies import ContactBody, Expected, NodeGaps, node_gaps
from .point_gaps import some_of
from .point_set import NONE, PointSet

# The mean gap is used for cells whose normal differs from a neighbour's by more than this length.
TURNED = 0.3
# If the cosine between two normals is below this, they belong to opposite sides of a thin object.
OPPOSITE = -0.7
# Cells that may need the mean gap in the next frame: limit of their gap, relative to that of the present ones, and
# limit of the difference of normals, relative to `TURNED`.
FARTHER, LESS = 1.5, 0.6
LESS_COSINE = 1.0 - 0.5 * (0.999 * LESS * TURNED) ** 2  # cosine of this difference, by which most cells are excluded


@dataclass(frozen=True, eq=False)
class _Turned:
    """Cells beside edges.

    Attributes:
        own: indices of the cells, shape (k,).
        axis: side of each cell that crosses the edge, 0 or 1, shape (k,).
        others: indices of the neighbours before and behind along this side, shape (2, k).
    """

    own: Indices
    axis: Indices
    others: Indices

    def take(self, which: Indices) -> _Turned:
        return _Turned(self.own[which], self.axis[which], self.others[:, which])

    def halves(self, points: Array, places: Array, sides: Array) -> Array:
        """Return the displaced centres of both halves of each cell [m], shape (2, k, 3).

        Args:
            points: centres of all cells at rest [m], shape (n, 3).
            places: displaced centres [m], shape (n, 3).
            sides: side vectors of the cells [m], shape (n, 2, 3).
        """
        own, axis, moved = self.own, self.axis, places - points
        side = sides[own, axis]
        width, out = np.sqrt(np.einsum("ij,ij->i", side, side)), np.empty((2, len(own), 3))
        for k, sign in enumerate((-0.5, 0.5)):
            other = self.others[k]
            step = sides[other, axis]
            share = width / (width + np.sqrt(np.einsum("ij,ij->i", step, step)))
            out[k] = places[own] + 0.5 * (sign * side + share[:, None] * (moved[other] - moved[own]))
        return out


class CellGaps:
    """Measures gaps at the centres of cells, and at the halves of cells beside edges.

    The cells beside edges are known only after the centres are measured, but most are the same as in the last frame.
    Their halves are measured together with the centres, because a query costs more than a few more points in it.

    Args:
        search_radius, bone: as for `node_gaps`.

    Attributes:
        last: cells that were beside edges in the last frame; None if there were none.
    """

    def __init__(self, search_radius: float, bone: Array) -> None:
        self._search_radius, self._bone = search_radius, bone
        self.last: _Turned | None = None
        self._found: tuple[Array, Indices] | None = None

    def renumber(self, order: Indices, count: int) -> None:
        """Renumber the cells.

        Args:
            order: former indices of the cells that stay, in their new order.
            count: former number of cells.
        """
        if self.last is None:
            return
        place = np.full(count, NONE)
        place[order] = np.arange(len(order))
        own, others = place[self.last.own], place[self.last.others]
        kept = ((own != NONE) & (others != NONE).all(axis=0)).nonzero()[0]
        self.last = _Turned(own, self.last.axis, others).take(kept) if len(kept) else None
        self._found = self._found and (self._found[0][:, kept], self._found[1][:, kept])

    def beside_edges(self, some: NDArray[np.bool_]) -> tuple[Indices, Indices]:
        """Return the cells among some points that were beside edges in the last frame.

        Args:
            some: whether each cell is considered, shape (n,).

        Returns:
            Indices of the cells, shape (k,), and of the neighbours of each across the edge, shape (2, k); a cell
            without a neighbour is its own.
        """
        if self.last is None:
            return np.zeros(0, dtype=np.int64), np.zeros((2, 0), dtype=np.int64)
        which = some[self.last.own].nonzero()[0]
        return self.last.own[which], self.last.others[:, which]

    def centres(
        self, points: PointSet, bodies: Sequence[ContactBody], expected: Expected, more: Array
    ) -> tuple[NodeGaps, NodeGaps]:
        """Return the gaps at the expected centres of cells, and at further positions `more` [m], shape (k, 3)."""
        at, last, n = points.positions, self.last, len(points)
        self._found = None
        if last is None and not len(more):
            return node_gaps(at, bodies, self._search_radius, self._bone, expected), NodeGaps.nothing(tuple(bodies), 0)
        halves = more[:0] if last is None else last.halves(at, expected.places, points.sides).reshape(-1, 3)
        beside = np.concatenate([halves, more])
        none = np.zeros((len(beside), 3))
        both = Expected(
            np.concatenate([expected.places, beside]),
            np.concatenate([expected.origins, none]),
            np.concatenate([expected.normal, none]),
            np.concatenate([expected.body, np.full(len(beside), -1)]),
        )
        gaps = node_gaps(np.concatenate([at, beside]), bodies, self._search_radius, self._bone, both)
        k = n + len(halves)
        self._found = gaps.clearance[n:k].reshape(2, -1), gaps.body[n:k].reshape(2, -1)
        return some_of(gaps, slice(0, n)), some_of(gaps, slice(k, None))

    def over(self, gaps: NodeGaps, points: PointSet, places: Array) -> NodeGaps:
        """Replace the gaps of cells beside edges by means over these cells.

        Args:
            gaps: gaps at the cells' centres.
            points: the cells.
            places: displaced positions at which they were measured [m], shape (n, 3).
        """
        near, touching = _turned(gaps, points.sides, points.beside)
        last, found = self.last, self._found
        self.last, self._found = (near if len(near.own) else None), None
        turned = near.take(touching)
        own = turned.own
        if not len(own):
            return gaps
        clearance, body, new = np.empty((2, len(own))), np.empty((2, len(own)), dtype=np.int64), np.arange(len(own))
        if last is not None and found is not None:
            place = np.full(len(places), -1)
            place[last.own] = np.arange(len(last.own))
            known = (place[own] >= 0) & (last.axis[place[own]] == turned.axis)
            known &= (last.others[:, place[own]] == turned.others).all(axis=0)
            for told, values in zip((clearance, body), found, strict=True):
                told[:, known] = values[:, place[own[known]]]
            new = (~known).nonzero()[0]
        if len(new):
            halves = turned.take(new).halves(points.positions, places, points.sides).reshape(-1, 3)
            more = node_gaps(halves, gaps.bodies, self._search_radius, self._bone)
            clearance[:, new], body[:, new] = more.clearance.reshape(2, -1), more.body.reshape(2, -1)
        nearer = clearance.mean(axis=0) - gaps.clearance[own]
        told = (body == gaps.body[own]).all(axis=0).nonzero()[0]
        out = replace(gaps, gap=gaps.gap.copy(), clearance=gaps.clearance.copy())
        out.clearance[own[told]] += nearer[told]
        out.gap[own[told]] += nearer[told]
        return out


def _turned(gaps: NodeGaps, sides: Array, beside: Indices) -> tuple[_Turned, Indices]:
    """Return the cells beside edges, and the positions among them of those that need the mean gap.

    A cell without a neighbour counts as its own neighbour.
    """
    others = np.where(beside == NONE, np.arange(len(beside))[:, None], beside)
    cosine = np.einsum("nkj,nj->nk", gaps.normal.take(others, axis=0), gaps.normal)
    rows = (cosine <= LESS_COSINE).any(axis=1).nonzero()[0]
    others, cosine, body = others[rows], cosine[rows], gaps.body[rows, None]
    alike = (gaps.body[others] == body) & (body >= 0) & (cosine > OPPOSITE)
    turned = np.where(alike, 2.0 - 2.0 * cosine, 0.0).reshape(-1, 2, 2)
    width = np.sqrt((sides[rows] ** 2).sum(axis=2))
    # The side across the edge is the one along which the normals turn most for its length, since cells are narrow
    # there.
    axis = (turned.sum(axis=2) / width).argmax(axis=1)
    each = np.arange(len(axis))
    off = gaps.clearance[rows] / width[each, axis]
    most = turned[each, axis].max(axis=1)
    own = ((off < FARTHER) & (most > (LESS * TURNED) ** 2)).nonzero()[0]
    touching = ((off[own] < 1.0) & (most[own] > TURNED**2)).nonzero()[0]
    return _Turned(rows[own], axis[own], others.reshape(-1, 2, 2)[own, axis[own]].T), touching

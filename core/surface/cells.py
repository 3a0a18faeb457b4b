"""Cells of space that know which triangles can be closest to the points inside them: exact, and filled when visited.

The distance to one triangle is a convex function, so its tangent at a cell's centre bounds it from below everywhere;
the distance to the triangle closest to the centre is bounded from above by its tangent and its largest curvature. A
triangle whose lower bound stays above that upper bound throughout the cell is never the closest there. The few others
are listed once per cell; afterwards a point costs a look-up and one or two triangles. A rigid object pays once for
each place that a finger visits, whoever's finger it is.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from .nearest import SLACK, TIE, Nearest
from .triangles import TriangleTable

# Triangles listed in a cell at most. Points in fuller ones ask cells of half the side, and so on; after the last
# (in the very middle of a ball) they are searched for afresh.
WIDTH, HALVINGS = 64, 4
# Bounds are kept in strips of this many triangles: most cells need one, and whole rows are quick to gather.
STRIP = 32
MAX_CELLS = 200_000
# Side of a cell, as a multiple of the median radius of even triangles of the same area: smaller cells list less and are
# filled more often.
SIDE = 0.7
OFFSET = 1 << 20
# Slots of the cells asked for last are found by a hash of this many bits, the others by a binary search.
RECENT = 16
FAR, FULL = -1, -2

Search = Callable[[Array, float], Nearest]


class CellLists:
    """Candidate lists of the cells about one surface.

    Args:
        table: the triangles.
        search: the exact search for points within a distance, which answers -1 only for points outside and beyond.
        search_radius: distance of interest that the lists are good for [m].
        halved: how often the side has been halved.
    """

    def __init__(self, table: TriangleTable, search: Search, search_radius: float, halved: int = 0) -> None:
        self.search_radius = search_radius
        self._table, self._search = table, search
        self._halved = halved
        self._finer: CellLists | None = None
        radii = _even_radii(table)
        self._side = SIDE * 0.5**halved * float(np.median(radii)) if radii.size else 1.0
        self._half = 0.5 * np.sqrt(3.0) * self._side
        self._slack = 1e-6 * (
            search_radius if np.isfinite(search_radius) else float(np.ptp(table.rows[0:3])) + self._side
        )
        self._clear()

    def nearest(self, points: Array) -> Nearest:
        """Return the closest triangles of points [m], shape (n, 3), within the search radius or a little beyond."""
        scaled = points / self._side
        np.floor(scaled, out=scaled)
        if scaled.size and max(float(scaled.max()), -float(scaled.min())) >= OFFSET - 2:
            return self._search(points, self.search_radius)
        slot = self._slots(scaled.astype(np.int64))
        first = self._first.take(slot)
        scaled += 0.5
        scaled *= -self._side
        scaled += points
        away = np.ones((len(points), 1, 4), dtype=np.float32)
        away[:, 0, :3] = scaled
        near = (first >= 0).nonzero()[0]
        n = points.shape[0]
        if near.size == n > 0:
            return self._choose(points, slot, away, first)
        found = Nearest(np.full(n, -1), np.full(n, np.inf), np.zeros(n), np.zeros(n))
        if near.size:
            chosen = self._choose(points.take(near, axis=0), slot.take(near), away.take(near, axis=0), first.take(near))
            for target, source in zip(found, chosen, strict=True):
                target[near] = source
        full = (first == FULL).nonzero()[0]
        if full.size:
            for target, source in zip(found, self._in_full_cells(points[full]), strict=True):
                target[full] = source
        return found

    def _in_full_cells(self, points: Array) -> Nearest:
        """Ask finer cells, which list less, and after the last halving search."""
        if self._halved == HALVINGS:
            return self._search(points, self.search_radius)
        if self._finer is None:
            self._finer = CellLists(self._table, self._search, self.search_radius, self._halved + 1)
        return self._finer.nearest(points)

    def _choose(self, points: Array, slot: Indices, away: NDArray[np.float32], first: Indices) -> Nearest:
        """Measure the first triangle of each cell, and of the others those that can be closer."""
        x = np.ascontiguousarray(points.T)
        square, u, w = self._table.closest(x, first)
        # the tangents in single precision: the slack covers their rounding
        lower = away @ self._planes[0].take(slot, axis=0)
        if self._used.take(slot).max() > STRIP:
            lower = np.concatenate([lower, *(away @ strip.take(slot, axis=0) for strip in self._planes[1:])], axis=2)
        threshold = np.sqrt(square)
        threshold *= 1.0 + 1e-6
        threshold += self._slack
        owner, column = np.divmod(
            (lower <= threshold.astype(np.float32)[:, None, None]).ravel().nonzero()[0], lower.shape[2]
        )
        if owner.size:
            other = self._lists[slot.take(owner), column]
            square_o, u_o, w_o = self._table.closest(x[:, owner], other)
            start = _firsts(owner)
            of = owner.take(start)
            least = np.minimum.reduceat(square_o, start)
            least *= 1.0 + TIE
            upper = np.empty_like(square)
            upper[of] = least
            hits = (square_o <= upper.take(owner)).nonzero()[0]
            hits = hits.take(_firsts(owner.take(hits)))
            base, other = square.take(of), other.take(hits)
            wins = least < base
            wins |= (square_o.take(hits) <= base * (1.0 + TIE)) & (other < first.take(of))
            of, hits = of[wins], hits[wins]
            first[of], square[of], u[of], w[of] = other[wins], square_o[hits], u_o[hits], w_o[hits]
        return Nearest(first, square, u, w)

    # -- the table of cells --------------------------------------------------------------------------------------

    def _clear(self) -> None:
        self._keys = np.zeros(0, dtype=np.int64)
        self._slot_of: Indices = np.zeros(0, dtype=np.int64)
        self._key_of: Indices = np.full(256, -1)
        self._recent: Indices = np.zeros(1 << RECENT, dtype=np.int64)
        self._count = 0
        self._lists: Indices = np.zeros((256, WIDTH), dtype=np.int64)
        # gradient and distance at the cell's centre; infinite where there is no triangle
        self._planes: NDArray[np.float32] = np.zeros((WIDTH // STRIP, 256, 4, STRIP), dtype=np.float32)
        self._used: Indices = np.zeros(256, dtype=np.int64)
        self._first: Indices = np.zeros(256, dtype=np.int64)

    def _slots(self, cell: Indices) -> Indices:
        """Return the row of each cell in the table, filling those that are not there."""
        key = _key(cell)
        place = (key * _MIX) >> (63 - RECENT) & ((1 << RECENT) - 1)
        slot = self._recent.take(place)
        known = self._key_of.take(slot) == key
        if known.all():
            return slot
        missed = (~known).nonzero()[0]
        wanted = key.take(missed)
        at = np.searchsorted(self._keys, wanted)
        absent = np.ones(at.size, dtype=bool)
        if self._keys.size:
            np.minimum(at, self._keys.size - 1, out=at)
            absent = self._keys.take(at) != wanted
        if absent.any():
            if self._count and self._count + key.size > MAX_CELLS:
                self._clear()
                return self._slots(cell)
            self._fill(cell[missed[absent]])
            at = np.searchsorted(self._keys, wanted)
        slot[missed] = self._recent[place.take(missed)] = self._slot_of.take(at)
        return slot

    def _fill(self, cell: Indices) -> None:
        """List the triangles of missing cells."""
        key, index = np.unique(_key(cell), return_index=True)
        cell = cell[index]
        centres = np.asarray((cell + 0.5) * self._side, dtype=np.float64)
        n = key.size
        first = np.full(n, FAR)
        lists = np.zeros((n, WIDTH), dtype=np.int64)
        planes = np.zeros((WIDTH // STRIP, n, 4, STRIP), dtype=np.float32)
        planes[:, :, 3] = np.inf
        used = np.zeros(n, dtype=np.int64)
        closest = self._search(centres, self.search_radius + self._half)
        near = np.flatnonzero(closest.triangle >= 0)
        if near.size:
            first[near] = closest.triangle[near]
            owner, triangle, d, gradient = self._listed(centres[near], closest, near)
            start = np.searchsorted(owner, np.arange(near.size + 1))
            column = np.arange(owner.size) - start[owner]
            fits = column < WIDTH
            row, column = near[owner[fits]], column[fits]
            # the closest to the centre is measured anyway
            lists[row, column] = triangle[fits]
            strip, place = np.divmod(column, STRIP)
            planes[strip, row, 3, place] = np.where(triangle[fits] == first[row], np.inf, d[fits])
            planes[strip, row, :3, place] = gradient[fits]
            used[near] = np.minimum(np.diff(start), WIDTH)
            first[near[np.diff(start) > WIDTH]] = FULL
        while self._count + n > self._first.size:
            self._lists = np.concatenate([self._lists, np.zeros_like(self._lists)])
            self._planes = np.concatenate([self._planes, np.zeros_like(self._planes)], axis=1)
            self._used = np.concatenate([self._used, np.zeros_like(self._used)])
            self._first = np.concatenate([self._first, np.zeros_like(self._first)])
            self._key_of = np.concatenate([self._key_of, np.full_like(self._key_of, -1)])
        here = slice(self._count, self._count + n)
        self._lists[here], self._planes[:, here] = lists, planes
        self._used[here], self._first[here], self._key_of[here] = used, first, key
        keys = np.concatenate([self._keys, key])
        order = np.argsort(keys, kind="stable")
        self._slot_of = np.concatenate([self._slot_of, np.arange(here.start, here.stop)])[order]
        self._keys = keys[order]
        self._count += n

    def _listed(self, centres: Array, closest: Nearest, near: Indices) -> tuple[Indices, Indices, Array, Array]:
        """Return (cell, triangle, distance, gradient) of all triangles that can be closest somewhere in each cell."""
        table, h = self._table, self._half
        d0 = np.sqrt(closest.square[near])
        owner, triangle, square, u, w = within(table, centres, d0 + 2.0 * h)
        d = np.sqrt(square)
        gradient = centres[owner] - table.point(triangle, u, w)
        gradient /= np.maximum(d, 1e-300)[:, None]
        foot = table.point(closest.triangle[near], closest.u[near], closest.w[near])
        main = (centres - foot) / np.maximum(d0, 1e-300)[:, None]
        turned = gradient - main[owner]
        turn = np.sqrt(np.einsum("ij,ij->i", turned, turned))
        # far away the distance curves by at most 1 / (d0 - h); near the surface it is only 1-Lipschitz
        with np.errstate(divide="ignore"):
            curved = np.where(d0 > 2.0 * h, h * h / (2.0 * np.maximum(d0 - h, h)), np.inf)[owner]
        kept = np.flatnonzero(d - d0[owner] <= np.minimum(h * turn + curved, 2.0 * h) * (1.0 + SLACK) + 1e-12)
        return owner[kept], triangle[kept], d[kept], gradient[kept]


def _even_radii(table: TriangleTable) -> Array:
    """Circumscribing radii of equilateral triangles with the same areas, of the usable triangles."""
    twice_area = table.rows[13, table.usable] ** -0.5
    return np.sqrt(twice_area / (1.5 * np.sqrt(3.0)))


def within(table: TriangleTable, points: Array, limit: Array) -> tuple[Indices, Indices, Array, Array, Array]:
    """Return all pairs (point, triangle, squared distance, weights) within each point's limit, triangles rising."""
    x = np.ascontiguousarray(points.T)
    centre, radius = table.bounds[0:3], table.bounds[6]
    far = float(limit.max())
    low, high = points.min(axis=0) - far, points.max(axis=0) + far
    usable = table.usable
    for axis in range(3):
        usable = usable & (centre[axis] + radius >= low[axis]) & (centre[axis] - radius <= high[axis])
    kept = np.flatnonzero(usable)
    pairs = []
    step = max(1, 2_000_000 // max(kept.size, 1))
    middle = points.mean(axis=0)
    c = centre[:, kept].T - middle
    r = radius[kept]
    cc = np.einsum("ij,ij->i", c, c)
    for begin in range(0, points.shape[0], step):
        p = points[begin : begin + step] - middle
        square = p @ c.T
        square *= -2.0
        pp = np.einsum("ij,ij->i", p, p)
        square += pp[:, None]
        square += cc
        bound = (limit[begin : begin + step, None] + r) ** 2
        bound += 1e-12 * (pp.max() + cc.max(initial=0.0))
        owner, column = np.nonzero(square <= bound)
        owner += begin
        triangle = kept[column]
        position = x.take(owner, axis=1)
        near = np.flatnonzero(table.disc_bound(position, triangle) <= (limit[owner] * (1.0 + SLACK)) ** 2)
        owner, triangle = owner[near], triangle[near]
        exact, u, w = table.closest(position[:, near], triangle)
        near = np.flatnonzero(exact <= (limit[owner] * (1.0 + SLACK)) ** 2)
        pairs.append((owner[near], triangle[near], exact[near], u[near], w[near]))
    owner, triangle, exact, u, w = (np.concatenate(column) for column in zip(*pairs, strict=True))
    return owner, triangle, exact, u, w


# An odd number without pattern; the product wraps, and its high bits are the hash.
_MIX = np.int64(0x1E3779B97F4A7C15)


def _key(cell: Indices) -> Indices:
    shifted = cell + OFFSET
    return (shifted[:, 0] << 42) | (shifted[:, 1] << 21) | shifted[:, 2]


def _firsts(owner: Indices) -> Indices:
    """Where each run of equal values starts."""
    new = np.empty(owner.size, dtype=bool)
    new[:1] = True
    np.not_equal(owner[1:], owner[:-1], out=new[1:])
    return np.flatnonzero(new)

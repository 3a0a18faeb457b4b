"""PointTree: where a smooth pad is looked at: cells as fine as what presses into it is bent, and no finer.

A cell is cut along the finger, around it or both ways, where surfaces seen from its corners turn that way, or where
their gap is not linear: across an edge cells are fine, along it they are long. It is whole again only well below those
limits, so that nothing flickers. Corners reach beyond their cell: an edge between two cells is in both, and
nothing gets into a cell before it has moved by what they reach beyond. Until then a cell is not looked at again.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from ...skin.surface_compliance import SurfaceCompliance
from ...skin.tiles import ALONG, AROUND, BOTH

# A cell is cut where normals at its corners differ by more than this, or a gap is off linear by more than this [m].
TURNED, BENT = 0.3, 0.04e-3
# Sides are halved less often, by one, where there would be more points than this, and more often again below that.
MANY, FEW = 650, 100
# A way is no matter where surfaces turn by less than this share of what they turn the other way.
ODD = 0.4
# A cell stays cut down to this share of the limits.
MERGE = 0.6
# Sides that were halved so often are halved again only where normals differ by more than the first of these, at sharp
# edges along the cell, or the second, at the sharpest edges across it: there squares are many, and gain less.
OFTEN, SHARP, SHARPEST = 2, 1.0, 1.5
# A cell that seems to lie deeper than this [m] is lifted; across its normal by no more than the inverse of this.
DEEP, STEEP = 0.06e-3, 0.3
CORNERS = 0.75  # of a cell's sides, from its centre
# Points may touch below this share of their cell's side, and a margin for what moves until it is looked at again [m].
NEAR, MARGIN = 0.4, 0.1e-3
BESIDE = 0.35  # times its longer side that a cell's corners may be nearer than its centre
FLAT = 1.2  # times its side about a cell's centre that a surface must be flat for its corners to be no matter
# A cell is looked at again when something has moved this share of its side along it, or the second share towards it,
# but no sooner than this, and no later than that [m].
AGAIN, SOONEST, LATEST = 0.25, 0.1e-3, 0.4e-3
# What is known of cells that surfaces turn in serves again when something has moved this far [m].
GLANCE = 0.06e-3
# What will be due so soon [m] is looked at together with what is.
TOGETHER = 0.03e-3
STEP = 0.2e-3  # times come in multiples of this [m], so that many fall together
NEVER = -np.inf


_SIGNS = np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])  # of a cell's corners, along and around


class Seen(NamedTuple):
    """What cells see: clearance [m], inf beyond reach, shape (n,); normal out of the body, shape (n, 3); and how far
    the surface is flat about the points that the first k are closest to, at least [m], shape (k,)."""

    clearance: Array
    normal: Array
    flat: Array


Look = Callable[[Indices, Array, int], Seen]
# For cells: clearance of centres, (n,), of corners, (n, 4), normals there, (n, 4, 3), and whether nothing is known of
# them (0), of some corners (1) or of all (2), (n,).
Glance = Callable[[Indices], tuple[Array, Array, Array, Indices]]


class PointTree:
    """The cells of a pad, split where contact needs it.

    Args:
        pad: with the chart that the cells are of.
        search_radius: beyond which nothing is seen [m].
    """

    def __init__(self, pad: SurfaceCompliance, search_radius: float) -> None:
        self.pad, self.chart, self.search_radius = pad, pad.chart, search_radius
        self._tiles = self.chart.tiles
        lengths = np.linalg.norm(pad.cells.sides, axis=2)
        self.sides: Array = np.sqrt(pad.cells.areas)
        self._short, self._long = lengths.min(axis=1), lengths.max(axis=1)
        self._limit = NEAR * self.sides + MARGIN
        count = len(self.sides)
        self._inner = (self._tiles.ways.max(axis=2) > 0)[tuple(self._tiles.halved.T)]  # those that can be cut
        self.finest = self._tiles.levels - 1  # how often sides are halved at most
        self._ways: Indices = np.zeros(count, dtype=np.int64)
        self._turning = np.zeros(count, dtype=bool)  # whether corners were of interest
        self._clearance = np.full(count, np.inf)
        self._due = np.full((count, 2), NEVER)  # how far anything may move along and towards a cell
        self.forget()

    def forget(self) -> None:
        """Begin again: nothing is cut, and nothing is known."""
        self._present = self.chart.base
        self.finest = self._tiles.levels - 1
        self._due[:] = NEVER
        self._ways[:] = 0
        self._turning[:] = False
        self._moved, self._next, self._check = np.zeros(2), np.full(2, NEVER), np.zeros(2)

    def renew(self) -> None:
        """Look at every cell again: something else is near."""
        self._due[self._present] = NEVER
        self._next = np.full(2, NEVER)

    def save(self) -> tuple[Any, ...]:
        """Return what a survey changes."""
        cells = self._present
        kept = tuple(table[cells] for table in self._tables)
        return cells, *kept, self._moved, self._next, self._check, self.finest

    def restore(self, state: tuple[Any, ...]) -> None:
        """Go back to a saved state."""
        self._leave(self._present)
        self._present, *kept, self._moved, self._next, self._check, self.finest = state
        for table, values in zip(self._tables, kept, strict=True):
            table[self._present] = values

    @property
    def _tables(self) -> tuple[NDArray[Any], ...]:
        """What is known of cells."""
        return self._due, self._ways, self._turning, self._clearance

    def asks(self, moved: Array) -> bool:
        """Return whether any cell is to be looked at again.

        Args:
            moved: how far anything moved since the last survey, along the skin or in any way, and towards it [m].
        """
        return bool((self._moved + moved >= self._next).any())

    def survey(self, look: Look, glance: Glance | None, moved: Array) -> Indices:
        """Cut and merge cells, and return those that may touch.

        Args:
            look: measures points [m], shape (n, 3), that move with cells, shape (n,), the first so many centres.
            glance: tells what is known of cells without measuring.
            moved: as in `asks`.
        """
        found = self._survey(look, glance, moved)
        while len(found) > MANY and self.finest > 0 and glance is None:
            self.finest -= 1
            self.renew()
            found = self._survey(look, glance, np.zeros(2))
        if len(found) > MANY:
            self.finest = max(self.finest - 1, 0)
        elif len(found) < FEW:
            self.finest = min(self.finest + 1, self._tiles.levels - 1)
        return found

    def _survey(self, look: Look, glance: Glance | None, moved: Array) -> Indices:
        self._moved = self._moved + moved
        before = self._present
        if (self._moved >= self._check - TOGETHER).any():
            self._check = self._moved + LATEST
        due = (self._due[before] <= self._moved + TOGETHER).any(axis=1)
        if glance is not None:
            # what is cut is known from its parts; what is large and whole is looked at for what nothing has seen yet
            fine = (self._ways[before] != 0) | (self._tiles.halved[before].max(axis=1) >= OFTEN)
            known = self._turning[before] & (~due | fine)
            lost = self._glance_at(before[known], glance)
            self._look_at(np.concatenate([before[due & ~known], lost]), look)
        else:
            self._look_at(before[due], look)
        present, leaves, cells = [], [], self.chart.base
        while len(cells):
            fresh = cells[self._due[cells, 0] == NEVER]
            if len(fresh):
                if glance is None:
                    self._look_at(fresh, look)
                else:  # they are cut in their turn, by what they see as points
                    self._turning[fresh], self._clearance[fresh] = self._inner[fresh], 0.0
                    self._due[fresh] = self._check
            present.append(cells)
            ways = self._ways[cells]
            leaves.append(cells[(ways == 0) & (self._clearance[cells] < self._limit[cells])])
            cells = self._tiles.cut(cells, ways)[0]
        self._present = np.concatenate(present)
        self._leave(np.setdiff1d(before, self._present))
        self._next = self._due[self._present].min(axis=0)
        turning = self._present[self._turning[self._present]]
        if len(turning):
            fine = AGAIN * float(self._short[turning].min())
            self._next[0] = min(self._next[0], self._moved[0] + max(fine, GLANCE))
        return np.concatenate(leaves)

    def _leave(self, cells: Indices) -> None:
        self._due[cells], self._ways[cells] = NEVER, 0

    def _glance_at(self, cells: Indices, glance: Glance) -> Indices:
        """Find out by what is known which cells shall be cut; return those that are to be looked at."""
        own, gap, normal, known = glance(cells)
        late: NDArray[np.bool_] = np.any(self._due[cells] <= self._moved + TOGETHER, axis=1)
        told = (known > 0) & ((known > 1) | ~late)
        lost, cells, late = cells[~told], cells[told], late[told]
        if len(cells) == 0:
            return lost
        own, gap, normal, sure = own[told], gap[told], normal[told], known[told] > 1
        turning = self._inner[cells] & (own < self._limit[cells] + BESIDE * self._long[cells])
        ways = np.zeros(len(cells), dtype=np.int64)
        close = np.flatnonzero(turning)
        if len(close):
            ways[close] = self._turns(cells[close], own[close], own[close], gap[close], normal[close])
        # where not all is known, what is cut stays cut until it is looked at
        halved = self._tiles.halved[cells]
        more = self._tiles.ways[halved[:, 0], halved[:, 1], ways | self._ways[cells]]
        self._ways[cells] = np.where(sure, ways, more)
        self._clearance[cells], self._turning[cells] = own, turning
        self._due[cells[late]] = self._check
        return lost

    def _look_at(self, cells: Indices, look: Look) -> None:
        """Find out which cells shall be cut, and when to look again."""
        if len(cells) == 0:
            return
        n, limit, long = len(cells), self._limit[cells], self._long[cells]
        # one look at centres and corners, where corners were of interest before, or are for what has just been cut
        fresh = self._due[cells, 0] == NEVER
        some = np.flatnonzero(
            np.where(fresh, self._inner[cells] & (cells >= self.chart.starts[1]), self._turning[cells])
        )
        places = np.concatenate([self.pad.cells.positions[cells], self.corner_points(cells[some])])
        seen = look(np.concatenate([cells, np.repeat(cells[some], 4)]), places, n)
        own, flat = seen.clearance[:n], seen.flat
        turning = self._inner[cells] & (own < limit + BESIDE * long) & (flat < FLAT * long)
        gap, normal = np.zeros((n, 4)), np.zeros((n, 4, 3))
        gap[some], normal[some] = seen.clearance[n:].reshape(-1, 4), seen.normal[n:].reshape(-1, 4, 3)
        middle = own.copy()
        # what is in between is to be seen from the surface: deep below it every edge is sharp
        deep = turning & (own < -DEEP)
        missed = deep | turning
        missed[some] = deep[some]
        more = np.flatnonzero(missed)
        if len(more):
            up = -self.pad.cells.normals[cells[more]]
            steep = np.maximum(np.einsum("ij,ij->i", up, seen.normal[more]), STEEP)
            lift = (np.where(deep[more], -own[more], 0.0) / steep)[:, None] * up
            corners = self.corner_points(cells[more]).reshape(-1, 4, 3) + lift[:, None]
            places = np.concatenate([self.pad.cells.positions[cells[more]] + lift, corners.reshape(-1, 3)])
            found = look(np.concatenate([cells[more], np.repeat(cells[more], 4)]), places, 0)
            k = len(more)
            middle[more] = found.clearance[:k]
            gap[more], normal[more] = found.clearance[k:].reshape(-1, 4), found.normal[k:].reshape(-1, 4, 3)
        ways = np.zeros(n, dtype=np.int64)
        close = np.flatnonzero(turning)
        if len(close):
            ways[close] = self._turns(cells[close], own[close], middle[close], gap[close], normal[close])
        self._ways[cells], self._clearance[cells], self._turning[cells] = ways, own, turning
        beyond = 0.5 * (np.minimum(own, self.search_radius) - limit - BESIDE * long)
        even = np.minimum(flat - FLAT * long, LATEST)
        short = self._short[cells]
        soon = np.maximum(AGAIN * short, SOONEST)
        far = np.maximum(soon, np.maximum(beyond, even)), np.maximum(soon, beyond)
        for k in range(2):  # together with others, and no sooner than this
            steps = np.maximum(np.floor((self._moved[k] + far[k]) / STEP), np.ceil(self._moved[k] / STEP) + 1.0)
            self._due[cells, k] = STEP * steps
        self._due[cells[turning]] = self._check

    def _turns(self, cells: Indices, own: Array, middle: Array, gap: Array, normal: Array) -> Indices:
        """Return in which ways cells shall be cut by what their corners see.

        Args:
            own: clearance of the centres [m]. middle: the same seen from where the corners are looked from, shape (n,).
            gap: of the corners [m], shape (n, 4). normal: there, shape (n, 4, 3).
        """
        near = np.minimum(gap.min(axis=1), own) < self._limit[cells]
        halved, before = self._tiles.halved[cells], self._ways[cells]
        ways = np.zeros(len(cells), dtype=np.int64)
        sharp = np.where(halved.min(axis=1) < OFTEN, SHARP, SHARPEST)
        turned = np.empty((2, len(cells), 2))
        for axis, pairs in enumerate((((0, 2), (1, 3)), ((0, 1), (2, 3)))):
            for k, (one, other) in enumerate(pairs):
                apart = normal[:, one] - normal[:, other]
                turned[axis, :, k] = np.sqrt(np.einsum("ij,ij->i", apart, apart))
        most, least = turned.max(axis=2), turned.min(axis=2)
        mean = most + least
        # one corner that sees another side tells no way: squares are cut in both, or stay cut as they are
        odd = (least < ODD * most).all(axis=0)
        kept = np.where((before == 0) & (halved[:, 0] == halved[:, 1]), BOTH, before)
        for axis, way in enumerate((ALONG, AROUND)):
            share = np.where(before & way, MERGE, 1.0)
            limit = np.where(halved[:, axis] < OFTEN, TURNED, sharp) * share
            limit = np.where(halved[:, axis] < self.finest, limit, np.inf)
            told = np.where(odd, kept & way, mean[axis] > ODD * mean[1 - axis])
            ways |= np.where((most[axis] > limit) & (told != 0), way, 0)
        with np.errstate(invalid="ignore"):
            off = np.abs(gap.mean(axis=1) - middle)
            twist = 0.25 * np.abs(gap[:, 0] - gap[:, 1] - gap[:, 2] + gap[:, 3])
        bent = np.nan_to_num(np.maximum(off, twist), nan=np.inf, posinf=np.inf)
        bends = (
            (most < TURNED).all(axis=0)
            & (bent > BENT * np.where(before == BOTH, MERGE, 1.0))
            & (halved.max(axis=1) < OFTEN)
        )
        ways[bends] = BOTH
        ways[~near] = 0
        return np.asarray(self._tiles.ways[halved[:, 0], halved[:, 1], ways])

    def corner_points(self, cells: Indices) -> Array:
        """Return the four corners of cells [m], shape (4 n, 3)."""
        # in the tangent plane: it is not the skin's own curvature that asks for more points
        arms = np.einsum("cs,nsk->nck", CORNERS * _SIGNS, self.pad.cells.sides[cells])
        arms += self.pad.cells.positions[cells][:, None]
        return arms.reshape(-1, 3)

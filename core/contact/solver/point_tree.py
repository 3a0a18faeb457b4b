"""PointTree: where a smooth pad is looked at: cells as fine as what presses into it is bent, and no finer.

A cell is cut along the finger, around it or both ways, where surfaces seen from its corners turn that way, or where
their gap is not linear: across an edge cells are fine, along it they are long. It is whole again only well below those
limits, so that nothing flickers. Corners reach beyond their cell: an edge between two cells is in both, and
nothing gets into a cell before it has moved by what they reach beyond. Until then a cell is not looked at again.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from ...skin.surface_compliance import SurfaceCompliance
from ...skin.tiles import ALONG, AROUND
from .seen import Glance, Look

# A cell is cut where normals at its corners differ by more than this, or a gap is off linear by more than this [m].
TURNED, BENT = 0.3, 0.04e-3
# Sides are halved less often, by one, where there would be more points than the first, and more often again below the
# second, but so often at least: what stands in the skin passes between coarser points. Of more than the last only
# those count that carry force or are nearest to what they may touch.
MANY, FEW, COARSEST, MOST = 450, 100, 1, 1000
# A way is no matter where normals lean apart that way by less than this share of what they do the other way, and the
# second: what leans by less tells no way.
ODD, KNOWN, LEVEL = 0.4, 0.8, 0.1
# A cell stays cut down to this share of the limits.
MERGE = 0.6
# Sides that were halved so often are halved again only where normals differ by more than this: at edges sharper than a
# right angle.
OFTEN, SHARP = 2, 1.5
# A cell that seems to lie deeper than this [m] is lifted; across its normal by no more than the inverse of this.
DEEP, STEEP = 0.06e-3, 0.3
CORNERS = 0.75  # of a cell's sides, from its centre
# Points may touch below this share of their cell's side, and a margin for what moves until it is looked at again [m].
NEAR, MARGIN = 0.4, 0.1e-3
BESIDE = 0.35  # times its longer side that a cell's corners may be nearer than its centre
FLAT = 1.2  # times its side about a cell's centre that a surface must be flat for its corners to be no matter
# A cell is looked at again when something has moved this share of its side along it, or the second share towards it,
# but no sooner than this, and no later than that, about [m].
AGAIN, SOONEST, LATEST = 0.25, 0.1e-3, 0.4e-3
# What is out of reach is looked at again when something has moved by this share of the way: skin moves, too.
SHARE = 0.8
# What is known of cells that see an edge, of normals that differ by more than the first, serves again when something
# has moved this far [m].
EDGE, GLANCE = 0.5, 0.06e-3
# What will be due so soon [m] is looked at together with what is.
TOGETHER = 0.12e-3
STEP = 0.2e-3  # times come in multiples of this [m], so that many fall together
GOLDEN = 0.618034  # multiples of it are spread evenly
NEVER = -np.inf


_SIGNS = np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])  # of a cell's corners, along and around


class PointTree:
    """The cells of a pad, split where contact needs it.

    Args:
        pad: with the chart that the cells are of.
        search_radius: beyond which nothing is seen [m].
    """

    def __init__(self, pad: SurfaceCompliance, search_radius: float) -> None:
        self.pad, self.chart, self.search_radius = pad, pad.chart, search_radius
        self._tiles = self.chart.tiles
        self._short, self._long, self.sides = pad.cells.extent
        self._limit = NEAR * self.sides + MARGIN
        count = len(self.sides)
        self._inner = (self._tiles.ways.max(axis=2) > 0)[tuple(self._tiles.halved.T)]  # those that can be cut
        self.finest = self._tiles.levels - 1  # how often sides are halved at most
        self._ways: Indices = np.zeros(count, dtype=np.int64)
        self._turning = np.zeros(count, dtype=bool)  # whether corners were of interest
        self._sharp = np.zeros(count, dtype=bool)  # and see an edge
        self._clearance = np.full(count, np.inf)
        self._due = np.full((count, 2), NEVER)  # how far anything may move along and towards a cell
        self.forget()

    def forget(self) -> None:
        """Begin again: nothing is cut, and nothing is known."""
        self._present = self.chart.base
        self.finest = self._tiles.levels - 1
        self._due[:] = NEVER
        self._ways[:] = 0
        self._turning[:] = self._sharp[:] = False
        self._moved, self._next = np.zeros(2), np.full(2, NEVER)

    def renew(self) -> None:
        """Look at every cell again: something else is near."""
        self._due[self._present] = NEVER
        self._next = np.full(2, NEVER)

    def save(self) -> tuple[Any, ...]:
        """Return what a survey changes."""
        cells = self._present
        kept = tuple(table[cells] for table in self._tables)
        # a cell that comes back has its edge from an earlier life
        return cells, *kept, self._moved, self._next, self.finest, self._sharp.copy()

    def restore(self, state: tuple[Any, ...]) -> None:
        """Go back to a saved state."""
        self._due[self._present], self._ways[self._present] = NEVER, 0
        self._present, *kept, self._moved, self._next, self.finest, sharp = state
        self._sharp[:] = sharp
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

    def survey(self, look: Look, glance: Glance | None, moved: Array, loaded: Indices) -> Indices:
        """Cut and merge cells, and return those that may touch.

        Args:
            look: measures points [m], shape (n, 3), that move with cells, shape (n,), the first so many centres.
            glance: tells what is known of cells without measuring.
            moved: as in `asks`. loaded: cells that carry force.
        """
        found = self._survey(look, glance, moved)
        while len(found) > MANY and self.finest > COARSEST and glance is None:
            self.finest -= 1
            self.renew()
            found = self._survey(look, glance, np.zeros(2))
        if len(found) > MANY:
            self.finest = max(self.finest - 1, COARSEST)
        elif len(found) < FEW:
            self.finest = min(self.finest + 1, self._tiles.levels - 1)
        far = np.where(np.isin(found, loaded), -np.inf, self._clearance[found])
        return found[np.sort(np.argsort(far, kind="stable")[:MOST])]

    def _survey(self, look: Look, glance: Glance | None, moved: Array) -> Indices:
        self._moved = self._moved + moved
        before = self._present
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
                    self._due[fresh] = self._later(fresh)
            present.append(cells)
            ways = self._ways[cells]
            leaves.append(cells[(ways == 0) & (self._clearance[cells] < self._limit[cells])])
            cells = self._tiles.cut(cells, ways)[0]
        self._present = np.concatenate(present)
        gone = np.setdiff1d(before, self._present)
        self._due[gone], self._ways[gone] = NEVER, 0
        self._next = self._due[self._present].min(axis=0)
        sharp = self._present[self._turning[self._present] & self._sharp[self._present]]
        if len(sharp):
            fine = AGAIN * float(self._short[sharp].min())
            self._next[0] = min(self._next[0], self._moved[0] + max(fine, GLANCE))
        return np.concatenate(leaves)

    def _later(self, cells: Indices) -> Array:
        """Return when cells are looked at again at the latest: not all of them together, shape (n, 2)."""
        later = LATEST * (0.75 + (GOLDEN * cells) % 1.0)
        return STEP * np.floor((self._moved + later[:, None]) / STEP)

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
            ways[close] = self._turns(cells[close], own[close], gap[close], normal[close], None)
        # where not all is known, what is cut stays cut until it is looked at
        halved, before = self._tiles.halved[cells], self._ways[cells]
        more = self._tiles.ways[halved[:, 0], halved[:, 1], ways | before]
        merged = sure & ((before & ~ways) != 0)
        self._ways[cells] = more
        self._clearance[cells], self._turning[cells] = own, turning | (before != 0)
        self._due[cells[late]] = self._later(cells[late])
        return np.concatenate([lost, cells[merged]])

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
        gap, normal = np.zeros((n, 4)), np.zeros((n, 5, 3))
        normal[:, 0] = seen.normal[:n]
        gap[some], normal[some, 1:] = seen.clearance[n:].reshape(-1, 4), seen.normal[n:].reshape(-1, 4, 3)
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
            middle[more], normal[more, 0] = found.clearance[:k], found.normal[:k]
            gap[more], normal[more, 1:] = found.clearance[k:].reshape(-1, 4), found.normal[k:].reshape(-1, 4, 3)
        ways = np.zeros(n, dtype=np.int64)
        close = np.flatnonzero(turning)
        if len(close):
            ways[close] = self._turns(cells[close], own[close], gap[close], normal[close], middle[close])
        self._ways[cells], self._clearance[cells], self._turning[cells] = ways, own, turning
        beyond = SHARE * (np.minimum(own, self.search_radius) - limit - BESIDE * long)
        even = np.minimum(flat - FLAT * long, LATEST)
        short = self._short[cells]
        soon = np.maximum(AGAIN * short, SOONEST)
        far = np.maximum(soon, np.maximum(beyond, even)), np.maximum(soon, beyond)
        for k in range(2):  # together with others, and no sooner than this
            steps = np.maximum(np.floor((self._moved[k] + far[k]) / STEP), np.ceil(self._moved[k] / STEP) + 1.0)
            self._due[cells, k] = STEP * steps
        self._due[cells[turning]] = self._later(cells[turning])

    def _turns(self, cells: Indices, own: Array, gap: Array, normal: Array, middle: Array | None) -> Indices:
        """Return in which ways cells shall be cut by what their corners see.

        Args:
            own: clearance of the centres [m], shape (n,).
            gap: of the corners [m], shape (n, 4). normal: at the centre and there, shape (n, 5, 3).
            middle: clearance of the centres, seen from where the corners are looked from [m], shape (n,); None where
                nothing was looked at: what points see tells edges, but not in between, and not what bends.
        """
        halved, before = self._tiles.halved[cells], self._ways[cells]
        ways = np.zeros(len(cells), dtype=np.int64)
        apart = (normal[:, 1:, None] - normal[:, None, 1:]).reshape(len(cells), -1, 3)
        most = np.sqrt(np.einsum("nck,nck->nc", apart, apart).max(axis=1))
        self._sharp[cells] = most > EDGE
        # the way that normals lean apart tells which way a surface turns, wherever its edge runs between the corners
        along = self.pad.cells.sides[cells]
        along = along / np.linalg.norm(along, axis=2, keepdims=True)
        leaning = np.ptp(np.einsum("nck,nak->anc", normal, along), axis=2)
        odd = ODD
        for axis, way in enumerate((ALONG, AROUND)):
            share = np.where(before & way, MERGE, 1.0)
            limit = np.where(halved[:, axis] < OFTEN, TURNED, SHARP) * share
            limit = np.where(halved[:, axis] < self.finest, limit, np.inf)
            told = leaning[axis] + LEVEL > np.where(before & way, MERGE * ODD, odd) * leaning[1 - axis]
            ways |= np.where((most > limit) & told, way, 0)
        if middle is not None:
            with np.errstate(invalid="ignore"):
                off = np.abs(gap.mean(axis=1) - middle)
                twist = 0.25 * np.abs(gap[:, 0] - gap[:, 1] - gap[:, 2] + gap[:, 3])
            bent = np.nan_to_num(np.maximum(off, twist), nan=np.inf, posinf=np.inf)
            bends = (most < TURNED) & (bent > BENT * np.where(before > 0, MERGE, 1.0))
            bends &= halved.max(axis=1) < OFTEN
            told_both = leaning + LEVEL > ODD * leaning[::-1]
            ways[bends] = (told_both[:, bends] * [[ALONG], [AROUND]]).sum(axis=0)
        ways[np.minimum(gap.min(axis=1), own) >= self._limit[cells]] = 0
        return np.asarray(self._tiles.ways[halved[:, 0], halved[:, 1], ways])

    def corner_points(self, cells: Indices) -> Array:
        """Return the four corners of cells [m], shape (4 n, 3)."""
        # in the tangent plane: it is not the skin's own curvature that asks for more points
        arms = np.einsum("cs,nsk->nck", CORNERS * _SIGNS, self.pad.cells.sides[cells])
        arms += self.pad.cells.positions[cells][:, None]
        return arms.reshape(-1, 3)

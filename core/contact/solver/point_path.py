"""Contact along a path on free points of the smooth skin, as fine as what presses into it is bent.

As `PathSolver`, with points that come and go: a tree of cells is asked wherever something has moved, the compliance of
those cells that may touch is kept up, and what friction remembers goes from cells to the ones that take their place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...arrays import Array, Indices
from ...skin.nodal_forces import NodalForces
from ...skin.surface_compliance import SurfaceCompliance
from .admm import State, iterate
from .bodies import ContactBody, Expected, NodeGaps, node_gaps, travel
from .candidates import CandidateInverse
from .compliance import Linear
from .cone import project
from .history import ContactHistory
from .path import BONE, DEPTH_LIMIT, MARGIN, PathSolver, PathStep
from .point_history import succession
from .point_matrix import PointMatrix
from .point_tree import PointTree

TOLERANCE = 1e-4
# The tree is asked again when something has moved this far since [m].
ASK = 0.06e-3
# Points join the iteration ahead of time below the first of these shares of their cell's side, and leave it above the
# second: they have rows of the compliance already, so it takes little to join.
MEMBERS = (0.1, 0.3)
# Skin is looked for this far out [m].
REACH = 2.5e-3
MOST_ITERATIONS = 3000
# The shift of the iteration over a cell's own compliance.
WEIGHT = 0.75
# A corner of a cell is reached from this far above it [m].
ABOVE = 0.4e-3
# Normals that differ by more than this cosine says are of the two sides of something thin, or of a needle.
OPPOSITE = -0.7
# Cells without a point: their displacement is not known, or known from afar, as it is looked for within this [m].
UNKNOWN, NOBODY = -1, -2
NEAR_BASE = 0.8e-3


class PointSolver(PathSolver):
    """Contact of one finger on its smooth pad, frame after frame.

    Args:
        surface: the compliance between cells of the pad.
        nodes: brings forces on cells to the nodes of a mesh; without it they stay on the cells.

    For the others see `PathSolver`.

    Attributes:
        cells: of the chart, that the frame's points are the centres of, shape (n,).
    """

    def __init__(
        self,
        surface: SurfaceCompliance,
        nodes: NodalForces | None = None,
        *,
        tolerance: float = TOLERANCE,
        bone: Array = BONE,
        name: str = "finger",
        depth_limit: float = DEPTH_LIMIT,
    ) -> None:
        self._begin(tolerance, bone, name, depth_limit)
        self.surface, self.nodes = surface, nodes
        self.search_radius = REACH
        self._tree = PointTree(surface)
        self._matrix = PointMatrix(surface)
        self.operator = Linear(np.zeros((0, 0)))
        self._place = np.full(len(surface.chart.places), -1)  # of each cell in `cells`
        self._candidates = CandidateInverse(self._matrix.matrix, np.zeros(0), *MEMBERS)
        count = surface.chart.starts[1]
        self._rows = np.full((count, 3, 3 * count), np.nan, dtype=np.float32)  # of the coarsest cells, as asked for
        self.history = ContactHistory(0)
        self._asked: tuple[ContactBody, ...] | None = None  # the bodies when the tree was asked last
        starts = surface.chart.starts
        self._pad = surface.cells.positions[starts[1] : starts[2]]
        self._number()
        self.reset()

    @property
    def cells(self) -> Indices:
        """The cells whose centres are points, shape (n,)."""
        return self._matrix.cells

    @property
    def pad(self) -> Array:
        """Points of the undeformed skin that tell where anything first touches [m], shape (n, 3)."""
        return self._pad

    @property
    def bulge(self) -> Array:
        """How far skin may come out in the next frame to what it does not touch yet [m], the same everywhere."""
        return super().bulge.max(keepdims=True, initial=MARGIN)

    def reset(self) -> None:
        """Forget the history: the next frame is solved from rest."""
        self._tree.forget()
        self._asked = None
        self._change(np.arange(len(self.cells)), np.zeros(0, dtype=np.int64))
        self._zero, self._status = np.zeros((0, 3)), np.zeros(0, dtype=np.int8)
        super().reset()

    def save(self) -> dict[str, Any]:
        """Return the state between two frames, for `restore`."""
        return {**super().save(), "cells": self.cells, "tree": self._tree.save(), "asked": self._asked}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to a saved state."""
        cells = state["cells"]
        if not np.array_equal(cells, self.cells):
            self._candidates = CandidateInverse(np.zeros((0, 0), dtype=np.float32), np.zeros(0), *MEMBERS)
            self._matrix.change(np.flatnonzero(~np.isin(self.cells, cells)), cells[~np.isin(cells, self.cells)])
            self._matrix.sort(cells)
            self._number()
            self._candidates = CandidateInverse(self._matrix.matrix, self._rho[:, 0], *MEMBERS)
            self._zero, self._status = np.zeros((len(cells), 3)), np.zeros(len(cells), dtype=np.int8)
        self._tree.restore(state["tree"])
        self._asked = state["asked"]
        super().restore({name: state[name] for name in state if name not in ("cells", "tree", "asked")})

    def nodal(self, force: Array) -> Array:
        """Return forces on the points [N] as forces on the nodes of the skin's mesh, shape (m, 3)."""
        return force if self.nodes is None else self.nodes.spread(self.cells, force)

    def look(self, bodies: Sequence[ContactBody]) -> NodeGaps:
        """Measure the next frame's gaps, without taking it."""
        if self.fresh:
            self._survey(tuple(bodies))
        return super().look(bodies)

    def step(
        self,
        bodies: Sequence[ContactBody],
        *,
        scene_frame: float | None = None,
        gaps: NodeGaps | None = None,
        part: bool = False,
    ) -> PathStep:
        """Solve the next frame, as `PathSolver.step` does."""
        if (part or not self.unmoved(bodies)) and self._asks(bodies):
            self._survey(tuple(bodies))
            gaps = None
        return super().step(bodies, scene_frame=scene_frame, gaps=gaps, part=part)

    # -- the points ----------------------------------------------------------------------------------------------

    def _asks(self, bodies: Sequence[ContactBody]) -> bool:
        return self._asked is None or self._moved(bodies) > ASK

    def _moved(self, bodies: Sequence[ContactBody]) -> float:
        """Return how far anything moved since the tree was asked [m]."""
        before = self._asked
        if before is None or len(before) != len(bodies):
            return np.inf
        some = self.points[self.loaded] if self.loaded.any() else self._pad[:: max(len(self._pad) // 32, 1)]
        far = 0.0
        for a, b in zip(before, bodies, strict=True):
            if a.away and b.away:
                continue
            if a.away or b.away or a.surface is not b.surface:
                return np.inf
            far = max(far, travel(a, b, some))
        return far

    def _survey(self, bodies: tuple[ContactBody, ...]) -> None:
        """Ask the tree which cells may touch, and go over to them."""
        moved = self._moved(bodies)
        before, force, history = self.cells, self._force, self.history
        sources = self._sources()
        normal = self._turned(bodies)

        def look(cells: Indices, points: Array) -> NodeGaps:
            return self._look_at(bodies, sources, normal, cells, points)

        found = self._tree.survey(look, moved)
        self._asked = bodies
        entering = found[self._place[found] < 0]
        inside = np.zeros(len(self._place), dtype=bool)
        inside[found] = True
        leaving = np.flatnonzero(~inside[before])
        if len(leaving) == 0 and len(entering) == 0:
            return
        passed = succession(self.surface.chart, self.surface.cells.areas, before[leaving], leaving, entering)
        order = self._change(leaving, entering)
        count = len(order)

        def kept(values: Array) -> Array:
            out = np.zeros((len(self.cells), *values.shape[1:]), dtype=values.dtype)
            out[:count] = values[order]
            return out

        self._zero, self._status = np.zeros((len(self.cells), 3)), np.zeros(len(self.cells), dtype=np.int8)
        self._force = kept(force)
        new = self._force[count:]
        passed.force(force, new)
        self._last = None if len(passed.heirs) else self._last and (kept(self._last[0]), kept(self._last[1]))
        self._y = kept(self._y)
        self._image = self._apply(self._force)
        self.history = history.rearranged(order, len(entering))
        heirs, main = passed.main(np.einsum("ij,ij->i", force, force))
        known = history.body[main] >= 0
        heirs, main = heirs[known] + count, main[known]
        if len(heirs):
            at = self.points[heirs] + self._image[heirs]
            self.history.inherit(heirs, history, main, self._bodies, at)
        if self._step is not None:
            self._step = self._carried_over(self._step, order, heirs, main)
        self._at_rest = False

    def _change(self, leaving: Indices, entering: Indices) -> Indices:
        """Go over to other cells; return where each point that stays was."""
        order = self._matrix.change(leaving, entering)
        self._number()
        self._candidates.renumber(order, self._matrix.matrix, self._rho[:, 0])
        return order

    def _number(self) -> None:
        """Set what belongs to the points."""
        cells, pad = self._matrix.cells, self.surface
        self._place[:] = -1
        self._place[cells] = np.arange(len(cells))
        self.points, self.areas = pad.cells.positions[cells], pad.cells.areas[cells]
        self._spacing = self._tree.sides[cells]
        diagonal = self._matrix.matrix.diagonal().reshape(-1, 3).astype(np.float64)
        self._rho = WEIGHT * diagonal.mean(axis=1, keepdims=True)

    def _carried_over(self, step: PathStep, order: Indices, heirs: Indices, main: Indices) -> PathStep:
        """Return the last frame's step with its gaps at the present points."""
        gaps = step.gaps
        if gaps is None:
            return step
        n, count = len(self.cells), len(order)
        gap, clearance = np.full(n, np.inf), np.full(n, np.inf)
        normal, body, triangle = np.zeros((n, 3)), np.full(n, -1), np.full(n, -1)
        friction, softness = np.zeros(n), np.zeros(n)
        here, there = np.concatenate([np.arange(count), heirs]), np.concatenate([order, main])
        for new, old in (
            (gap, gaps.gap),
            (clearance, gaps.clearance),
            (normal, gaps.normal),
            (body, gaps.body),
            (triangle, gaps.triangle),
            (friction, gaps.friction),
            (softness, gaps.softness),
        ):
            new[here] = old[there]
        return replace(step, gaps=NodeGaps(gaps.bodies, gap, clearance, normal, body, triangle, friction, softness))

    # -- what the tree sees --------------------------------------------------------------------------------------

    def _sources(self) -> tuple[Indices, Array]:
        """Return for every cell with a known displacement a point that lies in it or that it lies in, and the mean."""
        chart = self.surface.chart
        place, mean = self._place.copy(), np.zeros((len(self._place), 3))
        mean[self.cells] = self._raised()
        cells = self.cells
        level = chart.levels[cells] if len(cells) else cells
        for above in range(len(chart.starts) - 2, 0, -1):
            own = cells[level == above]
            if not len(own):
                continue
            parents, which = np.unique(chart.parent(own), return_inverse=True)
            number = np.bincount(which)
            for k in range(3):
                mean[parents, k] = np.bincount(which, mean[own, k]) / number
            loads = place[own]
            place[parents[which]] = loads
            cells = np.concatenate([cells[level != above], parents])
            level = np.concatenate([level[level != above], np.full(len(parents), above - 1)])
        return place, mean

    def _raised(self) -> Array:
        """Return how far the points have moved [m], but for what spreads them along the skin.

        An edge parts the cells that it presses in between: only their common way is theirs, else they see it no more.
        """
        along = self.surface.cells.normals[self.cells]
        across = self._image - np.einsum("ij,ij->i", self._image, along)[:, None] * along
        load = np.sqrt(np.einsum("ij,ij->i", self._force, self._force))
        common = load @ across / max(float(load.sum()), 1e-300)
        return self._image - across + (common - (along @ common)[:, None] * along)

    def _turned(self, bodies: tuple[ContactBody, ...]) -> Array:
        expected = self.history.expected(bodies, self.points + self._image, self.search_radius)
        return expected.normal

    def _look_at(
        self,
        bodies: tuple[ContactBody, ...],
        sources: tuple[Indices, Array],
        normal: Array,
        cells: Indices,
        points: Array,
    ) -> NodeGaps:
        place, mean = sources
        chart = self.surface.chart
        up = cells
        while True:
            lost = np.flatnonzero(place[up] == UNKNOWN)
            lost = lost[chart.levels[up[lost]] > 0]
            if not len(lost):
                break
            up = up.copy()
            up[lost] = chart.parent(up[lost])
        gaps = self._look_for(bodies, normal, place[up], points + mean[up])
        new = np.flatnonzero((place[up] == UNKNOWN) & (gaps.clearance < NEAR_BASE))
        if len(new) and self._force.any():
            found = np.unique(up[new])
            place[found], mean[found] = NOBODY, self._far(found)
            gaps = self._look_for(bodies, normal, place[up], points + mean[up])
        return gaps

    def _look_for(self, bodies: tuple[ContactBody, ...], normal: Array, owner: Indices, places: Array) -> NodeGaps:
        gaps = node_gaps(places, bodies, self.search_radius, self.bone)
        own = np.flatnonzero(owner >= 0)
        above = normal[owner[own]]
        same = self.history.body[owner[own]] == gaps.body[own]
        turned = own[same & (np.einsum("ij,ij->i", above, gaps.normal[own]) < OPPOSITE)]
        if not len(turned):
            return gaps
        # the other side of something thin: what is seen there is not what the skin lies on
        before = normal[owner[turned]]
        body = self.history.body[owner[turned]]
        expected = Expected(places[turned], places[turned] + ABOVE * before, before, body)
        again = node_gaps(places[turned], bodies, self.search_radius, self.bone, expected)
        gaps.clearance[turned], gaps.normal[turned] = again.clearance, again.normal
        return gaps

    def _far(self, cells: Indices) -> Array:
        """Return the displacement of cells of the coarsest level beside the points [m], by the forces under each."""
        loaded = np.flatnonzero(self._force.any(axis=1))
        base = self.cells[loaded]
        for _ in range(len(self.surface.chart.starts) - 2):
            base = np.maximum(self.surface.chart.parent(base), np.where(self.surface.chart.levels[base] > 0, 0, base))
        missing = cells[np.isnan(self._rows[cells, 0, 0])]
        if len(missing):
            every = self.surface.chart.base
            self._rows[missing] = self.surface.rows(missing, every).reshape(len(missing), 3, -1)
        force = np.zeros((len(self._rows), 3))
        np.add.at(force, base, self._force[loaded])
        return (self._rows[cells] @ force.reshape(-1).astype(np.float32)).astype(np.float64)

    # -- the compliance ------------------------------------------------------------------------------------------

    def _apply(self, force: Array) -> Array:
        return self._matrix.displacement(force)

    def _exactly(self, near: Indices, b: Array, gaps: NodeGaps, soft: Array, start: Array) -> tuple[Array, int, str]:
        """Iterate in double precision; what else there is takes minutes on so many points."""
        cells, rho = self.cells[near], np.repeat(self._rho[near, 0], 3)
        matrix = self.surface.block(cells, cells).reshape(rho.size, -1)
        matrix[np.diag_indices(rho.size)] += np.repeat(soft, 3)
        normal, friction = gaps.normal[near], gaps.friction[near]
        first = project(start, normal, friction)[0]
        image = matrix @ first.reshape(-1)
        state = State(first, -(image + b.reshape(-1)).reshape(-1, 3) / self._rho[near])
        inverse = np.linalg.inv(matrix + np.diag(rho))
        found = iterate(
            inverse, rho, b.reshape(-1), normal, friction, state, state, image, self.tolerance, MOST_ITERATIONS
        )
        return found.state.z, found.iterations, "admm"

"""Contact along a path on free points of the smooth skin, as fine as what presses into it is bent.

As `PathSolver`, with points that come and go: a tree of cells is asked wherever something has moved, the compliance of
those cells that may touch is kept up, and what friction remembers goes from cells to the ones that take their place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ...arrays import Array, Indices
from ...skin.nodal_forces import NodalForces
from ...skin.surface_compliance import SurfaceCompliance
from ...surface.gap import Surface
from .admm import State, iterate
from .bodies import ContactBody, Expected, NodeGaps, moved, node_gaps, travel
from .candidates import CandidateInverse
from .compliance import Linear
from .cone import project
from .flatness import flat_reach
from .history import ContactHistory
from .path import BONE, DEPTH_LIMIT, MARGIN, PathSolver, PathStep
from .point_history import succession
from .point_map import NONE, PointMap
from .point_matrix import PointMatrix
from .point_tree import CORNERS, MANY, OFTEN, PointTree, Seen

TOLERANCE = 3e-4
# Points join the iteration ahead of time below the first of these shares of their cell's side, and leave it above the
# second: they have rows of the compliance already, so it takes little to join. At most so many do at once.
MEMBERS = (0.1, 0.3, 48)
# Skin is looked for this far out [m].
REACH = 2.5e-3
MOST_ITERATIONS = 3000
# The shift of the iteration over a cell's own compliance.
WEIGHT = 0.75
# A corner of a cell is reached from this far above it [m].
ABOVE = 0.4e-3
# Normals that differ by more than this cosine says are of the two sides of something thin, or of a needle.
OPPOSITE = -0.7
# The points are changed before a frame is looked at where it moves less than this [m]; else on its way.
SLOW = 0.15e-3


_PER_POINT = ("gap", "clearance", "normal", "body", "triangle", "friction", "softness")


class _Asked(NamedTuple):
    """The bodies when the tree was asked last, and how far the skin had moved along itself [m]."""

    bodies: tuple[ContactBody, ...]
    common: Array


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
        self._tree = PointTree(surface, REACH)
        self._matrix = PointMatrix(surface)
        self.operator = Linear(np.zeros((0, 0)))
        self._place = np.full(len(surface.chart.places), -1)  # of each cell in `cells`
        self._candidates = CandidateInverse(self._matrix.matrix, np.zeros(0), *MEMBERS)
        self._map = PointMap(surface.chart, CORNERS)
        self.history = ContactHistory(0)
        self._asked: _Asked | None = None
        starts = surface.chart.starts
        self._pad = surface.cells.positions[starts[1] : starts[2]]
        self._sample = self._pad[:: max(len(self._pad) // 32, 1)]
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

    def pressing(self, start: Sequence[ContactBody], gaps: NodeGaps, nodes: Indices) -> float:
        """Return how far matter moves along its own normal at points [m].

        Gaps would tell it only of bodies that change their shape: where a surface turns they jump.
        """
        far, which = 0.0, gaps.body[nodes]
        for i in np.unique(which).tolist():
            a, b, own = start[i], gaps.bodies[i], nodes[which == i]
            if a.surface is b.surface:
                way = np.einsum("ij,ij->i", moved(a, b, self.points[own]), gaps.normal[own])
                far = max(far, float(np.abs(way).max()))
            else:
                far = max(far, super().pressing(start, gaps, own))
        return far

    def nodal(self, force: Array) -> Array:
        """Return forces on the points [N] as forces on the nodes of the skin's mesh, shape (m, 3)."""
        return force if self.nodes is None else self.nodes.spread(self.cells, force)

    def look(self, bodies: Sequence[ContactBody]) -> NodeGaps:
        """Measure the next frame's gaps, without taking it."""
        before, some = self._bodies, self._sample
        slow = len(before) == len(bodies) and all(
            travel(a, b, some) <= SLOW for a, b in zip(before, bodies, strict=True)
        )
        return self._looked(tuple(bodies), slow)

    def step(
        self,
        bodies: Sequence[ContactBody],
        *,
        scene_frame: float | None = None,
        gaps: NodeGaps | None = None,
        part: bool = False,
    ) -> PathStep:
        """Solve the next frame, as `PathSolver.step` does."""
        if gaps is None and (part or not self.unmoved(bodies)):
            gaps = self._looked(tuple(bodies), True)
        return super().step(bodies, scene_frame=scene_frame, gaps=gaps, part=part)

    def _looked(self, bodies: tuple[ContactBody, ...], slow: bool) -> NodeGaps:
        """Measure gaps, at other points where the tree asks for them and bodies move slowly."""
        moved = self._moved(bodies)
        if self.fresh:
            if moved is None or self._tree.asks(moved):
                self._survey(bodies, moved, None)
            return super().look(bodies) if len(self.cells) else NodeGaps.nothing(bodies, 0)
        gaps = super().look(bodies)
        if slow and (moved is None or self._tree.asks(moved)):
            found = self._survey(bodies, moved, gaps)
            assert found is not None
            return found
        return gaps

    # -- the points ----------------------------------------------------------------------------------------------

    def _moved(self, bodies: Sequence[ContactBody]) -> Array | None:
        """Return how far anything moved along the skin, and towards it, since the tree was asked [m].

        None where that cannot be said.
        """
        asked = self._asked
        if asked is None or len(asked.bodies) != len(bodies):
            return None
        loaded = self.loaded.nonzero()[0]
        points, normal = self._sample, None
        if loaded.size and self._step is not None and self._step.gaps is not None:
            points, normal = self.points[loaded], self._step.gaps.normal[loaded]
        far = near = 0.0
        for a, b in zip(asked.bodies, bodies, strict=True):
            if a is b or (a.away and b.away):
                continue
            if a.away or b.away:
                return None
            if a.surface is not b.surface:
                reach = _deformed(a, b)
                if reach is None:
                    return None
                far, near = max(far, reach), max(near, reach)
                continue
            way = moved(a, b, points)
            across = way - (self._common() - asked.common)
            far = max(far, float(np.einsum("ij,ij->i", across, across).max()) ** 0.5)
            near = max(near, far if normal is None else float(np.abs(np.einsum("ij,ij->i", way, normal)).max()))
        return np.array([far, near])

    def _survey(self, bodies: tuple[ContactBody, ...], moved: Array | None, gaps: NodeGaps | None) -> NodeGaps | None:
        """Ask the tree which cells may touch, and go over to them; return their gaps if those of the last are given."""
        if moved is None:
            self._tree.renew()
        before, force, history = self.cells, self._force, self.history
        raised = np.concatenate([self._raised(), np.zeros((1, 3))])

        def look(cells: Indices, points: Array, centres: int) -> Seen:
            return self._look_at(bodies, raised, cells, points, centres)

        def glance(cells: Indices) -> tuple[Array, Array, Array, Indices]:
            assert gaps is not None
            return self._glance_at(gaps, raised, cells)

        seen = glance if gaps is not None and len(before) > 0 else None
        found = self._tree.survey(look, seen, np.zeros(2) if moved is None else moved)
        self._asked = _Asked(bodies, self._common())
        if self._tree.finest < OFTEN:
            self.notes.warn(
                "too-fine",
                "contact has more edges than points may follow: it is solved on coarser ones",
                self.frames,
                value=f"{len(found)} points",
                limit=f"<= {MANY}",
                remedy="Press less deep, or touch with fewer edges at once",
            )
        inside = np.zeros(len(self._place), dtype=bool)
        inside[found] = True
        leaving = np.flatnonzero(~inside[before])
        entering = found[self._place[found] < 0]
        if len(leaving) == 0 and len(entering) == 0:
            return gaps
        passed = succession(self.surface.chart, before[leaving], leaving, entering)
        order = self._change(leaving, entering)
        count = len(order)

        def kept(values: Array) -> Array:
            out = np.zeros((len(self.cells), *values.shape[1:]), dtype=values.dtype)
            out[:count] = values[order]
            return out

        self._zero, self._status = np.zeros((len(self.cells), 3)), np.zeros(len(self.cells), dtype=np.int8)
        self._force = kept(force)
        passed.force(force, self._force[count:])
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
        return None if gaps is None else self._completed(gaps, order, bodies)

    def _completed(self, gaps: NodeGaps, order: Indices, bodies: tuple[ContactBody, ...]) -> NodeGaps:
        """Return the gaps of the present points: those that stay were measured already."""
        n, count = len(self.cells), len(order)
        if count == n:
            return NodeGaps(bodies, *(getattr(gaps, name)[order] for name in _PER_POINT))
        new = np.arange(count, n)
        expected = self.history.expected(bodies, self.points + self._image, self.search_radius)
        places, origins, normal = expected.places[count:], expected.origins[count:], expected.normal[count:]
        # what a larger cell lay on need not be what its parts lie on, but where that is the back of something thin
        some = Expected(places, origins, normal, np.full(n - count, -1))
        found = node_gaps(self.points[new], bodies, self.search_radius, self.bone, some)
        opposite = np.einsum("ij,ij->i", normal, found.normal) < OPPOSITE
        turned = np.flatnonzero(opposite & (expected.body[count:] == found.body))
        if len(turned):
            some = Expected(places[turned], origins[turned], normal[turned], found.body[turned])
            again = node_gaps(self.points[new[turned]], bodies, self.search_radius, self.bone, some)
            for name in _PER_POINT:
                getattr(found, name)[turned] = getattr(again, name)
        parts = ((getattr(gaps, name)[order], getattr(found, name)) for name in _PER_POINT)
        return NodeGaps(bodies, *(np.concatenate(pair) for pair in parts))

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
        self._map.mark(cells)
        self.points, self.areas = pad.cells.positions[cells], pad.cells.areas[cells]
        self._spacing = self._tree.sides[cells]
        diagonal = self._matrix.matrix.diagonal().reshape(-1, 3).astype(np.float64)
        self._rho = WEIGHT * diagonal.mean(axis=1, keepdims=True)

    def _carried_over(self, step: PathStep, order: Indices, heirs: Indices, main: Indices) -> PathStep:
        """Return the last frame's step with its gaps at the present points."""
        gaps = step.gaps
        if gaps is None:
            return step
        count = len(order)
        here, there = np.concatenate([np.arange(count), heirs]), np.concatenate([order, main])
        nothing = NodeGaps.nothing(gaps.bodies, len(self.cells))
        for name in _PER_POINT:
            getattr(nothing, name)[here] = getattr(gaps, name)[there]
        return replace(step, gaps=nothing)

    # -- what the tree sees --------------------------------------------------------------------------------------

    def _common(self) -> Array:
        """Return how far the skin that touches has moved along itself, by its share of the load [m], shape (3,)."""
        load = np.sqrt(np.einsum("ij,ij->i", self._force, self._force))
        total = float(load.sum())
        if total == 0.0:
            return np.zeros(3)
        along = self.surface.cells.normals[self.cells]
        across = self._image - np.einsum("ij,ij->i", self._image, along)[:, None] * along
        return np.asarray(load @ across / total)

    def _raised(self) -> Array:
        """Return how far the points have moved [m], but for what spreads them along the skin, shape (n, 3).

        An edge parts the cells that it presses in between. Only their common way is theirs, else they see it no more.
        """
        along, common = self.surface.cells.normals[self.cells], self._common()
        return common + np.einsum("ij,ij->i", self._image - common, along)[:, None] * along

    def _glance_at(self, gaps: NodeGaps, raised: Array, cells: Indices) -> tuple[Array, Array, Array, Indices]:
        """Tell of cells what the points under them and beside them see."""
        five = self._map.around(cells)
        under = five[:, 0].copy()
        under[under == NONE] = self._map.under(cells[under == NONE]).max(axis=1)
        known = (under != NONE) & (gaps.body[under] >= 0)
        none = (five == NONE) | (gaps.body[five] < 0)
        five = np.where(none, under[:, None], five)
        centre = self.surface.cells.positions[cells][:, None]
        places = np.concatenate([centre, self._tree.corner_points(cells).reshape(-1, 4, 3)], axis=1)
        way = places + raised[under][:, None] - (self.points + raised[:-1])[five]
        normal = gaps.normal[five]
        gap = gaps.clearance[five] + np.einsum("nck,nck->nc", way, normal)
        return gap[:, 0], gap[:, 1:], normal[:, 1:], known + (known & ~none.any(axis=1)).astype(np.int64)

    def _look_at(
        self, bodies: tuple[ContactBody, ...], raised: Array, cells: Indices, points: Array, centres: int
    ) -> Seen:
        found = self._map.under(cells)
        owner = found.max(axis=1)
        shift = raised[found].sum(axis=1) / np.maximum((found != NONE).sum(axis=1), 1)[:, None]
        afar = np.flatnonzero(owner == NONE)
        if len(afar) and self._force.any():
            base, which = np.unique(self.surface.chart.tiles.root[cells[afar]], return_inverse=True)
            shift[afar] = self._far(base)[which]
        places = points + shift
        gaps = node_gaps(places, bodies, self.search_radius, self.bone)
        self._put_on_their_side(bodies, gaps, owner, places)
        flat = np.zeros(centres)
        for index, body in enumerate(bodies):
            own = np.flatnonzero(gaps.body[:centres] == index)
            if not isinstance(body.surface, Surface):
                flat[own] = np.inf
            elif len(own) and not body.deforms:
                on = places[own] - gaps.clearance[own, None] * gaps.normal[own]
                flat[own] = flat_reach(body.surface, gaps.triangle[own], (on - body.translation) @ body.rotation)
        return Seen(gaps.clearance, gaps.normal, flat)

    def _put_on_their_side(
        self, bodies: tuple[ContactBody, ...], gaps: NodeGaps, owner: Indices, places: Array
    ) -> None:
        """Look again for those that see the other side of something thin: it is not what the skin lies on."""
        own = np.flatnonzero(owner >= 0)
        own = own[self.history.body[owner[own]] == gaps.body[own]]
        if not len(own):
            return
        before = self.history.normals(bodies)[owner[own]]
        other = np.flatnonzero(np.einsum("ij,ij->i", before, gaps.normal[own]) < OPPOSITE)
        if not len(other):
            return
        turned, before = own[other], before[other]
        expected = Expected(places[turned], places[turned] + ABOVE * before, before, gaps.body[turned])
        again = node_gaps(places[turned], bodies, self.search_radius, self.bone, expected)
        gaps.clearance[turned], gaps.normal[turned] = again.clearance, again.normal
        gaps.triangle[turned] = again.triangle

    def _far(self, cells: Indices) -> Array:
        """Return the displacement of cells of the coarsest level beside the points [m], by the forces under each."""
        loaded = np.flatnonzero(self._force.any(axis=1))
        base = self.surface.chart.tiles.root[self.cells[loaded]]
        under, which = np.unique(base, return_inverse=True)
        force = np.zeros((len(under), 3))
        np.add.at(force, which, self._force[loaded])
        return np.asarray(np.einsum("nmij,mj->ni", self._matrix.coarse(cells, under), force), dtype=np.float64)

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


def _deformed(a: ContactBody, b: ContactBody) -> float | None:
    """Return how far the vertices of a body moved that changed its shape [m]; None where they are others."""
    if not (isinstance(a.surface, Surface) and isinstance(b.surface, Surface)):
        return None
    if not np.array_equal(a.surface.triangles, b.surface.triangles):
        return None
    one = a.surface.vertices @ a.rotation.T + a.translation
    other = b.surface.vertices @ b.rotation.T + b.translation
    return float(np.sqrt(((other - one) ** 2).sum(axis=1).max()))

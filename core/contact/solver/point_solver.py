"""Contact along a path, on points of the smooth skin.

The points are finer where the objects are curved.

`PointSolver` works like `PathSolver`, but its set of points changes from frame to frame. If a body has moved, a
quadtree finds the cells that may touch (see `PointTree`). Their centres are the points, and the compliance matrix
between them is updated. If a cell is split or merged, its friction history passes to the cells that replace it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...arrays import Array, Floats32, Indices
from ...skin.nodal_forces import NodalForces
from ...skin.surface_compliance import SurfaceCompliance
from .bodies import ContactBody, NodeGaps, least_gaps, paired, same_places, travel
from .compliance import own_compliance
from .cone import mean_displacement
from .history import ContactHistory
from .law_skin import LawSkin
from .path_solver import BONE, DEPTH_LIMIT, TOLERANCE, PathSolver
from .path_step import PathStep
from .point_gaps import passed_on
from .point_reach import PointReach
from .point_set import PointSet
from .point_tree import FINEST, MANY, PointTree
from .posed_records import corners_about, in_reach
from .smooth_contact import SmoothContact
from .succession import succession

# Largest distance at which a body is found from the skin [m].
REACH = 2.5e-3
# While no body moves, the last forces are kept if their residual is below this. The gaps still change a little, because
# they are measured from the displaced skin, whose position converges over a few frames.
STANDS = 3e-3
# If bodies move less than this in a frame [m], the points are changed before its gaps are measured. If they move
# farther, the frame is solved in parts, and the points are changed at each part.
SLOW = 0.15e-3


class PointSolver(PathSolver):
    """Contact of one finger on its smooth pad, frame after frame.

    Args:
        surface: compliance between cells of the pad.
        nodes: converts forces on cells to forces on the nodes of a mesh. If it is None, forces stay on the cells, and
            the skin must be linear.

    All other arguments are those of `PathSolver`.

    Attributes:
        cells: indices of the chart's cells whose centres are the points of this frame, shape (n,).
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
        law: LawSkin | None = None,
    ) -> None:
        self._begin(tolerance, bone, name, depth_limit, law)
        self.surface, self._spread = surface, nodes
        self.search_radius = REACH
        self._tree = PointTree(surface)
        self._points = self._contact_points = PointSet(surface)
        self._contact = SmoothContact(REACH, self.bone)
        self.history = ContactHistory(0)
        self._asked: tuple[ContactBody, ...] | None = None
        self._calm: NodeGaps | None = None  # the last measured gaps; None if the tree was due for a survey then
        starts = surface.chart.starts
        self._pad = surface.cells.positions[starts[1] : starts[2]]
        self._corners = corners_about(self._pad)
        self._sample = self._pad[:: max(len(self._pad) // 32, 1)]
        self._reach = PointReach(self._points)
        self._number()
        self.reset()

    @property
    def cells(self) -> Indices:
        """The cells whose centres are points, shape (n,)."""
        return self._points.cells

    @property
    def pad(self) -> Array:
        """Points of undeformed skin that detect first contact [m], shape (n, 3)."""
        return self._pad

    def outside(self, bodies: Sequence[ContactBody], reach: float = np.inf) -> float:
        """Return the smallest gap of the undeformed skin [m].

        It is inf if no body is within reach.
        """
        if not all(body.away or body.surface.closed for body in bodies):
            return super().outside(bodies, reach)
        # The gaps of two points differ by at most their distance, so skin far from the closest point can be left out.
        sizes = self._reach.sizes
        gap = least_gaps(self.places, bodies, reach + float(sizes.max()), self.bone)
        closest = float((gap + sizes).min())
        if not np.isfinite(closest):
            return np.inf
        near = (gap - sizes <= closest).nonzero()[0]
        return float(least_gaps(self._pad.reshape(-1, 4, 3)[near].reshape(-1, 3), bodies, reach, self.bone).min())

    @property
    def places(self) -> Array:
        """Centres of the coarsest cells, which cover the pad [m], shape (p, 3)."""
        return self._reach.places

    @property
    def reach(self) -> Array:
        """Radius around each of `places` [m], shape (p,).

        A sphere of this radius contains the skin of the cell in the next frame.
        """
        sizes = self._reach.sizes
        return sizes + self._bulge(self._reach.moved(self._force, self._image)) if self.loaded.any() else sizes

    def reset(self) -> None:
        """Forget the history: the next frame is solved from rest."""
        self._asked = None
        self._tree.reset()
        self._new = 0
        self._change(np.arange(len(self.cells)), np.zeros(0, dtype=np.int64))
        super().reset()

    def save(self) -> dict[str, Any]:
        """Return the state between two frames, for `restore`."""
        own = {"points": self._points.save(), "asked": self._asked, "new": self._new, "finest": self._tree.finest}
        return {**super().save(), **own}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to a saved state, with its points."""
        self._points.restore(state["points"])
        self._number()
        self._asked, self._new, self._tree.finest = state["asked"], state["new"], state["finest"]
        super().restore(state)

    def nodal(self, force: Array) -> Array:
        """Return forces on the nodes of the skin's mesh [N], shape (m, 3).

        If `nodes` is None, the forces on the points are returned.
        """
        return force if self._spread is None else self._spread.spread(self.cells, force)

    def beyond(self) -> Array:
        assert self.law is not None and self._spread is not None, "the law is that of a mesh"
        return self._spread.gather(self.cells, self.law.beyond)

    def look(self, bodies: Sequence[ContactBody]) -> NodeGaps:
        """Measure the next frame's gaps, without solving the frame."""
        slow = all(travel(a, b, self._sample) <= SLOW for a, b in paired(self._bodies, bodies))
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
        # If bodies moved far in this frame, its gaps were measured at the points of the frame before.
        late = gaps is None or not (part or gaps is self._calm) and self._asks(bodies)
        if late and (part or not self.unmoved(bodies)):
            gaps = self._looked(tuple(bodies), True)
        return super().step(bodies, scene_frame=scene_frame, gaps=gaps, part=part)

    def _looked(self, bodies: tuple[ContactBody, ...], slow: bool) -> NodeGaps:
        """Measure gaps.

        If a survey is due, the points are changed first, provided that the bodies move slowly or that the history is
        empty.
        """
        asks = self._asks(bodies)
        if asks and (slow or self.fresh):
            self._survey(bodies)
        if self.fresh and not len(self.cells):
            return NodeGaps.nothing(bodies, 0)
        expected = self._expected(bodies)
        gaps = self._contact.look(self._points, bodies, expected - self.points)
        self._calm = None if asks else gaps
        return gaps

    # -- the points ----------------------------------------------------------------------------------------------

    def _asks(self, bodies: Sequence[ContactBody]) -> bool:
        """Return whether a new survey of the points is due: at first, and whenever a body near the pad has changed."""
        return self._asked is None or any(
            not a.same_place(b) and any(in_reach(body, self._corners, REACH) for body in (a, b))
            for a, b in paired(self._asked, bodies)
        )

    def _survey(self, bodies: tuple[ContactBody, ...]) -> None:
        """Find the cells that may touch, and make them the points.

        They are found by a survey of the tree.
        """
        drag = mean_displacement(self._force, self._image)
        found = self._tree.survey(bodies, REACH, self.bone, self.cells[self.loaded], drag)
        self._asked = bodies
        leaving, entering = self._points.difference(found)
        if len(leaving) or len(entering):
            tiles, left = self.surface.chart.tiles, self.cells[leaving]
            force, main = succession(tiles, left, leaving, entering, self._force)
            self._inherit(force, main, self._change(leaving, entering))

    def _change(self, leaving: Indices, entering: Indices) -> Indices:
        """Remove and add points; return the former index of each point that stays."""
        order = self._points.change(leaving, entering)
        self._number()
        return order

    def _number(self) -> None:
        """Update all data that depend on the set of points."""
        self.points, self.areas = self._points.positions, self._points.areas
        self._own = own_compliance(self._points.matrix.matrix)
        self._zero, self._status = np.zeros((len(self.cells), 3)), np.zeros(len(self.cells), dtype=np.int8)

    def _inherit(self, inherited: Array, main: Indices, order: Indices) -> None:
        """Set the state of each point after a change of the points.

        A point that stays keeps its state. A new point takes the state of the cells that it replaces.

        Args:
            inherited: forces on the new points [N], shape (j, 3).
            main: former point whose friction history each new point takes; -1 for none, shape (j,).
            order: former index of each point that stays.
        """
        count, new, history = len(order), len(main), self.history
        if self._last is not None:
            self._last = np.concatenate([self._last.take(order, axis=0), np.zeros((new, 3))])
        self._force = np.concatenate([self._force.take(order, axis=0), inherited])
        self._image = self._apply(self._force)
        heirs = (main >= 0).nonzero()[0]
        self._new = count if len(heirs) else count + new
        heirs = heirs[history.body[main[heirs]] >= 0]
        former = np.full(count + new, -1, dtype=np.int64)
        former[:count], former[count + heirs] = order, main[heirs]
        sunk, known = np.zeros((count + new, 3)), former >= 0
        sunk[known] = self._sunk[former[known]]  # a pressure's, so parts of a cell have that of the cell
        self._sunk = sunk
        self.history = history.rearranged(former)
        if len(heirs):
            heirs += count
            self.history.anchor(heirs, self._bodies, self.points[heirs] + self._touching[heirs])
        if self._step is not None and self._step.gaps is not None:
            self._step = replace(self._step, gaps=passed_on(self._step.gaps, former))
        self._at_rest = False

    # -- the compliance ------------------------------------------------------------------------------------------

    def _allowed(self, bodies: tuple[ContactBody, ...]) -> float:
        # If no body moves, gaps change only because the skin's position converges, so no new solution is needed.
        stands = self._step is not None and same_places(bodies, self._bodies)
        return STANDS if stands else super()._allowed(bodies)

    def _extrapolated(self, force: Array) -> Array:
        start = super()._extrapolated(force)
        if self._last is not None:  # new points have no force in the frame before the last
            new, self._new = slice(self._new, None), len(force)
            start[new] = force[new]
        return start

    def _report(self, step: PathStep, where: float) -> None:
        super()._report(step, where)
        if self._tree.finest < FINEST:
            self.notes.warn(
                "too-fine",
                "contact has too many edges for the finest points: it is solved on coarser ones",
                where,
                value=f"{len(self.cells)} coarser points",
                limit=f"<= {MANY} of the finest",
                remedy="Press less deep, or touch with fewer edges at once",
            )

    @property
    def _matrix(self) -> Floats32:
        return self._points.matrix.matrix

    def linear(self, force: Array) -> Array:
        return self._points.matrix.displacement(force)

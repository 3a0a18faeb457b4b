"""Contact along a path, frame after frame, with friction's history. Frames in which nothing changes are not solved.

If bodies have moved, the points at which contact is solved are changed (see `ContactPoints`). A frame is then solved in
four steps. The gaps are measured. The anchors give the offset b, which is shifted where the direction of slip turns
(`frame_friction.py`). The forces of the last two frames are extrapolated. From these forces, compiled sweeps go from
point to point until Coulomb's law holds, while the gaps follow (`smooth_contact.py`). For neo-Hookean tissue, contact
is solved on linear skin, displaced by the law's correction; then the correction is renewed, until the two agree
(`law_frame.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from ...errors import Finding
from ...kernels.library import kernels
from .bodies import BONE, ContactBody, NodeGaps, paired, same_places, travel
from .compliance import displaced
from .cone import assess, carrying
from .contact_points import Change, ContactPoints
from .frame_friction import UNMOVED, FrameFriction
from .history import ContactHistory
from .law_frame import solved_by_law
from .law_skin import Fold, LawSkin
from .notes import Notes
from .path_step import PathStep, SolvedFrame
from .point_gaps import passed_on
from .smooth_contact import SmoothContact
from .solution import Solution, status_of
from .sweeps import MOST_SWEEPS, sweep
from .within_frame import STILL

__all__ = ["DEPTH_LIMIT", "TOLERANCE", "PathSolver", "PathStep"]

# Residual at which sweeps stop, see `Solution.residual`. With this residual, other starting forces change the resulting
# forces by less than 0.01 %.
TOLERANCE = 3e-6
# A frame whose residual is above this multiple of the tolerance is a finding.
CHECK = 10.0
# The last forces are used again if their residual in the new frame is at most this multiple of the tolerance.
UNCHANGED = 1.0
# A frame that took at most this many sweeps counts as easy: the next one tries the last forces first.
EASY = 3
# Largest depth at which linear skin is trusted [m]; `presets/ACCURACY.md` has the error of its stress.
DEPTH_LIMIT = 2e-3
# In one frame skin bulges by no more than BULGE times its displacement in the last frame, plus MARGIN [m].
BULGE, MARGIN = 1.5, 0.3e-3
# If bodies move less than this in a frame [m], the points are changed before its gaps are measured. If they move
# farther, the frame is solved in parts, and the points are changed at each part.
SLOW = 0.15e-3
# Attributes that a frame changes, besides the history. Each is replaced, never changed in place.
_STATE = ("_force", "_last", "_new", "_image", "_sunk", "_step", "_bodies", "_at_rest", "frames", "_rubbing")


class PathSolver:
    """Contact of one finger, frame after frame.

    Args:
        contact_points: points of the finger's skin at which contact is solved.
        tolerance: largest residual accepted, see `Solution.residual`.
        bone: a point inside the finger [m]: open surfaces are touched on the side where it lies.
        name: for findings.
        depth_limit: depth of the undeformed skin beyond which a frame is a finding [m].
        law: the skin's nonlinear law, which corrects the displacement of linear skin; None for linear skin.

    Attributes:
        counters: number of frames of each kind. 'solved': sweeps ran. 'unchanged': the last forces satisfied the laws
            in the new frame. 'same': no body moved and no point slid. 'idle': nothing was near. 'held': see `adopt`.
            'unconverged': the solution is doubtful. 'parts' counts solved parts of frames that `SubStepper` divided.
        frames: number of frames so far.

    Raises:
        DermisError: no compiled kernels.
    """

    def __init__(
        self,
        contact_points: ContactPoints,
        *,
        tolerance: float = TOLERANCE,
        bone: Array = BONE,
        name: str = "finger",
        depth_limit: float = DEPTH_LIMIT,
        law: LawSkin | None = None,
    ) -> None:
        kernels()  # a skin does not work without them, and says so here
        self.contact_points = contact_points
        self.tolerance, self.depth_limit = tolerance, depth_limit
        self.bone = np.asarray(bone, dtype=np.float64)
        self.name = name
        self.law = law
        self.counters = dict.fromkeys(("solved", "unchanged", "same", "idle", "unconverged", "held", "parts"), 0)
        self.notes = Notes(name)
        self.frames = 0
        self._contact = SmoothContact(self.search_radius, self.bone)
        self._calm: NodeGaps | None = None  # the last measured gaps; None if a survey was due then
        self._sample = self.pad[:: max(len(self.pad) // 32, 1)]
        # forces, and which points they load: kept for the property `loaded`
        self._loaded: tuple[Array | None, NDArray[np.bool_]] = None, np.zeros(0, dtype=np.bool_)
        self.history = ContactHistory(len(self.points))
        self.reset()

    def reset(self) -> None:
        """Forget the history: the next frame is solved from rest."""
        self.contact_points.reset()
        self._number()
        self.history.clear()
        self._force = self._zero
        self._last: Array | None = None  # forces of the frame before
        self._new = len(self._zero)  # first of the points that had no force in the frame before
        self._image = self._sunk = self._zero
        self._rubbing = UNMOVED
        self._step: PathStep | None = None
        self._bodies: tuple[ContactBody, ...] = ()
        self._at_rest = False
        if self.law is not None:
            self.law.reset()

    def save(self) -> dict[str, Any]:
        """Return the state between two frames, for `restore`: a step may then be tried and taken back."""
        state = {name: getattr(self, name) for name in _STATE}
        state.update(points=self.contact_points.save(), history=self.history.save())
        state.update(counters=dict(self.counters), _notes=self.notes.copy())
        return state if self.law is None else {**state, "law": self.law.save()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to a saved state: the frames that follow are the same to the last bit."""
        self.contact_points.restore(state["points"])
        self._number()
        for name in _STATE:
            setattr(self, name, state[name])
        self.history = ContactHistory.restored(state["history"])
        self.counters, self.notes = dict(state["counters"]), state["_notes"].copy()
        if self.law is not None:
            self.law.restore(state["law"])

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Frames that did not converge, went too deep or have two solutions: the first frame and how often."""
        return self.notes.findings()

    def idle(self, count: int = 1) -> PathStep:
        """Take frames in which the broad phase found nothing near: nothing is solved, and the history is forgotten."""
        self.counters["idle"] += count
        self.frames += count
        if self._step is not None and self._step.work == "idle":
            return self._step
        self.reset()
        none = np.zeros(len(self._zero))
        nothing = Solution(self._zero, self._zero, self._zero, none, self._status, 0, 0.0, self.tolerance, "none")
        self._step = self._frame(nothing, self._zero, None, "idle", False)
        return self._step

    @property
    def fresh(self) -> bool:
        """Whether there is no history: the next frame is the first that touches or is near something."""
        return self.history.empty

    @property
    def bodies(self) -> tuple[ContactBody, ...]:
        """Bodies near in the last frame."""
        return self._bodies

    @property
    def points(self) -> Array:
        """The present points of the undeformed skin [m], shape (n, 3)."""
        return self.contact_points.positions

    @property
    def cells(self) -> Indices:
        """Index of each point among all points that the skin can have, shape (n,)."""
        return self.contact_points.cells

    @property
    def inward(self) -> Array:
        """Unit normals of the undeformed skin at the points, into the finger, shape (n, 3)."""
        return self.contact_points.inward

    @property
    def pad(self) -> Array:
        """Points of the undeformed skin that tell where anything first touches [m], shape (p, 3)."""
        return self.contact_points.pad

    @property
    def search_radius(self) -> float:
        """Largest distance at which a body is found [m]."""
        return self.contact_points.reach

    def outside(self, bodies: Sequence[ContactBody], reach: float = np.inf) -> float:
        """Return the smallest gap of the undeformed skin [m], inf where there is none within reach."""
        return self.contact_points.outside(bodies, reach, self.bone)

    @property
    def gaps(self) -> NodeGaps | None:
        """The gaps of the last frame; None where nothing was near."""
        return None if self._step is None or self.fresh else self._step.gaps

    @property
    def depth(self) -> float:
        """The penetration in the last frame [m]; see `PathStep.sums`."""
        return 0.0 if self._step is None else float(self._step.sums.depth)

    @property
    def loaded(self) -> NDArray[np.bool_]:
        """Which nodes carried force in the last frame, shape (m,)."""
        if self._loaded[0] is not self._force:
            last = None if self._step is None else self._step.solution
            self._loaded = (
                self._force,
                last.loaded if last is not None and last.force is self._force else carrying(self._force),
            )
        return self._loaded[1]

    @property
    def places(self) -> Array:
        """Places of the undeformed skin for which `reach` is given [m], shape (q, 3)."""
        return self.contact_points.places

    @property
    def reach(self) -> Array:
        """Radius about each of `places` within which the skin there is in the next frame [m], shape (q,).

        An object farther away is not touched. Without load the skin is undeformed, so it touches nothing before its gap
        is closed.
        """
        sizes = self.contact_points.sizes
        if not self.loaded.any():
            return sizes
        moved = self.contact_points.moved(self._force, self._image)
        return sizes + np.minimum(BULGE * moved + MARGIN, self.search_radius)

    @property
    def loaded_bodies(self) -> frozenset[int]:
        """Indices of the bodies that pressed in the last frame."""
        return frozenset(self.history.body[self.loaded].tolist())

    def step(
        self,
        bodies: Sequence[ContactBody],
        *,
        scene_frame: float | None = None,
        gaps: NodeGaps | None = None,
        part: bool = False,
    ) -> PathStep:
        """Solve the next frame.

        Args:
            bodies: those near, posed in the finger's frame; the same order every frame.
            scene_frame: frame number in the scene, for findings.
            gaps: as `look` returned them.
            part: whether this is a part of the way to a frame; then no finding is noted and no frame is counted.
        """
        bodies = tuple(bodies)
        if not part and self.unmoved(bodies):
            assert self._step is not None
            self.counters["same"] += 1
            self.frames += 1
            return replace(self._step, work="same", from_rest=False)
        # If bodies moved far in this frame, its gaps were measured at the points of the frame before.
        if gaps is None or not (part or gaps is self._calm) and self.contact_points.due(bodies):
            gaps = self._looked(bodies, True)
        if not (gaps.body >= 0).any():
            self._bodies = bodies
            return self.idle(0 if part else 1)
        return self.step_gaps(gaps, scene_frame=scene_frame, part=part)

    def unmoved(self, bodies: Sequence[ContactBody]) -> bool:
        """Return whether the next frame equals the last one, because all bodies rest where they were."""
        return self._at_rest and self._step is not None and same_places(bodies, self._bodies)

    def look(self, bodies: Sequence[ContactBody]) -> NodeGaps:
        """Measure the next frame's gaps without solving the frame."""
        return self._looked(tuple(bodies), False)

    def _looked(self, bodies: tuple[ContactBody, ...], at_once: bool) -> NodeGaps:
        """Measure gaps.

        If a survey is due, the points are changed first: at once, or if bodies move slowly, or without a history.
        """
        due = self.contact_points.due(bodies)
        if due and (at_once or self.fresh or self._slow(bodies)):
            change = self.contact_points.survey(bodies, self.bone, self.loaded, self._force, self._image)
            if change is not None:
                self._inherit(change)
        if self.fresh and not len(self.points):
            return NodeGaps.nothing(bodies, 0)
        # `ContactHistory` keeps anchors for this very tuple of bodies, so `offset` finds them
        gaps = self._contact.look(self.contact_points, bodies, self._expected(bodies) - self.points)
        self._calm = None if due else gaps
        return gaps

    def _slow(self, bodies: Sequence[ContactBody]) -> bool:
        return all(travel(a, b, self._sample) <= SLOW for a, b in paired(self._bodies, bodies))

    def _expected(self, bodies: Sequence[ContactBody]) -> Array:
        """Return the expected places of the skin in the next frame."""
        drift = self._rubbing.drift
        way = None if drift is STILL else (drift.moved, drift.passed)
        return self.history.expected(bodies, self.points + self._touching, self.search_radius, self._force, way)

    def step_gaps(self, gaps: NodeGaps, *, scene_frame: float | None = None, part: bool = False) -> PathStep:
        """Solve the next frame from gaps that were measured elsewhere."""
        from_rest = self.fresh
        b = self.history.offset(gaps, self.points)
        soft, points = gaps.compliance(self.contact_points.areas), self.contact_points
        friction = FrameFriction(gaps, self.history, self.loaded, points.compliance, points.own, soft)
        if not from_rest:
            friction.foresee(self._force, b, self._touching, self._rubbing.changing)
        solved = self._solve(b, gaps, soft)
        solution, image, work = solved.solution, solved.image, solved.work
        if solved.gaps is not None:
            gaps = friction.gaps = solved.gaps
        if not from_rest and work == "solved":
            friction.notice(solution)
        self._remember(solved, friction, soft)
        self._step = self._frame(solution, image, gaps, work, from_rest, part)
        if part:
            self.counters["parts"] += 1
            self._at_rest = False  # a part's step has no nodal forces, so no frame may return it
            return self._step
        return self._counted(self._step, work, scene_frame)

    def adopt(
        self, force: Array, displacement: Array, gaps: NodeGaps, residual: float, *, scene_frame: float | None = None
    ) -> PathStep:
        """Take over a frame that was solved together with other fingers.

        That solution has already updated the friction history.

        Args:
            force: forces on the nodes [N], shape (m, 3).
            displacement: relative displacement w of the nodes [m], shape (m, 3).
            gaps: the gaps that the frame was solved for.
            residual: residual of the contact laws.
        """
        from_rest = self._step is None or self._step.work == "idle"
        status = status_of(force, gaps.normal, gaps.friction)
        goal = CHECK * self.tolerance
        solution = Solution(force, displacement, gaps.normal, gaps.friction, status, EASY + 1, residual, goal, "sweeps")
        self._last, self._force, self._image = None, force, self._apply(force)
        self._sunk = gaps.compliance(self.contact_points.areas)[:, None] * force
        self._bodies, self._at_rest, self._rubbing = gaps.bodies, False, UNMOVED
        self._step = self._frame(solution, self._image, gaps, "solved", from_rest)
        return self._counted(self._step, "held", scene_frame)

    def _frame(
        self, solution: Solution, image: Array, gaps: NodeGaps | None, work: str, from_rest: bool, part: bool = False
    ) -> PathStep:
        nodal = self._zero if part else self.nodal(solution.force)
        return PathStep(solution, image, gaps, work, from_rest, nodal, self.amounts, self.points, self.bone)

    def _counted(self, step: PathStep, kind: str, scene_frame: float | None) -> PathStep:
        """Return a solved frame, counted as one of a kind and with its findings noted."""
        self._report(step, self.frames if scene_frame is None else scene_frame)
        self.counters[kind] += 1
        self.frames += 1
        return step

    # -- one frame -----------------------------------------------------------------------------------------------

    def _solve(self, b: Array, gaps: NodeGaps, soft: Array) -> SolvedFrame:
        normal, mu = gaps.normal, gaps.friction
        start, image = self._force, self._image
        gone = (gaps.body < 0) & self.loaded
        if gone.any():  # nothing is near these nodes any more, so their forces vanish first
            start = np.where(gone[:, None], 0.0, start)
            image = self._apply(start)
        allowed = self._allowed(gaps.bodies)
        if allowed:
            w = image + soft[:, None] * start + b
            residual, status = assess(start, w, normal, mu, 1.0 / (self.contact_points.own + soft)[:, None])
            if residual <= allowed:
                method = "sweeps" if start.any() else "none"
                goal = max(CHECK * self.tolerance, allowed)
                solution = Solution(start, w, normal, mu, status, 0, residual, goal, method)
                return SolvedFrame(solution, image, "unchanged")
        begin = self._extrapolated(start)
        return (
            self.iterated(b, None, gaps, soft, begin)
            if self.law is None
            else solved_by_law(self, self.law, b, gaps, soft, begin)
        )

    def iterated(self, b: Array, shift: Array | None, gaps: NodeGaps, soft: Array, start: Array) -> SolvedFrame:
        """Solve a frame on linear skin from forces to start from [N], shape (m, 3); see `LinearContact.iterated`."""
        if gaps.where is not None:
            return self._contact.solve(
                self.contact_points, b, gaps, start, shift, self.tolerance, CHECK * self.tolerance
            )
        normal, mu = gaps.normal, gaps.friction
        b = b if shift is None else b + shift
        found = sweep(self.contact_points.compliance, b, normal, mu, soft, start, self.tolerance, MOST_SWEEPS)
        w, status, goal = found.displacement, found.status, CHECK * self.tolerance
        solution = Solution(found.force, w, normal, mu, status, found.sweeps, found.residual, goal, "sweeps")
        return SolvedFrame(solution, found.image, "solved")

    def _allowed(self, bodies: tuple[ContactBody, ...]) -> float:
        """Return the residual up to which the last forces are used again; 0 if they are not to be tried."""
        stands = self.contact_points.stands
        if stands and self._step is not None and same_places(bodies, self._bodies):
            return stands
        if self.law is not None and not self.law.settled:
            return 0.0
        # after a frame that took more sweeps the last forces hardly ever serve again
        easy = self._step is None or self._step.solution.iterations <= EASY
        return UNCHANGED * self.tolerance if easy else 0.0

    def _extrapolated(self, force: Array) -> Array:
        """Return the forces extrapolated from the last two frames."""
        if self._last is None:
            return force
        start, new = 2.0 * force - self._last, slice(self._new, None)
        self._new, start[new] = len(force), force[new]
        return start

    def _remember(self, solved: SolvedFrame, friction: FrameFriction, soft: Array) -> None:
        """Keep the forces, the displacement and the friction history of a frame."""
        solution = solved.solution
        slides = friction.keep(solution, self.points, solved.image)
        sunk = soft[:, None] * solution.force
        self._rubbing = friction.left(solution, self._force, solved.image + sunk - self._touching)
        self._at_rest = not slides
        self._last = self._force if self._force.any() else None
        self._force, self._image, self._sunk = solution.force, solved.image, sunk
        self._bodies = friction.gaps.bodies

    # -- the points ----------------------------------------------------------------------------------------------

    def _number(self) -> None:
        """Update what only depends on the number of points."""
        self._zero, self._status = np.zeros((len(self.points), 3)), np.zeros(len(self.points), dtype=np.int8)

    def _inherit(self, change: Change) -> None:
        """Set the state of each point after a change of the points.

        A point that stays keeps its state. A new point takes the state of those that it replaces.
        """
        order, main, history = change.order, change.main, self.history
        count, new = len(order), len(main)
        self._number()
        if self._last is not None:
            self._last = np.concatenate([self._last.take(order, axis=0), np.zeros((new, 3))])
        self._force = np.concatenate([self._force.take(order, axis=0), change.inherited])
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

    # -- small parts ---------------------------------------------------------------------------------------------

    @property
    def amounts(self) -> Array | None:
        """Displacement of the pad nodes on linear skin minus that by the law [m], shape (3 m,); None on linear skin."""
        return None if self.law is None else self.law.amounts

    @property
    def _touching(self) -> Array:
        """Where the points touch, from where they are at rest [m], shape (n, 3).

        The surface of a soft body gives way below a point. Gap and friction follow the place on the surface as if it
        had not: the place of the deformed point plus that by which the surface gives way.
        """
        return self._image + self._sunk

    def _apply(self, force: Array) -> Array:
        """Return the displacement under forces [m], shape (n, 3)."""
        linear = self.linear(force)
        return linear if self.law is None else linear - self.beyond()

    def beyond(self) -> Array:
        """Return the displacement on linear skin minus that by the law [m], shape (n, 3); only for skin with a law."""
        assert self.law is not None
        return self.contact_points.at_points(self.law.beyond)

    def linear(self, force: Array) -> Array:
        """Return the displacement of linear skin under forces [m], shapes (n, 3) to (n, 3)."""
        return displaced(self.contact_points.compliance, force)

    def nodal(self, force: Array) -> Array:
        """Return forces on the points as forces on the nodes of the skin's mesh [N], shapes (n, 3) to (m, 3)."""
        return self.contact_points.to_nodes(force)

    def tell_unconverged(self, solution: Solution, where: float) -> None:
        """Count a frame that is doubtful because a solution did not converge; `where` is its scene frame."""
        self.counters["unconverged"] += 1
        self.notes.warn(
            "not-converged",
            "contact did not converge",
            where,
            value=solution.residual,
            limit=f"<= {solution.tolerance:g}",
            remedy="Use smaller steps, or less friction",
        )

    def _report(self, step: PathStep, where: float) -> None:
        if not step.solution.converged:
            self.tell_unconverged(step.solution, where)
        if self.law is not None and self.law.fold is not Fold.NONE:
            self.notes.warn(
                "several-states",
                self.law.fold.value,
                where,
                remedy="Press less deep, or turn less in a frame while pressed",
            )
        # the gap bounds the depth, so the depth is only computed if a gap is beyond the limit
        near = step.gaps is not None and -float(step.gaps.gap.min(initial=np.inf)) > self.depth_limit
        depth = step.sums.depth if near else 0.0
        if depth > self.depth_limit:
            skin, remedy = (
                "linear" if self.law is None else "neo-Hookean",
                "Raise the finger, or make its touch depth compliant",
            )
            self.notes.too_deep(skin, depth, self.depth_limit, where, remedy=remedy)
        self.contact_points.note(self.notes, where)

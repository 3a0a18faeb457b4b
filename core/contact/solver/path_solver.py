"""Contact along a path: frame after frame, with friction's history, and without work where nothing happens.

Each frame goes: gaps, the offset b from the anchors, shifted where slip turns (`frame_friction.py`), a start
extrapolated from the last two frames, and compiled sweeps from node to node (`sweeps.py`) until Coulomb's law holds.
Where tissue follows the neo-Hookean law, that is done on linear skin from where the law leaves it, until both agree
(`law_frame.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from ...errors import DermisError, Finding
from ...kernels.library import kernels
from .bodies import BONE, ContactBody, Expected, NodeGaps, node_gaps, same_places
from .compliance import Compliance, Linear, own_compliance, refuse_indefinite
from .cone import assess
from .frame_friction import UNMOVED, FrameFriction
from .history import ContactHistory
from .law_frame import solved_by_law
from .law_skin import Fold, LawSkin
from .notes import Notes
from .path_step import PathStep, SolvedFrame
from .solve import MOST_SWEEPS, Solution, status_of
from .sweeps import sweep

__all__ = ["DEPTH_LIMIT", "TOLERANCE", "Compliance", "Linear", "PathSolver", "PathStep"]

# Residual of contact, see `Solution.residual`: where an iteration starts then changes no force by 1e-4.
TOLERANCE = 3e-6
# A frame whose residual is above this multiple of the tolerance is a finding.
CHECK = 10.0
# The last forces serve again while their residual is below this multiple of it.
UNCHANGED = 1.0
# Nodes that are nearer than this, where the last frame left them, are swept at once [m]: it changes the time alone.
AHEAD = 0.2e-3
# Sweeps up to which a frame counts as easy: the next may need none.
EASY = 3
# Depth that linear skin is still trusted at [m]: against a neo-Hookean one its stress is then off by a third.
DEPTH_LIMIT = 2e-3
# In a frame skin comes out by no more than this multiple of its displacement in the last, and a margin [m].
BULGE, MARGIN = 1.5, 0.3e-3
FOLDS = {
    Fold.LEFT: "skin is in balance on a fold of itself too: it is taken as straight pressing has it",
    Fold.KEPT: "skin is in balance on a fold of itself alone, and its forces are too large",
}
# The state that a frame changes, besides the history; each is replaced, never written into.
_STATE = ("_force", "_last", "_image", "_step", "_bodies", "_at_rest", "frames", "_rubbing")


class PathSolver:
    """Contact of one finger, frame after frame.

    Args:
        compliance: compliance matrix of the pad nodes [m/N], shape (3 m, 3 m), or a `Compliance` with a state-dependent
            offset.
        points: undeformed pad nodes in the finger's frame [m], shape (m, 3).
        areas: skin of each node [m^2], shape (m,); needed where a body is soft.
        tolerance: largest residual accepted, see `Solution.residual`.
        bone: a point inside the finger [m]: open surfaces are touched on the side where it lies.
        name: for findings.
        depth_limit: depth of the undeformed skin beyond which a frame is a finding [m].
        law: by how much less the skin gives way than by its compliance; None where it is linear.

    Attributes:
        counters: how many frames were 'solved', 'unchanged', 'same', 'idle' and 'held' (see `adopt`); 'unconverged' and
            'deep' ones; 'parts' of frames that `SubStepper` divided.
        frames: how many there were.

    Raises:
        DermisError: shapes that do not fit, a compliance that is not positive definite, or no compiled kernels.
    """

    def __init__(
        self,
        compliance: Array | Compliance,
        points: Array,
        *,
        areas: Array | None = None,
        tolerance: float = TOLERANCE,
        bone: Array = BONE,
        name: str = "finger",
        depth_limit: float = DEPTH_LIMIT,
        law: LawSkin | None = None,
    ) -> None:
        self._begin(tolerance, bone, name, depth_limit, law)
        self.operator: Compliance = Linear(compliance) if isinstance(compliance, np.ndarray) else compliance
        self.points = np.asarray(points, dtype=np.float64)
        self.areas = areas
        c = np.ascontiguousarray(self.operator.compliance, dtype=np.float64)
        m = self.points.shape[0]
        if c.shape != (3 * m, 3 * m):
            raise DermisError(
                "the compliance does not fit the nodes", where=name, value=c.shape, limit=f"({3 * m}, {3 * m})"
            )
        self._c = c
        self._own = own_compliance(c)
        refuse_indefinite(c, name)
        extent = np.sort(np.ptp(self.points, axis=0))
        spacing = float(np.sqrt(max(extent[-1] * extent[-2], 1e-12) / m))
        # skin cannot bulge out of a body by more than the body is pressed in: nodes farther off stay open
        self.search_radius = max(2.5 * spacing, 2.5e-3)
        self.history = ContactHistory(m)
        self._zero = np.zeros((m, 3))
        self._status = np.zeros(m, dtype=np.int8)
        self.reset()

    def _begin(self, tolerance: float, bone: Array, name: str, depth_limit: float, law: LawSkin | None = None) -> None:
        kernels()  # a skin does not work without them, and says so here
        self.tolerance = tolerance
        self.bone = np.asarray(bone, dtype=np.float64)
        self.name = name
        self.depth_limit = depth_limit
        self.law = law
        self.counters = dict.fromkeys(
            ("solved", "unchanged", "same", "idle", "unconverged", "deep", "held", "parts"), 0
        )
        self.notes = Notes(name)
        self.frames = 0
        # which nodes are, and under which forces
        self._loaded: tuple[Array | None, NDArray[np.bool_]] = None, np.zeros(0, dtype=np.bool_)

    def reset(self) -> None:
        """Forget the history: the next frame is solved from rest."""
        self.history.clear()
        self._force = self._zero
        self._last: Array | None = None  # forces of the frame before
        self._image = self._zero
        self._rubbing = UNMOVED
        self._step: PathStep | None = None
        self._bodies: tuple[ContactBody, ...] = ()
        self._at_rest = False
        if self.law is not None:
            self.law.reset()

    def save(self) -> dict[str, Any]:
        """Return the state between two frames, for `restore`: a step may then be tried and taken back."""
        state = {name: getattr(self, name) for name in _STATE}
        state.update(history=self.history.copy(), counters=dict(self.counters), _notes=self.notes.copy())
        return state if self.law is None else {**state, "law": self.law.save()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to a saved state: the frames that follow are the same to the last bit."""
        for name in _STATE:
            setattr(self, name, state[name])
        self.history = state["history"].copy()
        self.counters, self.notes = dict(state["counters"]), state["_notes"].copy()
        if self.law is not None:
            self.law.restore(state["law"])

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Frames that did not converge or went too deep: the first frame and how often."""
        return self.notes.findings()

    def idle(self, count: int = 1) -> PathStep:
        """Take frames in which the broad phase found nothing near: no work, and no history afterwards."""
        self.counters["idle"] += count
        self.frames += count
        if self._step is not None and self._step.work == "idle":
            return self._step
        self.reset()
        none = np.zeros(len(self._zero))
        nothing = Solution(self._zero, self._zero, self._zero, none, self._status, 0, 0.0, self.tolerance, "none")
        self._step = PathStep(nothing, self._zero, None, "idle", False, self.nodal(self._zero), self.amounts)
        return self._step

    @property
    def fresh(self) -> bool:
        """Whether there is no history: the next frame is the first that touches or is near something."""
        return not (self.history.body >= 0).any()

    @property
    def bodies(self) -> tuple[ContactBody, ...]:
        """Bodies near in the last frame."""
        return self._bodies

    @property
    def pad(self) -> Array:
        """Points of the undeformed skin that tell where anything first touches [m], shape (n, 3)."""
        return self.points

    def outside(self, bodies: Sequence[ContactBody], reach: float = np.inf) -> float:
        """Return the smallest gap of the undeformed skin [m], inf where there is none within reach."""
        return float(node_gaps(self.pad, bodies, reach, self.bone).gap.min())

    @property
    def gaps(self) -> NodeGaps | None:
        """The gaps of the last frame; None where nothing was near."""
        return None if self._step is None or self.fresh else self._step.gaps

    @property
    def loaded(self) -> NDArray[np.bool_]:
        """Which nodes carried force in the last frame, shape (m,)."""
        if self._loaded[0] is not self._force:
            self._loaded = self._force, np.asarray(self._force.any(axis=1), dtype=np.bool_)
        return self._loaded[1]

    @property
    def places(self) -> Array:
        """Places of the undeformed skin that `reach` is told for [m], shape (p, 3)."""
        return self.points

    @property
    def reach(self) -> Array:
        """How far from each of `places` skin may be in the next frame, where it touches nothing yet [m], shape (p,).

        Without load the undeformed skin is the skin: nothing is felt before its gap is closed.
        """
        return (
            self._bulge(np.sqrt(np.einsum("ij,ij->i", self._image, self._image)))
            if self.loaded.any()
            else np.zeros(len(self.points))
        )

    def _bulge(self, moved: Array) -> Array:
        """Return how far skin may come out in the next frame where it has moved so far in the last [m], shape (n,)."""
        return np.minimum(BULGE * moved + MARGIN, self.search_radius)

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
            part: it is a part of the way to a frame: nothing is noted and no frame is counted.
        """
        bodies = tuple(bodies)
        if not part and self.unmoved(bodies):
            assert self._step is not None
            self.counters["same"] += 1
            self.frames += 1
            return replace(self._step, work="same", from_rest=False)
        gaps = self.look(bodies) if gaps is None else gaps
        if not (gaps.body >= 0).any():
            self._bodies = bodies
            return self.idle(0 if part else 1)
        return self.step_gaps(gaps, scene_frame=scene_frame, part=part)

    def unmoved(self, bodies: Sequence[ContactBody]) -> bool:
        """Return whether the next frame is the last one again: everything rests where it was."""
        return self._at_rest and self._step is not None and same_places(bodies, self._bodies)

    def look(self, bodies: Sequence[ContactBody]) -> NodeGaps:
        """Measure the next frame's gaps, without taking it."""
        bodies = tuple(bodies)  # by which the history knows again that it was asked for these
        return node_gaps(self.points, bodies, self.search_radius, self.bone, self._expected(bodies))

    def _expected(self, bodies: Sequence[ContactBody]) -> Expected:
        """Return where the skin is to be looked for in the next frame."""
        ahead = self._rubbing.ahead(bodies, self.history, self._force, self.loaded)
        return self.history.expected(bodies, self.points + self._image, self.search_radius, ahead)

    def pressing(self, start: Sequence[ContactBody], gaps: NodeGaps, nodes: Indices) -> float:
        """Return how far surfaces press on at nodes, from where bodies were [m]."""
        last = self.gaps
        assert last is not None
        return float(np.abs(gaps.gap[nodes] - last.gap[nodes]).max())

    def step_gaps(self, gaps: NodeGaps, *, scene_frame: float | None = None, part: bool = False) -> PathStep:
        """Solve the next frame from gaps that were measured elsewhere."""
        from_rest = self.fresh
        b = self.history.offset(gaps, self.points)
        b += self.operator.offset(self._force)
        soft = gaps.compliance(self.areas, self.name)
        friction = FrameFriction(gaps, self.history, self.loaded, self._matrix, self._own, soft)
        if not from_rest:
            friction.foresee(self._force, b, self._image, self._rubbing.changing)
        solved = self._solve(b, gaps, soft)
        solution, image, work = solved.solution, solved.image, solved.work
        if not from_rest and work == "solved":
            friction.notice(solution)
        self._remember(solved, friction)
        nodal = self._zero if part else self.nodal(solution.force)
        step = PathStep(solution, image, gaps, work, from_rest, nodal, self.amounts)
        if part:
            self.counters["parts"] += 1
            self._at_rest = False  # a frame in the same place has forces on the nodes, which a part has not
        else:
            self._report(step, self.frames if scene_frame is None else scene_frame)
            self.counters[work] += 1
            self.frames += 1
        self._step = step
        return step

    def adopt(
        self, force: Array, displacement: Array, gaps: NodeGaps, residual: float, *, scene_frame: float | None = None
    ) -> PathStep:
        """Take over a frame that was solved together with other fingers, whose history is already kept.

        Args:
            force: forces on the nodes [N], shape (m, 3).
            displacement: relative displacement w of the nodes [m], shape (m, 3).
            gaps: the gaps that the frame was solved for.
            residual: residual of the contact laws.
        """
        from_rest = self._step is None or self._step.work == "idle"
        status = status_of(force, displacement, gaps.normal, gaps.friction)
        solution = Solution(
            force,
            displacement,
            gaps.normal,
            gaps.friction,
            status,
            EASY + 1,
            residual,
            CHECK * self.tolerance,
            "sweeps",
        )
        self._last, self._force, self._image = None, force, self._apply(force)
        self._bodies, self._at_rest, self._rubbing = gaps.bodies, False, UNMOVED
        self.counters["held"] += 1
        self._step = PathStep(solution, self._image, gaps, "solved", from_rest, self.nodal(force), self.amounts)
        self._report(self._step, self.frames if scene_frame is None else scene_frame)
        self.frames += 1
        return self._step

    # -- one frame -----------------------------------------------------------------------------------------------

    def _solve(self, b: Array, gaps: NodeGaps, soft: Array) -> SolvedFrame:
        normal, mu = gaps.normal, gaps.friction
        start, image = self._force, self._image
        gone = (gaps.body < 0) & start.any(axis=1)
        if gone.any():  # nothing is near any more: these forces vanish before anything else
            start = np.where(gone[:, None], 0.0, start)
            image = self._apply(start)
        allowed = self._allowed(gaps.bodies)
        if allowed:
            w = image + soft[:, None] * start + b
            residual, status = assess(start, w, normal, mu, 1.0 / (self._own + soft)[:, None])
            if residual <= allowed:
                method = "sweeps" if start.any() else "none"
                goal = max(CHECK * self.tolerance, allowed)
                solution = Solution(start, w, normal, mu, status, 0, residual, goal, method)
                return SolvedFrame(solution, image, "unchanged")
        begin = self._extrapolated(start)
        return (
            self.iterated(b, gaps, soft, begin)
            if self.law is None
            else solved_by_law(self, self.law, b, gaps, soft, begin)
        )

    def iterated(self, b: Array, gaps: NodeGaps, soft: Array, start: Array) -> SolvedFrame:
        """Solve a frame on linear skin from forces to start from [N], shape (m, 3)."""
        normal, mu = gaps.normal, gaps.friction
        likely = gaps.clearance < AHEAD
        found = sweep(self._matrix, b, normal, mu, soft, start, self.tolerance, MOST_SWEEPS, likely)
        w = found.image + soft[:, None] * found.force + b
        status = status_of(found.force, w, normal, mu)
        goal = CHECK * self.tolerance
        solution = Solution(found.force, w, normal, mu, status, found.sweeps, found.residual, goal, "sweeps")
        return SolvedFrame(solution, found.image, "solved")

    def _allowed(self, bodies: tuple[ContactBody, ...]) -> float:
        """Return the residual up to which the last forces serve again; zero where that is not worth asking."""
        if self.law is not None and not self.law.settled:
            return 0.0
        # on a path that changes the answer is no
        easy = self._step is None or self._step.solution.iterations <= EASY
        return UNCHANGED * self.tolerance if easy else 0.0

    def _extrapolated(self, force: Array) -> Array:
        """Start where the last two frames point to; paths are smoother than their frames are long."""
        return force if self._last is None else 2.0 * force - self._last

    def _remember(self, solved: SolvedFrame, friction: FrameFriction) -> None:
        """Keep a frame, its history as friction has it."""
        solution = solved.solution
        slides = friction.keep(solution, self.points, solved.image)
        self._rubbing = friction.left(solution, self._force, solved.image - self._image)
        self._at_rest = not slides
        self._last = self._force if self._force.any() else None
        self._force, self._image = solution.force, solved.image
        self._bodies = friction.gaps.bodies

    # -- small parts ---------------------------------------------------------------------------------------------

    @property
    def amounts(self) -> Array | None:
        """By how much less than linear skin the pad nodes give way [m], shape (3 m,); None where skin is linear."""
        return None if self.law is None else self.law.amounts

    def _apply(self, force: Array) -> Array:
        """Return the displacement under forces [m], shape (n, 3)."""
        linear = self.linear(force)
        return linear if self.law is None else linear - self.beyond()

    def beyond(self) -> Array:
        """Return by how much less than linear skin the points give way now [m], shape (n, 3); of skin with a law."""
        assert self.law is not None
        return self.law.beyond

    def linear(self, force: Array) -> Array:
        """Return the displacement of linear skin under forces [m], shapes (n, 3) to (n, 3)."""
        return (self._c @ force.reshape(-1)).reshape(-1, 3)

    @property
    def _matrix(self) -> NDArray[np.floating]:
        """The compliance of the points [m/N], shape (3 m, 3 m)."""
        return self._c

    def nodal(self, force: Array) -> Array:
        """Return forces on the points [N] as forces on the nodes of the skin's mesh, which here are the same."""
        return force

    def _report(self, step: PathStep, where: float) -> None:
        solution = step.solution
        if not solution.converged:
            self.counters["unconverged"] += 1
            self.notes.warn(
                "not-converged",
                "contact did not converge",
                where,
                value=solution.residual,
                limit=f"<= {solution.tolerance:g}",
                remedy="Use smaller steps, or less friction",
            )
        if self.law is not None and self.law.fold is not Fold.NONE:
            self.notes.warn(
                "several-states",
                FOLDS[self.law.fold],
                where,
                remedy="Press less deep, or turn less in a frame while pressed",
            )
        # no point is deeper than its gap says, which is seldom more than skin is trusted with
        near = step.gaps is not None and -float(step.gaps.gap.min(initial=np.inf)) > self.depth_limit
        depth = step.depth(self.points, self.bone) if near else 0.0
        if depth > self.depth_limit:
            self.counters["deep"] += 1
            self.notes.warn(
                "too-deep",
                f"the finger sinks deeper than {'linear' if self.law is None else 'neo-Hookean'} skin is trusted",
                where,
                value=f"{1e3 * depth:.2f} mm",
                limit=f"<= {1e3 * self.depth_limit:g} mm",
                remedy="Raise the finger, or make its touch depth compliant",
            )

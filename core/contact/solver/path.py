"""Contact along a path: frame after frame, with friction's history, and without work where nothing happens.

Each frame goes: gaps, the offset b from the anchors, shifted where slip turns (`frame_friction.py`), a start
extrapolated from the last two frames, the alternating method on the nodes that may touch, a float64 check against the
whole compliance, and float64 with every method there is where that fails. Where tissue follows the neo-Hookean law,
that is done on linear skin from where the law leaves it, until both agree (`law_frame.py`).
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
from .admm import State, iterate
from .bodies import BONE, ContactBody, Expected, NodeGaps, node_gaps, same_places
from .candidates import CandidateInverse
from .compliance import Compliance, Linear, ends, own_compliance
from .cone import along, assess
from .frame_friction import UNMOVED, FrameFriction
from .history import ContactHistory
from .law_frame import solved_by_law
from .law_skin import LawSkin
from .notes import Notes
from .path_step import PathStep
from .solve import Solution, solve, status_of
from .solved_frame import Begin, SolvedFrame

__all__ = ["DEPTH_LIMIT", "TOLERANCE", "Compliance", "Linear", "PathSolver", "PathStep"]

TOLERANCE = 3e-5
# The check that a frame must pass, as a multiple of the tolerance of its iteration.
CHECK = 10.0
# The last forces serve again while their residual is below this multiple of it.
UNCHANGED = 1.0
MAX_ITERATIONS = 300
# An iteration that stands still at once, while the check fails, so many times in a frame gets no further.
MAX_ROUNDS = 30
# Where nothing helps, a frame is not worth more sweeps from node to node; and one that is solved from a guess of what
# skin with a law leaves, which may be far off, is worth none.
FAIRLY, GUESSED = {"last_resort": 100}, {"last_resort": 0, "max_iterations": 1000}
# Iterations up to which a frame counts as easy: the next may need none.
EASY = 3
# Depth that linear skin is still trusted at [m]: against a neo-Hookean one its stress is then off by a third.
DEPTH_LIMIT = 2e-3
# In a frame skin comes out by no more than this multiple of its displacement in the last, and a margin [m].
BULGE, MARGIN = 1.5, 0.3e-3
# What a frame changes, besides the history; each is replaced, never written into.
_STATE = ("_force", "_y", "_last", "_image", "_step", "_bodies", "_at_rest", "frames", "_soft", "_rho", "_rubbing")


class PathSolver:
    """Contact of one finger, frame after frame.

    Args:
        compliance: of the pad nodes [m/N], shape (3 m, 3 m), or a `Compliance` with a state-dependent offset.
        points: undeformed pad nodes in the finger's frame [m], shape (m, 3).
        areas: skin of each node [m^2], shape (m,); needed where a body is soft.
        tolerance: of the iteration, relative to the forces of a frame.
        bone: a point inside the finger [m]: open surfaces are touched on the side where it lies.
        name: for findings.
        depth_limit: depth of the undeformed skin beyond which a frame is a finding [m].
        law: what the skin gives way less than by its compliance; None where it is linear.

    Attributes:
        counters: how many frames were 'solved', 'unchanged', 'same', 'idle' and 'held' (see `adopt`); 'fallback',
            'unconverged' and 'deep' ones; 'rebuilds' and 'updates' of the candidate inverse; 'parts' of frames that
            `SubStepper` divided.
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
        low, high = ends(c, name)
        self._skin_rho = self._rho = np.full((m, 1), np.sqrt(low * high))
        self._soft = np.zeros(m)  # of what lies below each node [m/N]
        extent = np.sort(np.ptp(self.points, axis=0))
        spacing = float(np.sqrt(max(extent[-1] * extent[-2], 1e-12) / m))
        self._spacing = np.full(m, spacing)
        # skin cannot bulge out of what presses into it by more than it is pressed: nodes farther off stay open
        self.search_radius = max(2.5 * spacing, 2.5e-3)
        self._candidates = CandidateInverse(c, self._rho[:, 0])
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
            (
                "solved",
                "unchanged",
                "same",
                "idle",
                "fallback",
                "unconverged",
                "rebuilds",
                "updates",
                "deep",
                "held",
                "parts",
            ),
            0,
        )
        self.notes = Notes(name)
        self.frames = 0
        # which nodes are, and under which forces
        self._loaded: tuple[Array | None, NDArray[np.bool_]] = None, np.zeros(0, dtype=np.bool_)

    def reset(self) -> None:
        """Forget the history: the next frame is solved from rest."""
        self.history.clear()
        self._force = self._zero
        self._y = self._zero
        self._last: tuple[Array, Array] | None = None
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
        state["inverse"] = self._candidates.save()
        return state if self.law is None else {**state, "law": self.law.save()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to a saved state: what follows is the same to the last bit."""
        for name in _STATE:
            setattr(self, name, state[name])
        self.history = state["history"].copy()
        self.counters, self.notes = dict(state["counters"]), state["_notes"].copy()
        self._candidates.restore(state["inverse"], self._matrix, self._rho[:, 0])
        if self.law is not None:
            self.law.restore(state["law"])

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What did not converge and what went too deep, with the first frame and how often."""
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
        """What was near in the last frame."""
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
            bodies: what is near, posed in the finger's frame; the same order every frame.
            scene_frame: of the scene, for findings.
            gaps: what `look` said of it.
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
        if not np.array_equal(soft, self._soft):
            self._weigh(soft)
        friction = FrameFriction(gaps, self.history, self.loaded, self._matrix, self._own, soft)
        if not from_rest:
            friction.foresee(self._force, b, self._image, self._rubbing.changing)
        with np.errstate(over="ignore", invalid="ignore"):  # what goes astray is told by what it leaves, and begun anew
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
        self.counters["rebuilds"], self.counters["updates"] = self._candidates.rebuilds, self._candidates.updates
        self._step = step
        return step

    def adopt(
        self, force: Array, displacement: Array, gaps: NodeGaps, residual: float, *, scene_frame: float | None = None
    ) -> PathStep:
        """Take over a frame that was solved together with other fingers, whose history is already kept.

        Args:
            force: on the nodes [N], shape (m, 3). displacement: relative, w [m], shape (m, 3).
            gaps: that it was solved for. residual: of the contact laws.
        """
        from_rest = self._step is None or self._step.work == "idle"
        status = status_of(force, displacement, gaps.normal, gaps.friction)
        solution = Solution(
            force, displacement, gaps.normal, gaps.friction, status, EASY + 1, residual, CHECK * self.tolerance, "admm"
        )
        self._last, self._force, self._y, self._image = None, force, displacement / -self._rho, self._apply(force)
        self._bodies, self._at_rest, self._rubbing = gaps.bodies, False, UNMOVED
        self.counters["held"] += 1
        self._step = PathStep(solution, self._image, gaps, "solved", from_rest, self.nodal(force), self.amounts)
        self._report(self._step, self.frames if scene_frame is None else scene_frame)
        self.frames += 1
        return self._step

    # -- one frame -----------------------------------------------------------------------------------------------

    def _weigh(self, soft: Array) -> None:
        """Weigh steps by what lies below the nodes, too: a soft thing gives way by far more than the skin."""
        rho = self._skin_rho + soft[:, None]
        share = self._rho / rho
        self._y = self._y * share
        self._last = self._last and (self._last[0], self._last[1] * share)
        self._soft, self._rho, self._candidates.rho = soft, rho, rho[:, 0]

    def _solve(self, b: Array, gaps: NodeGaps, soft: Array) -> SolvedFrame:
        normal, mu, rho = gaps.normal, gaps.friction, self._rho
        goal = CHECK * self.tolerance
        start, image = self._force, self._image
        gone = (gaps.body < 0) & start.any(axis=1)
        if gone.any():  # nothing is near any more: these forces vanish before anything else
            start = np.where(gone[:, None], 0.0, start)
            image = self._apply(start)
        w = image + soft[:, None] * start + b
        allowed = self._allowed(gaps.bodies)
        residual, status = assess(start, w, normal, mu, 1.0 / rho) if allowed else (np.inf, self._status)
        if residual <= allowed:
            method = "admm" if start.any() else "none"
            solution = Solution(start, w, normal, mu, status, 0, residual, goal, method)
            return SolvedFrame(solution, w / -rho, image, "unchanged")
        self._candidates.follow(gaps.clearance, self.loaded, self._spacing, soft)
        force, y = self._extrapolated(start, w)
        if self.law is not None:
            return solved_by_law(self, self.law, b, gaps, soft, Begin(start, image + self.beyond(), force, y))
        return self.iterated(b, gaps, soft, Begin(start, image, force, y))

    def iterated(self, b: Array, gaps: NodeGaps, soft: Array, begin: Begin) -> SolvedFrame:
        """Solve a frame on linear skin, in single precision by turns, then exactly where that fails."""
        normal, mu, rho = gaps.normal, gaps.friction, self._rho
        goal = CHECK * self.tolerance
        start, image, force, y = begin
        reference, iterations, rounds = start, 0, 0
        while True:
            members = self._candidates.members
            z = reference.take(members, axis=0)
            iteration = iterate(
                self._candidates.matrix,
                np.repeat(rho.take(members), 3),
                b.take(members, axis=0).reshape(-1),
                normal.take(members, axis=0),
                mu.take(members),
                State(force.take(members, axis=0), y.take(members, axis=0)),
                State(z, z),
                (image.take(members, axis=0) + soft.take(members)[:, None] * z).reshape(-1),
                self.tolerance,
                MAX_ITERATIONS,
            )
            iterations += iteration.iterations
            rounds += 1
            force = np.zeros_like(self._zero)
            force[members] = iteration.state.z
            if iteration.lost:
                if not self._candidates.drifts():
                    return self._fall_back(start, b, gaps, soft, iterations)
                self._candidates.rebuild(members, soft)  # many updates in single precision can go wrong
                reference, image, force, y, iterations, rounds = start, begin.image, start, self._y, 0, 0
                continue
            image = self.linear(force)
            w = image + soft[:, None] * force + b
            y = w / -rho
            y[members] = iteration.state.y
            reference = force
            residual, status = assess(force, w, normal, mu, 1.0 / rho)
            if residual <= goal:
                solution = Solution(force, w, normal, mu, status, iterations, residual, goal, "admm")
                return SolvedFrame(solution, y, image, "solved")
            missed = np.flatnonzero(np.logical_not(self._candidates.inside) & (along(w, normal) < 0.0))
            if missed.size:
                self._candidates.add(missed, soft)
            elif iterations >= MAX_ITERATIONS or rounds >= MAX_ROUNDS:
                if not self._candidates.drifts():
                    return self._fall_back(force, b, gaps, soft, iterations)
                self._candidates.rebuild(members, soft)  # many updates in single precision can go wrong
                force, y, iterations, rounds = start, self._y, 0, 0

    def _allowed(self, bodies: tuple[ContactBody, ...]) -> float:
        """Return the residual up to which the last forces serve again; zero where that is not worth asking."""
        if self.law is not None and not self.law.settled:
            return 0.0
        # on a path that changes the answer is no
        easy = self._step is None or self._step.solution.iterations <= EASY
        return UNCHANGED * self.tolerance if easy else 0.0

    def _fall_back(self, force: Array, b: Array, gaps: NodeGaps, soft: Array, iterations: int) -> SolvedFrame:
        """Solve the frame in float64 with every method there is."""
        self.counters["fallback"] += 1
        near = np.flatnonzero(gaps.body >= 0)
        exact, more, method = self._exactly(near, b[near], gaps, soft[near], force[near])
        force = np.zeros_like(self._zero)
        force[near] = exact
        image = self.linear(force)
        w = image + soft[:, None] * force + b
        residual, status = assess(force, w, gaps.normal, gaps.friction, 1.0 / self._rho)
        found = Solution(
            force, w, gaps.normal, gaps.friction, status, iterations + more, residual, CHECK * self.tolerance, method
        )
        return SolvedFrame(found, w / -self._rho, image, "solved")

    def _exactly(self, near: Indices, b: Array, gaps: NodeGaps, soft: Array, start: Array) -> tuple[Array, int, str]:
        """Return forces on some nodes [N], the iterations they took and the method."""
        rows = (3 * near[:, None] + np.arange(3)).reshape(-1)
        found = solve(
            self._c[rows[:, None], rows],
            b,
            gaps.friction[near],
            normals=gaps.normal[near],
            softness=soft,
            start=start,
            tolerance=self.tolerance,
            **(FAIRLY if self.law is None or np.isinf(self.law.left) else GUESSED),
        )
        return found.force, found.iterations, found.method

    def _extrapolated(self, force: Array, w: Array) -> tuple[Array, Array]:
        """Start where the last two frames point to; paths are smoother than their frames are long."""
        if self._last is None:
            return force, -w / self._rho
        last_force, last_y = self._last
        return 2.0 * force - last_force, 2.0 * self._y - last_y

    def _remember(self, solved: SolvedFrame, friction: FrameFriction) -> None:
        """Keep a frame, its history as friction has it."""
        solution = solved.solution
        slides = friction.keep(solution, self.points, solved.image)
        self._rubbing = friction.left(solution, self._force, solved.image - self._image)
        self._at_rest = not slides
        self._last = (self._force, self._y) if self._force.any() else None
        self._force, self._y, self._image = solution.force, solved.y, solved.image
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

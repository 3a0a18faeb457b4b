"""SubStepper: division of the movement between two frames into sub-steps.

Friction depends on the path, and gaps are known only near the skin. A frame with much normal movement or rotation is
therefore solved in several parts. A finger that is inside an object in its first frame is moved there from outside. An
object that has passed through a finger is ignored until the finger is outside of it, and a finding reports it. An
object that slid under the finger from the side, with the skin hanging on its rim, is pressed again from below, and so
is one that the skin has slid past.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from ...arrays import Array, Indices
from ...surface.crossing import first_crossing
from ...surface.gap import Surface
from .between import between, lowered, matter_moved, reshaped, vertices_moved
from .bodies import AWAY, TIE, ContactBody, NodeGaps, least_gaps, same_places, travel
from .cone import along
from .lowering import OUTSIDE, SEARCHES, in_or_above, way_out, ways_out
from .near_surface import NearTriangles
from .path_solver import PathSolver
from .path_step import PathStep
from .posed_records import corners_about
from .press_watch import MODULUS, PressWatch, hangs
from .release_watch import ReleaseWatch

# Largest normal movement in a part of a frame [m], and largest movement in any direction if the normals turn [m].
PRESSING, TURNING = 0.1e-3, 0.1e-3
# Largest number of parts of a frame beyond the depth at which the skin's model is trusted, and of a frame that would
# take more than `MAX_PARTS`. In the latter all skin slides, and it forgets what was before its last slip: on balls,
# bumps and edges that slide or spin, forces are within 0.4 % of those of 200 parts; where the corners of a spinning box
# strike the skin, within 6 %.
DEEP_PARTS = FAST_PARTS = 4
# Normals turn if the cosine between a loaded node's normals before and after the frame is below this.
STRAIGHT = 0.95
# Largest number of parts of a frame. If the finger has touched before, a longer way takes `FAST_PARTS` instead.
MAX_PARTS = 60
# Largest number of parts if `SubStepper.coarse` is set.
COARSE_PARTS = 2
THROUGH, UNFELT = "an object went through the finger", ", and is not felt until the finger is outside"
PAST, ANEW = "the skin has slid past something small", ", and is pressed onto it anew: the force is unreliable"
LESS = "Press no deeper than its radius, drag less far, or give it more friction"
TOO_FAST = "contact moves too far in one frame: it is solved in coarser steps"
SINKS = "a feature smaller than the contact resolution sinks into the skin: the force is unreliable"
SINKS_LESS = "Press less deep, or give it more friction"
HANGING = "skin hangs on faces that look away from the finger: the force is unreliable and depends on the way there"
HANGING_LESS = "Press less deep, drag less far, or round the object's edges"
LETS_GO = "the skin lets go of an object at once, sooner or later by how often its way is sampled"
LETS_GO_LESS = "Press less deep, use less friction, or round the edge that the skin hangs on"


class SubStepper:
    """Advances a contact solver from frame to frame, in sub-steps if necessary.

    Args:
        solver: contact solver of one finger.
        deepest: penetration beyond which an object that does not contain the bone has passed through the finger [m].
        modulus: Young's modulus of the finger's skin [Pa].

    Attributes:
        coarse: whether to limit frames to `COARSE_PARTS` parts.
        cut: whether a frame was limited since this was last set to False.
    """

    def __init__(self, solver: PathSolver, deepest: float, modulus: float = MODULUS) -> None:
        self.solver, self.deepest = solver, deepest
        self._left: frozenset[int] = frozenset()  # bodies that are ignored until the finger is outside
        self._facing: dict[int, float] = {}  # signed volume of each closed body: positive if its normals point outwards
        self._press, self._release = PressWatch(modulus), ReleaseWatch()
        self._box = corners_about(solver.pad)  # no point of the pad moves farther over a body than all of its corners
        self._number = 0.0  # of the frame, for findings
        self.coarse = self.cut = False

    def idle(self, count: int = 1) -> PathStep:
        """Take `count` frames in which nothing is near; ignored bodies remain ignored."""
        return self.solver.idle(count)

    def adopted(self) -> None:
        """Continue from a frame that was solved elsewhere."""
        self._forget()

    def _forget(self) -> None:
        self._press.forget()
        self._release.forget()

    def save(self) -> dict[str, Any]:
        """Return the state between two frames, for `restore`."""
        watched = {"press": self._press.save(), "release": self._release.save()}
        return {"solver": self.solver.save(), "left": self._left, "facing": dict(self._facing), **watched}

    def restore(self, state: dict[str, Any]) -> None:
        """Go back to a saved state."""
        self.solver.restore(state["solver"])
        self._left, self._facing = state["left"], dict(state["facing"])
        self._press.restore(state["press"])
        self._release.restore(state["release"])

    def step(
        self,
        bodies: Sequence[ContactBody],
        before: Callable[[], Sequence[ContactBody] | None] = lambda: None,
        *,
        scene_frame: float | None = None,
    ) -> PathStep:
        """Solve the next frame.

        Args:
            bodies: as for `PathSolver.step`.
            before: function that returns the same bodies in the frame before, or None. It is called if the finger has
                no history: a finger inside an object is then moved there from this frame, or along its own normal for
                None.
            scene_frame: scene frame, for findings.
        """
        self._number = float(self.solver.frames) if scene_frame is None else scene_frame
        touched = self.solver.loaded.any()
        self._turned_over(bodies)
        self._crossed(bodies)
        bodies = self._felt(bodies)
        if self.solver.unmoved(bodies):
            return self.solver.step(bodies, scene_frame=scene_frame)
        known, depth = self.solver.bodies, self.solver.depth  # before `look`, which may change the points of that frame
        gaps = self.solver.look(bodies)
        start: Sequence[ContactBody] = (*known, *bodies[len(known) :])  # others came since
        begins = self.solver.fresh
        if begins:
            self._forget()
            start = self._start(bodies, before, gaps)
        arrived = {} if begins else self._arrived(start, bodies, before, gaps)
        start = [arrived.get(i, body) for i, body in enumerate(start)]
        arriving = max((travel(a, bodies[i], self.solver.pad) for i, a in arrived.items()), default=0.0)
        ways = self._ways(start, bodies, gaps, int(np.ceil(arriving / PRESSING)), depth)
        inside = begins and (gaps.gap < -OUTSIDE).any() and not same_places(start, bodies)
        if (arrived or inside) and _rub(bodies):
            ways.insert(0, list(start))  # friction begins at the first touch
        step = self._solved(start, ways, bodies, gaps)
        if lost := self._press.lost(start, step):
            self._warn("slips-in", SINKS, SINKS_LESS, value=f"{lost:.0%} less")
        if touched and not self.solver.loaded.any():
            self.solver.reset()  # after skin has lifted off, the next touch has no history
        return step

    def _solved(
        self, start: Sequence[ContactBody], ways: list[list[ContactBody]], bodies: list[ContactBody], gaps: NodeGaps
    ) -> PathStep:
        """Solve all parts of a frame, and return the last one.

        Args:
            start, bodies: bodies at the begin and at the end of the frame.
            ways: bodies at the end of each part but the last.
            gaps: gaps at the end of the frame.
        """
        came, released, doubtful, rubs = start, 0.0, None, _rub(bodies)
        for way in ways:
            part = self.solver.step(way, part=True)
            if rubs:  # without friction, parts leave no trace
                came, released = way, max(released, self._release.released(came, part))
                doubtful = doubtful if part.solution.converged else part.solution
        step = self.solver.step(bodies, scene_frame=self._number, gaps=None if ways else gaps)
        step = self._slid_past(self._through(step, bodies), bodies)
        if doubtful is not None and step.solution.converged:
            self.solver.tell_unconverged(doubtful, self._number)
        if released := max(released, self._release.released(came, step)):
            self._warn("lets-go", LETS_GO, LETS_GO_LESS, value=f"{released:.0%} of the force")
        return step

    def _warn(self, code: str, what: str, remedy: str, **details: str) -> None:
        self.solver.notes.warn(code, what, self._number, remedy=remedy, **details)

    # -- the way -------------------------------------------------------------------------------------------------

    def _ways(
        self, start: Sequence[ContactBody], bodies: Sequence[ContactBody], gaps: NodeGaps, fewest: int, depth: float
    ) -> list[list[ContactBody]]:
        """Return the bodies at the end of each part of the frame but the last.

        Args:
            start, bodies: bodies at the begin and at the end of the frame.
            gaps: gaps at its end.
            fewest: least number of parts.
            depth: penetration in the last frame [m].
        """
        parts = max(self._parts(start, bodies, gaps), fewest, 1)
        if self.coarse and parts > COARSE_PARTS:
            parts, self.cut = COARSE_PARTS, True
        last, fast = self.solver.gaps, parts > MAX_PARTS
        if fast:
            self._warn(
                "too-fast",
                TOO_FAST,
                "Sample more often, or move slower",
                value=f"{parts} steps",
                limit=f"<= {MAX_PARTS}",
            )
            parts = MAX_PARTS if last is None else FAST_PARTS
        if last is not None and self._too_deep(start, gaps, last, depth):
            parts = min(parts, DEEP_PARTS)
        if parts == 1:
            return []
        inside, points = self._inside(gaps), self.solver.points
        near = [self._near(a, b, points, *inside) for a, b in zip(start, bodies, strict=True)]
        return [
            [between(a, b, k / parts, n, arc=fast) for a, b, n in zip(start, bodies, near, strict=True)]
            for k in range(1, parts)
        ]

    def _inside(self, gaps: NodeGaps) -> tuple[float, float]:
        """Return the largest penetration of the undeformed and of the deformed skin in this frame or the last [m]."""
        seen = (gaps, self.solver.gaps or gaps)
        pressed, inside = (max(-min(float(getattr(g, name).min()) for g in seen), 0.0) for name in ("gap", "clearance"))
        return pressed, inside

    def _near(
        self, a: ContactBody, b: ContactBody, points: Array, pressed: float = 0.0, inside: float = 0.0
    ) -> NearTriangles | None:
        """Return the triangles of a deforming surface that the skin may meet in the frame; None for all."""
        if not reshaped(a, b):
            return None
        # Loaded skin is on the surface, displaced towards the bone. Other skin is near its undeformed position.
        bone = self.solver.bone
        skin = np.concatenate([points, points + bone * (pressed / np.linalg.norm(bone))])
        reach = self.solver.search_radius + min(inside, self.deepest) + travel(a, b, points)
        places = np.concatenate([c.local(skin)[0] for c in (a, b)])
        box = np.stack([places.min(axis=0) - reach, places.max(axis=0) + reach])
        assert isinstance(a.surface, Surface) and isinstance(b.surface, Surface)
        return NearTriangles.about(a.surface, b.surface, box)

    def _far(self, a: ContactBody, b: ContactBody) -> float:
        """Return the largest movement of a body near the pad [m]."""
        near = self._near(a, b, self.solver.pad)
        return travel(a, b, self.solver.pad) if near is None else vertices_moved(near, a, b)

    def _parts(self, start: Sequence[ContactBody], bodies: Sequence[ContactBody], gaps: NodeGaps) -> int:
        last = self.solver.gaps
        if last is None:
            far = max(self._far(a, b) for a, b in zip(start, bodies, strict=True))
            return int(np.ceil(far / PRESSING))
        pressed = self._touching(gaps)
        same = pressed[(last.body == gaps.body).take(pressed)]
        if same.size == 0:
            return int(np.ceil(self._travel(start, gaps, pressed) / PRESSING))
        pressing = float(np.abs(self._approach(start, gaps, last, same, gaps.normal)).max())
        parts = np.ceil(pressing / PRESSING)
        if along(gaps.normal.take(same, axis=0), last.normal.take(same, axis=0)).min() < STRAIGHT:
            parts = max(parts, np.ceil(self._travel(start, gaps, same) / TURNING))
        return int(parts)

    def _too_deep(self, start: Sequence[ContactBody], gaps: NodeGaps, last: NodeGaps, depth: float) -> bool:
        """Return whether a frame begins or ends deeper than the skin's model is trusted.

        Drag over an edge takes points far beyond its face, but no deeper; see `PathStep.sums`.

        Args:
            start: bodies at the begin of the frame.
            gaps, last: gaps at its end and at that of the last frame.
            depth: penetration in the last frame [m].
        """
        limit = self.solver.depth_limit
        if -min(float(gaps.gap.min()), float(last.gap.min())) <= limit:
            return False
        if depth > limit:
            return True
        deeper = self._approach(start, gaps, last, self._touching(gaps), self.solver.inward)
        return depth + float(deeper.max(initial=-np.inf)) > limit

    def _touching(self, gaps: NodeGaps) -> Indices:
        """Return the nodes that touch at the end of a frame, or did at its begin."""
        return ((gaps.body >= 0) & ((gaps.clearance < 0.0) | self.solver.loaded)).nonzero()[0]

    def _travel(self, start: Sequence[ContactBody], gaps: NodeGaps, nodes: Indices) -> float:
        """Return the largest movement of the bodies' material at nodes [m]."""
        ways = (way for _, way in self._moved(start, gaps, nodes) if way is not None)
        return max((float(np.sqrt((way * way).sum(axis=1)).max()) for way in ways), default=0.0)

    def _approach(
        self, start: Sequence[ContactBody], gaps: NodeGaps, last: NodeGaps, nodes: Indices, axes: Array
    ) -> Array:
        """Return the movement of the bodies' material at nodes along unit vectors, such as normals [m], shape (k,).

        A difference of gaps would jump at an edge of a surface, so it is used only for bodies whose triangles have
        changed since the last frame.

        Args:
            start: bodies at the begin of the frame.
            gaps, last: gaps at its end and at that of the last frame.
            nodes: indices of the nodes, shape (k,).
            axes: the vectors at all nodes, shape (m, 3).
        """
        ways = [
            last.gap[own] - gaps.gap[own] if way is None else along(way, axes[own])
            for own, way in self._moved(start, gaps, nodes)
        ]
        return np.concatenate(ways or [np.zeros(0)])

    def _moved(
        self, start: Sequence[ContactBody], gaps: NodeGaps, nodes: Indices
    ) -> Iterator[tuple[Indices, Array | None]]:
        """Yield the nodes of each body with the movement of its material there, see `matter_moved`."""
        which = gaps.body[nodes]
        for i in sorted(set(which.tolist())):
            own = nodes[which == i]
            yield own, matter_moved(start[i], gaps.bodies[i], self.solver.points[own], gaps.triangle[own])

    # -- the first touch -----------------------------------------------------------------------------------------

    def _start(
        self, bodies: list[ContactBody], before: Callable[[], Sequence[ContactBody] | None], gaps: NodeGaps
    ) -> Sequence[ContactBody]:
        """Return the bodies where they first touch on their way to where they are."""
        if not (gaps.body >= 0).any():
            return bodies
        came = before()
        if came is not None and len(came) == len(bodies) and self._gap(came) >= -OUTSIDE:
            return self._first_touch(came, bodies)
        start: list[ContactBody] = list(bodies)
        for index in sorted(set(gaps.body[gaps.body >= 0].tolist())):
            far = way_out(self.solver, bodies[index], self.deepest)
            if far is not None:
                start[index] = lowered(bodies[index], far)
            else:
                what = "the finger starts inside an object, and its path into it is not known"
                self._warn("starts-inside", what, "Begin where the finger is outside")
        return start

    def _arrived(
        self,
        start: Sequence[ContactBody],
        bodies: Sequence[ContactBody],
        before: Callable[[], Sequence[ContactBody] | None],
        gaps: NodeGaps,
    ) -> dict[int, ContactBody]:
        """Return bodies that come in from outside unseen, where they first touch, by their indices.

        They press where no point has been near them, so the frame's gaps do not show them.
        """
        seen = self.solver.loaded_bodies | set(gaps.body[gaps.clearance < 0.0].tolist())
        pad, found = self.solver.pad, {}
        for i, body in enumerate(bodies):
            if body.away or i in seen:
                continue
            known = before() if start[i].away else start
            came = known[i] if known is not None and i < len(known) else AWAY
            moves = travel(came, body, self._box) > PRESSING and travel(came, body, pad) > PRESSING
            if moves and self._gap([body]) < -OUTSIDE <= self._gap([came]):
                own, others = (
                    least_gaps(pad, some, OUTSIDE, self.solver.bone)
                    for some in ([body], [*bodies[:i], *bodies[i + 1 :]])
                )
                if ((own < -OUTSIDE) & (own < others - TIE)).any():  # it is in no other body's place
                    found[i] = self._first_touch([came], [body])[0]
        return found

    def _first_touch(self, before: Sequence[ContactBody], bodies: Sequence[ContactBody]) -> list[ContactBody]:
        """Interpolate the bodies from a state without contact to first contact, in steps of the smallest gap."""
        share, both = 0.0, list(zip(before, bodies, strict=True))
        near, far = [self._near(a, b, self.solver.pad) for a, b in both], max(self._far(a, b) for a, b in both)
        gap = self.solver.search_radius
        for _ in range(SEARCHES):
            here = [between(a, b, share, some) for (a, b), some in zip(both, near, strict=True)]
            gap = min(self._gap(here, 2.0 * gap), 2.0 * gap)  # the last step can at most double it
            if gap <= OUTSIDE:
                break
            share = min(share + gap / max(far, 1e-12), 1.0)
        return here

    def _gap(self, bodies: Sequence[ContactBody], reach: float = np.inf) -> float:
        """Return the smallest gap of the undeformed skin [m]; inf if no body is within reach."""
        return self.solver.outside(bodies, reach)

    # -- all the way through -------------------------------------------------------------------------------------

    def _felt(self, bodies: Sequence[ContactBody]) -> list[ContactBody]:
        """Return the bodies; those that are ignored are `AWAY`."""
        for index in self._left:
            if index >= len(bodies) or not (bodies[index].away or in_or_above(self.solver, bodies[index])):
                self._left -= {index}
        return [AWAY if index in self._left else body for index, body in enumerate(bodies)]

    def _turned_over(self, bodies: Sequence[ContactBody]) -> None:
        """Ignore bodies that were turned inside out, because they may then enclose the skin."""
        for index, body in enumerate(bodies):
            if body.away or not isinstance(body.surface, Surface) or not body.surface.closed:
                continue
            facing = body.surface.volume if body.carry is None else body.surface.volume * np.linalg.det(body.carry)
            if facing * self._facing.get(index, facing) < 0.0:
                self._leave(index, "turned-over", "an object was turned inside out", "Keep its scale on one side of 0")
            self._facing[index] = facing

    def _crossed(self, bodies: Sequence[ContactBody]) -> None:
        """Ignore open surfaces through which the bone passed, because their side of contact would change."""
        for index in self.solver.loaded_bodies:
            a, b = self.solver.bodies[index], bodies[index]
            if a.away or b.away or not isinstance(b.surface, Surface) or b.surface.closed:
                continue
            way = [body.local(self.solver.bone[None])[0] for body in (a, b)]
            if _meets(b.surface, *way):
                self._leave(index, "passed-through", THROUGH, "Raise the finger")

    def _leave(self, index: int, code: str, what: str, remedy: str) -> None:
        self._left |= {index}
        self._warn(code, what + UNFELT, remedy)

    def _through(self, step: PathStep, bodies: Sequence[ContactBody]) -> PathStep:
        gaps = step.gaps
        if gaps is None or not -gaps.gap.min() > self.deepest:
            return step
        deep = np.unique(gaps.body[-gaps.gap > self.deepest])
        gone = {int(i) for i in deep if _outside_bone(bodies[i], self.solver.bone)}
        if not gone:
            return step
        over = ways_out(self.solver, gone, bodies, self.deepest)
        for index in gone - over.keys():
            self._leave(index, "passed-through", THROUGH, "Raise the finger")
        if not over:
            return self._last(self._felt(bodies))
        what = "the skin hung on the rim of an object that slid under the finger, and is pressed onto it anew"
        self._warn("over-a-rim", what, "Raise the finger, or come from above")
        return self._anew(over, self._felt(bodies))

    def _slid_past(self, step: PathStep, bodies: Sequence[ContactBody]) -> PathStep:
        """Press bodies again from below that the skin has slid past; ignore those that it slides past once more.

        Tell if skin hangs on faces that draw it out of the finger.
        """
        share, pulling = self._press.outward(step, self.solver.inward)
        over = ways_out(self.solver, pulling, bodies, self.deepest) if pulling else {}
        if over:
            step = self._anew(dict.fromkeys(over, max(over.values())), self._felt(bodies))
            share, pulling = self._press.outward(step, self.solver.inward)
            if over.keys() - set(pulling):
                self._warn("slides-past", PAST + ANEW, LESS)
        for index in pulling:
            self._leave(index, "passed-through", PAST, LESS)
        limit = hangs(step.solution)
        if share > limit and not pulling:
            value, most = f"{1e2 * share:.2g}% of the normal force", f"<= {1e2 * limit:.2g}%"
            self._warn("hangs-behind", HANGING, HANGING_LESS, value=value, limit=most)
        return self._last(self._felt(bodies)) if pulling else step

    def _anew(self, far: dict[int, float], bodies: list[ContactBody]) -> PathStep:
        """Press bodies again from below.

        Args:
            far: distance by which each must be lowered for the finger to be outside [m], by the index of the body.
            bodies: all bodies.
        """
        self.solver.step([AWAY if i in far else body for i, body in enumerate(bodies)], part=True)
        parts = max(int(np.ceil(min(max(far.values()), self.solver.depth_limit) / PRESSING)), 1)
        for k in range(parts - 1, 0, -1):
            part = [lowered(b, far[i] * k / parts) if i in far else b for i, b in enumerate(bodies)]
            self.solver.step(part, part=True)
        return self._last(bodies)

    def _last(self, bodies: list[ContactBody]) -> PathStep:
        return self.solver.step(bodies, scene_frame=self._number)


def _meets(surface: Surface, start: Array, end: Array) -> bool:
    """Return whether a straight line between points [m], shape (n, 3), crosses a surface from either side."""
    return any((first_crossing(surface.table, start, end, side)[0] >= 0).any() for side in (1, -1))


def _rub(bodies: Sequence[ContactBody]) -> bool:
    return any(body.friction > 0.0 for body in bodies if not body.away)


def _outside_bone(body: ContactBody, bone: Array) -> bool:
    return isinstance(body.surface, Surface) and float(body.surface.query(body.local(bone)[0][None]).gap[0]) > 0.0

"""SkinStepper: one finger's skin contact, advanced by one sample at a time, for a bake and for a preview alike.

It finds the bodies near the fingertip, poses them in the finger's frame, solves one sample with the animated or
compliant bone, and sums up the result. A sweep steps it through the samples of its chunks. A preview steps it through
the frames that are visited, and goes back to a saved state to solve a frame again. For contact on
points, the solver is built when something first comes near; until then only bounding boxes are compared and idle
samples counted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import Finding
from ..parameters.skin import SKIN_CONTACT
from ..scene.tactile_scene import Finger
from ..skin.model import SkinModel
from ..skin.point_forces import PointForces
from ..skin.surface_store import no_smooth_pad, smooth_pad
from ..surface.gap import Surface
from .coarse_touches import CoarseTouches
from .compliant_bone import BoneStep, CompliantBone, touch_depth
from .doubtful_touches import DoubtfulTouches
from .posed_scene import PosedScene
from .proximity import Proximity
from .sample_window import Approach
from .skin_contact import SkinStep
from .solver.bodies import AWAY, ContactBody, NodeGaps
from .solver.grip import GripStep
from .solver.pad_points import REACH

# An object counts as flat or gently curved if at least SEVERAL points of the skin are nearer to it than NEARBY [m], and
# its normals at all these points have a cosine above GENTLE with their mean.
NEARBY, GENTLE, SEVERAL = 0.3e-3, 0.9, 12


class SkinStepper:
    """One finger's contact with the bodies of a scene.

    Args:
        skin: model of the finger's skin.
        index: index of the finger in the chunks.
        finger: its header: name and touch depth.
        scene: the posed scene; `step` solves the samples of its current chunk.
        tolerance: largest residual that the contact solver accepts, see `Solution.residual`.

    Attributes:
        far: number of pairs of a body and a sample that the broad phase skipped.
        surface: the smooth pad on whose points contact is solved; None if contact is solved at nodes.
        strides: whether a sweep may solve only some samples and interpolate the forces between them, see `Strides`.

    Raises:
        DermisError: an unknown mode of the touch depth, or a spring or force limit that is not above zero.
    """

    def __init__(
        self, skin: SkinModel, index: int, finger: Finger, scene: PosedScene, *, tolerance: float | None = None
    ) -> None:
        self.skin, self.index, self.name = skin, index, f"finger '{finger.name}'"
        self._finger, self._tolerance = finger, tolerance
        wanted = SKIN_CONTACT["contact"].of(finger.parameters, self.name) == "points"
        self.surface = smooth_pad(skin) if wanted else None
        # Strides need contact on points: with contact at nodes, the set of loaded nodes changes from sample to sample.
        # They also need an animated depth: a compliant bone gives way suddenly at its force limit.
        solved_at, mode = (SKIN_CONTACT[name].of(finger.parameters, self.name) for name in ("solved_at", "depth_mode"))
        self.strides = self.surface is not None and solved_at == "way" and mode == "animated"
        self._told: tuple[Finding, ...] = ()
        if wanted and self.surface is None:
            self._told += (no_smooth_pad(skin, self.name),)
        touch_depth(finger.parameters, self.name)  # a wrong setting is refused now, not when something comes near
        self._bone: CompliantBone | None = None
        self._idle = 0  # samples before `bone` was made
        self._coarse = None if self.on_points else CoarseTouches(skin.mesh, self.name)
        self._doubts = DoubtfulTouches(self.name, lambda index: f"object '{scene.name(self._order[index])}'")
        self.far = 0
        self._scene = scene
        low, high = skin.positions.min(axis=0), skin.positions.max(axis=0)
        self._middle, self._half = (low + high) / 2, (high - low) / 2
        self._order: list[int] = []  # every body that has come near so far
        self._gaps: NodeGaps | None = None  # of the sample that was solved last
        self._gentle: bool | None = None  # see `gentle`; None: not known yet
        self._radius = REACH if self.on_points else self.bone.solver.search_radius

    @property
    def bone(self) -> CompliantBone:
        """The path solver and the finger's bone, animated or compliant; made when it is first asked for."""
        if self._bone is None:
            self._bone = CompliantBone.of(self.skin, self._finger.parameters, self.name, self._tolerance, self.surface)
            self._at_first = self._bone.save()
            self._proximity = Proximity(self._bone.solver.places, self._bone.solver.bone)
            if self._idle:
                self._bone.idle(self._idle)
        return self._bone

    def approach(self) -> Approach:
        """Find the bodies whose bounding boxes come within the search radius of the fingertip's box, sample by sample.

        The samples are those of the chunk. A body of scale 0 is left out; `PadSampler` reports it.

        Raises:
            DermisError: a deforming object has no surface.
        """
        turn, place = self._scene.turns()[self.index], self._scene.chunk.fingers[self.index, :, :3, 3]
        middle = place + turn @ self._middle
        half = np.abs(turn) @ self._half + self._radius
        within, box_middle, box_half, flat = self._scene.near((middle - half).min(axis=0), (middle + half).max(axis=0))
        inside = (np.abs(middle - box_middle) <= half + box_half).all(axis=2) & ~flat
        self.far += self._scene.chunk.bodies.shape[0] * len(place) - int(inside.sum())
        ever = inside.any(axis=1)
        near = within[ever].tolist()
        boxes = {b: self._scene.own_boxes(b) for b in near}
        poses = self._scene.relative(turn, place, near)
        return Approach(dict(zip(near, inside[ever], strict=True)), turn, place, poses, boxes)

    def step(self, approach: Approach, i: int, *, coarse: bool = False) -> SkinStep:
        """Solve sample `i` of the chunk; `coarse` limits the number of sub-steps, see `cut`."""
        if self._bone is None and not approach.close(i):
            return self.idle()
        self.bone.sub_steps.coarse, self.bone.sub_steps.cut = coarse, False
        bodies = self.around(approach, i)
        if all(body.away for body in bodies):
            return self.idle()
        frame = float(self._scene.chunk.frames[i])
        return self._taken(self.bone.step(bodies, frame, lambda: self._before(i)), frame)

    def idle(self, count: int = 1) -> SkinStep:
        """Count samples in which nothing is near, and forget the friction history."""
        if self._bone is None:
            self._idle += count
        else:
            self._bone.idle(count)
        if self._coarse is not None:
            self._coarse.end()
        return SkinStep(np.zeros((self.skin.pad_count, 3)))

    def around(self, approach: Approach, i: int, *, untouched: bool = False) -> list[ContactBody]:
        """Return every body that has come near so far, as it is at sample `i`, always in the same order.

        A body out of reach is returned as `AWAY`. The reach allows for the bulging of loaded skin.

        Args:
            untouched: do not test reach, so that every body whose bounding box is near gets its pose.
        """
        close, loaded = approach.close(i), self.bone.solver.loaded_bodies
        # appended as soon as it is near, so a body's index in the solver never changes, wherever chunks end
        self._order += sorted(close.difference(self._order))
        known = close if untouched else {self._order[k] for k in loaded if k >= 0} & close
        reach = within = None
        if len(known) < len(close):
            reach = self._proximity.grouped(self.bone.solver.reach)
            within = self._proximity.within(approach.poses, approach.boxes, i, reach) & close
        return [
            self._body(approach, i, b, None if b in known else reach) if b in known or within and b in within else AWAY
            for b in self._order
        ]

    def _body(self, approach: Approach, i: int, b: int, reach: Array | None) -> ContactBody:
        """Return a body at a sample, or `AWAY` if its gap to each group of skin points exceeds the reach of the group.

        Args:
            reach: reach of each group [m], shape (g,); None: not tested.
        """
        if reach is None:
            return self._scene.seen_from(approach.turn[i], approach.place[i], b, i)
        mesh = self._scene.mesh_at(b, i)
        if (self._proximity.gaps(b, i, approach.poses, mesh) > reach).all():
            return AWAY
        body = self._scene.seen_from(approach.turn[i], approach.place[i], b, i)
        return AWAY if (self._proximity.measure(b, i, approach.poses, mesh, body) > reach).all() else body

    def _before(self, i: int) -> list[ContactBody] | None:
        """Return all bodies of `around` at the sample before `i`, however far away; None if a pose is not known."""
        pose = self._scene.finger_before(self.index, i)
        seen = [] if pose is None else [self._scene.seen_before(*pose, b, i) for b in self._order]
        known = [body for body in seen if body is not None]
        return known if known and len(known) == len(seen) else None

    def settings(self, b: int) -> Array:
        """Return a body's friction and stiffness at every sample of the chunk, see `PosedScene.settings`."""
        return self._scene.settings(b)

    def place_of(self, b: int) -> int:
        """Return the index of body `b` in the list that `around` returns."""
        return self._order.index(b)

    def adopt(self, held: GripStep, k: int, retraction: float, scene_frame: float) -> SkinStep:
        """Take over a sample that was solved together with other fingers.

        Args:
            held: the result, in which this finger has the number `k`.
            retraction: retraction of the finger's bone [m].
        """
        bone = self.bone.adopt(held.forces[k], held.slips[k], held.gaps[k], held.residual, retraction, scene_frame)
        return self._taken(bone, scene_frame)

    @property
    def cut(self) -> bool:
        """Whether the last sample was solved in fewer sub-steps than its friction requires."""
        return self._bone is not None and self._bone.sub_steps.cut

    @property
    def on_points(self) -> bool:
        """Whether contact is solved on points of the smooth skin."""
        return self.surface is not None

    @property
    def gentle(self) -> bool:
        """Whether, in the last solved sample, all points near an object face one smooth piece of one object."""
        if self._gentle is None:
            self._gentle = self._gaps is not None and _faces_one_piece(self._gaps)
        return self._gentle

    def _taken(self, bone: BoneStep, frame: float) -> SkinStep:
        """Sum up a sample that was solved."""
        solution, solver = bone.step.solution, self.bone.solver
        self._gaps, self._gentle = bone.step.gaps, None
        if self._coarse is not None:
            self._coarse.take(solution, frame)
        self._doubts.take(bone.step, frame, on_points=self.on_points)
        if self.surface is None or not solution.loaded.any():
            return _skin_step(bone)
        loaded = solution.loaded.nonzero()[0]
        points = PointForces(self.surface, solver.cells[loaded], solution.force[loaded], bone.step.amounts)
        return _skin_step(bone, points)

    def stay_on_nodes(self) -> None:
        """Solve contact at the mesh's nodes, from rest: fingers that may hold an object do not use points."""
        self.surface, self._coarse = None, CoarseTouches(self.skin.mesh, self.name)
        self._bone, self._idle = None, 0
        self._radius = self.bone.solver.search_radius

    def save(self) -> Mapping[str, Any]:
        """Return the state between two samples, for `restore`: a sample may then be solved anew."""
        coarse = None if self._coarse is None else self._coarse.save()
        bone = None if self._bone is None else self._bone.save()
        return {"bone": bone, "idle": self._idle, "far": self.far, "coarse": coarse, "doubts": self._doubts.save()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to a saved state."""
        if state["bone"] is not None:
            self.bone.restore(state["bone"])
        elif self._bone is not None:  # the bone was made after the state was saved
            self._bone.restore(self._at_first)
            self._bone.idle(state["idle"])
        self._idle, self.far = state["idle"], state["far"]
        self._doubts.restore(state["doubts"])
        if self._coarse is not None:
            self._coarse.restore(state["coarse"])

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Samples that did not converge, went too deep or exceeded a force limit, and doubts about the resolution."""
        coarse = () if self._coarse is None else self._coarse.findings
        own = () if self._bone is None else self._bone.solver.findings + self._bone.findings
        return self._told + own + coarse + self._doubts.findings

    @property
    def counters(self) -> Mapping[str, int]:
        """How often each kind of work was done, see `PathSolver`."""
        return Counter(idle=self._idle) if self._bone is None else self._bone.solver.counters


def _skin_step(bone: BoneStep, points: PointForces | None = None) -> SkinStep:
    """Sum up a sample of the solver."""
    step, converged = bone.step, bone.step.solution.converged
    if not step.solution.loaded.any():
        return SkinStep(step.nodal, lift=bone.lift, work=step.work, converged=converged)
    sums = step.sums
    forces, counts = (sums.normal, sums.tangential), (sums.sticking, sums.slipping)
    return SkinStep(
        step.nodal,
        *forces,
        bone.depth,
        bone.lift,
        *counts,
        step.work,
        bool(converged),
        points,
        step.amounts,
        sums.slide,
    )


def _faces_one_piece(gaps: NodeGaps) -> bool:
    """Return whether all points near an object face one smooth piece of one object."""
    near = np.flatnonzero((gaps.body >= 0) & (gaps.clearance < NEARBY))
    if len(near) < SEVERAL:
        return False
    normals, bodies = gaps.normal[near], gaps.body[near]
    mean, surface = normals.sum(axis=0), gaps.bodies[bodies[0]].surface
    if (bodies != bodies[0]).any() or (normals @ mean).min() <= GENTLE * np.sqrt(mean @ mean):
        return False
    if not isinstance(surface, Surface):
        return True
    pieces = surface.pieces[gaps.triangle[near]]
    return bool((pieces == pieces[0]).all())

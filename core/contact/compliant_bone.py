"""CompliantBone: contact of a finger whose bone follows its animation or gives way like a joint.

Animated fingers often penetrate objects too deeply. A compliant bone has a spring along the pad's normal (the finger's
Z), and is retracted if the force exceeds a limit. The spring is a compliance common to all nodes, so it is solved
together with the skin. For the force limit, the bone is retracted until the force equals the limit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import Finding
from ..parameters.skin import SKIN_CONTACT
from ..skin.model import SkinModel
from ..skin.nodal_forces import NodalForces
from ..skin.surface_compliance import SurfaceCompliance
from .solver.bodies import ContactBody, NodeGaps
from .solver.contact_points import ContactPoints
from .solver.law_skin import LawSkin
from .solver.nodes import Nodes
from .solver.notes import Notes
from .solver.pad_points import PadPoints
from .solver.path_solver import TOLERANCE, PathSolver, PathStep
from .solver.sub_stepper import SubStepper
from .trusted import WORDS, trusted

LIMIT_TOLERANCE = 1e-3  # error of the force, relative to its limit
MAX_TRIALS = 12  # largest number of retractions that are tried in a frame


@dataclass(frozen=True, eq=False)
class BoneStep:
    """One frame of contact with the bone's displacement.

    Attributes:
        step: contact of the skin.
        lift: displacement of the bone by its spring and its retraction [m].
        depth: penetration of the undeformed skin after this displacement [m].
    """

    step: PathStep
    lift: float
    depth: float


class CompliantBone:
    """Contact solver of a finger with an animated or compliant bone.

    Args:
        solver: contact solver of the finger. Its compliance includes the spring.
        stiffness: stiffness of the spring [N/m]; 0 for a bone that follows the animation exactly.
        force_limit: largest force on the bone along Z [N]; inf for no limit.
        name: name of the finger, for findings.
        tissue: tissue model of the finger, 'linear' or 'neo_hookean'.
        modulus: Young's modulus of the skin [Pa].

    Attributes:
        sub_steps: divides frames into sub-steps for the solver.
    """

    def __init__(
        self, solver: PathSolver, stiffness: float, force_limit: float, name: str, tissue: str, modulus: float
    ) -> None:
        self.solver, self.stiffness, self.force_limit, self.name = solver, stiffness, force_limit, name
        self._tissue, self._range = WORDS[tissue], trusted(tissue)
        self.sub_steps = SubStepper(solver, float(np.linalg.norm(solver.bone)), modulus)
        self._retraction = 0.0  # retraction by the force limit, without the spring's displacement [m]
        self._slope = 0.0
        self._before: Callable[[], Sequence[ContactBody] | None] = lambda: None
        self._notes = Notes(name)

    @classmethod
    def of(
        cls,
        skin: SkinModel,
        parameters: Mapping[str, Any],
        name: str,
        tolerance: float | None = None,
        surface: SurfaceCompliance | None = None,
    ) -> CompliantBone:
        """Build the solver from a finger's parameters.

        Args:
            skin: model of the finger's skin.
            parameters: parameters of the finger: depth_mode, bone_stiffness [N/m], force_limit [N].
            name: name of the finger, for findings.
            tolerance: largest residual of the contact solver; None for its default.
            surface: smooth pad of the same skin, on whose points contact is solved; None to solve at the mesh's nodes.

        Raises:
            DermisError: the mode is unknown, or the stiffness or the limit is out of range.
        """
        stiffness, limit = touch_depth(parameters, name)
        # With a spring, the penetration is known only after the solve, and `_bone_step` checks it.
        depth_limit = trusted(skin.tissue).depth if stiffness == 0 else np.inf
        accepted, law = TOLERANCE if tolerance is None else tolerance, LawSkin.of(skin)
        points: ContactPoints
        if surface is not None:
            if stiffness:
                surface = surface.with_spring(np.array([0.0, 0.0, 1.0]), stiffness)
            points = PadPoints(surface, NodalForces.of(skin.mesh, surface.chart, skin.follows_law))
        else:
            compliance = skin.compliance
            if stiffness:
                compliance = compliance.copy()
                compliance[2::3, 2::3] += 1.0 / stiffness
            points = Nodes.of(skin.positions, skin.normals, skin.areas, compliance, name=name)
        solver = PathSolver(points, tolerance=accepted, name=name, depth_limit=depth_limit, law=law)
        return cls(solver, stiffness, limit, name, skin.tissue, skin.material.modulus)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Frames in which the force limit was not reached, and those outside the range of the tissue model."""
        return self._notes.findings()

    def idle(self, count: int = 1) -> PathStep:
        """Take `count` frames in which nothing is near."""
        self._retraction = 0.0
        return self.sub_steps.idle(count)

    def save(self) -> Mapping[str, Any]:
        """Return the state between two frames, for `restore`."""
        return {
            "solver": self.sub_steps.save(),
            "retraction": self._retraction,
            "slope": self._slope,
            "notes": self._notes.copy(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to a saved state."""
        self.sub_steps.restore(state["solver"])
        self._retraction, self._slope, self._notes = state["retraction"], state["slope"], state["notes"].copy()

    def step(
        self,
        bodies: Sequence[ContactBody],
        scene_frame: float,
        before: Callable[[], Sequence[ContactBody] | None] = lambda: None,
    ) -> BoneStep:
        """Solve the next frame.

        Args:
            bodies: bodies in the finger's frame.
            scene_frame: scene frame, for findings.
            before: function that returns the same bodies in the frame before, or None. It is called if the finger
                touched nothing there.
        """
        self._before = before
        if np.isfinite(self.force_limit):
            step, retraction = self._limited(bodies, scene_frame)
        else:
            step, retraction = self.sub_steps.step(bodies, before, scene_frame=scene_frame), 0.0
        return self._bone_step(step, retraction, scene_frame)

    def retraction(self, bodies: Sequence[ContactBody], scene_frame: float) -> float:
        """Return the retraction by the force limit in the next frame [m]; the state is not changed."""
        if not np.isfinite(self.force_limit):
            return 0.0
        self._before = lambda: None
        before, found = self.sub_steps.save(), self._notes.copy()
        _, retraction = self._limited(bodies, scene_frame)
        self.sub_steps.restore(before)
        self._notes = found
        return retraction

    def adopt(
        self, force: Array, displacement: Array, gaps: NodeGaps, residual: float, retraction: float, scene_frame: float
    ) -> BoneStep:
        """Take over a frame that was solved together with other fingers.

        Args:
            force: forces on the nodes [N], shape (m, 3).
            displacement: relative displacement w of the nodes [m], shape (m, 3).
            gaps: gaps of the nodes.
            residual: residual of the contact laws.
            retraction: retraction of the bone [m].
            scene_frame: scene frame, for findings.
        """
        step = self.solver.adopt(force, displacement, gaps, residual, scene_frame=scene_frame)
        self.sub_steps.adopted()
        return self._bone_step(step, retraction, scene_frame)

    def _bone_step(self, step: PathStep, retraction: float, scene_frame: float) -> BoneStep:
        spring = self._spring(step)
        depth = max(step.sums.depth - spring, 0.0)
        if spring > 0 and depth > self._range.depth:
            remedy = "Raise the finger, or use a softer spring"
            self._notes.too_deep(self._tissue, depth, self._range.depth, scene_frame, remedy=remedy)
        if step.sums.slide > self._range.slide:
            self._notes.warn(
                "slid-far",
                f"the finger is dragged farther than {self._tissue} skin is trusted, and its force may depend on the "
                "sample rate",
                scene_frame,
                value=f"{1e3 * step.sums.slide:.2f} mm",
                limit=f"<= {1e3 * self._range.slide:.3g} mm",
                remedy="Press less deep while it slides, or use less friction",
            )
        return BoneStep(step, retraction + spring, depth)

    def _limited(self, bodies: Sequence[ContactBody], scene_frame: float) -> tuple[PathStep, float]:
        """Solve a frame with the retraction at which the force equals its limit, or zero if it is below it."""
        before = self.sub_steps.save()
        low, high = 0.0, np.inf  # bounds of the retraction: the force is too large at `low` and too small at `high`
        retraction, step = self._retraction, self._try(bodies, self._retraction, scene_frame)
        for _ in range(MAX_TRIALS):
            excess = self._force(step) - self.force_limit
            if abs(excess) <= LIMIT_TOLERANCE * self.force_limit or (excess < 0 and retraction == 0.0):
                break
            low, high = (retraction, high) if excess > 0 else (low, retraction)
            trial = self._next(retraction, excess, low, high, step)
            self.sub_steps.restore(before)
            following = self._try(bodies, trial, scene_frame)
            if trial != retraction:
                self._slope = (excess + self.force_limit - self._force(following)) / (trial - retraction)
            retraction, step = trial, following
        else:
            what = "the bone could not give way enough to keep its force limit"
            self._notes.warn(
                "force-limit",
                what,
                scene_frame,
                value=f"{self._force(step):.3g} N",
                limit=f"{self.force_limit:g} N",
                remedy="Use smaller steps, or a softer spring",
            )
        self._retraction = retraction
        return step, retraction

    def _try(self, bodies: Sequence[ContactBody], retraction: float, scene_frame: float) -> PathStep:
        if retraction > 0.0:
            down = np.array([0.0, 0.0, -retraction])  # in the finger's frame, all bodies move down
            bodies = [replace(body, translation=body.translation + down) for body in bodies]
        return self.sub_steps.step(bodies, self._before, scene_frame=scene_frame)

    def _next(self, retraction: float, excess: float, low: float, high: float, step: PathStep) -> float:
        """Return the next retraction: a secant step, or the middle of the bounds if that step exceeds them."""
        slope = self._slope
        if not slope > 0.0:
            slope = self._force(step) / max(step.sums.depth, 1e-5)
        trial = max(retraction + excess / max(slope, 1e-6), 0.0)
        if not low < trial < high and trial != 0.0:
            trial = (low + high) / 2 if np.isfinite(high) else 2 * retraction + 1e-4
        return trial

    def _force(self, step: PathStep) -> float:
        return float(step.sums.resultant[2])

    def _spring(self, step: PathStep) -> float:
        return self._force(step) / self.stiffness if self.stiffness > 0 else 0.0


def touch_depth(parameters: Mapping[str, Any], name: str) -> tuple[float, float]:
    """Return the stiffness of the bone's spring [N/m], 0 for none, and the force limit [N], inf for none.

    Args:
        parameters: parameters of the finger.
        name: name of the finger, for errors.

    Raises:
        DermisError: the mode is unknown, or the stiffness or the limit is out of range.
    """
    if SKIN_CONTACT["depth_mode"].of(parameters, name) != "compliant":
        return 0.0, np.inf
    spring, limit = (float(SKIN_CONTACT[key].of(parameters, name)) for key in ("bone_stiffness", "force_limit"))
    return spring, limit

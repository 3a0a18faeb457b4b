"""HeldBodies: objects held by several fingers, balanced with all their contacts, sample after sample."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..errors import Finding
from ..scene.tactile_scene import TactileScene
from .held_body import HeldBody, rigid
from .pad_contact import PadContact
from .posed_scene import PosedScene
from .sample_window import SampleWindow
from .skin_contact import SkinStep
from .skin_stepper import SkinStepper
from .solver.grip_solver import GripStep, HoldContext, HoldingFinger
from .solver.nodes import Nodes


class HeldBodies:
    """Bodies of a scene that may be held.

    Args:
        scene: the scene's header.
        pad_contact: contact of the pads over the whole range. It determines the samples at which a body is held, and
            the body's acceleration.
        candidates: indices of the bodies.
        posed: the posed scene, whose chunk must be that of the window.
        steppers: steppers of the fingers whose skin is simulated.
    """

    def __init__(
        self,
        scene: TactileScene,
        pad_contact: PadContact,
        candidates: Iterable[int],
        posed: PosedScene,
        steppers: Mapping[int, SkinStepper],
    ) -> None:
        self._posed, self._steppers = posed, steppers
        skins = {f: _holding_finger(stepper) for f, stepper in steppers.items()}
        self._held = [HeldBody(scene, pad_contact, b, skins) for b in sorted(candidates)]

    @property
    def findings(self) -> dict[int, tuple[Finding, ...]]:
        """Findings about the held bodies, by the index of the body."""
        return {body.index: body.findings for body in self._held}

    def step(self, window: SampleWindow, i: int, sample: int) -> dict[int, SkinStep]:
        """Balance the held bodies at one sample.

        Args:
            window: samples after the broad phase.
            i: index of the sample in the window.
            sample: index of the sample in the whole range.

        Returns:
            Touches of the fingers that hold something, by the index of the finger.
        """
        steps: dict[int, SkinStep] = {}
        frame = float(window.chunk.frames[i])
        for body in self._held:
            near = (f for f in body.order if body.index in window.fingers[f].near)
            fingers = [f for f in near if window.fingers[f].near[body.index][i]]
            if not body.held[sample] or not fingers or not steps.keys().isdisjoint(fingers):
                if body.held[sample] and fingers:
                    body.shared(frame)
                body.let_go()
                continue
            step, retractions = self._balance(body, fingers, window, i, sample)
            if step is None:
                body.let_go()
                continue
            for k, f in enumerate(fingers):
                steps[f] = self._steppers[f].adopt(step, k, retractions[k], frame)
        return steps

    def _balance(
        self, body: HeldBody, fingers: Sequence[int], window: SampleWindow, i: int, sample: int
    ) -> tuple[GripStep | None, list[float]]:
        """Balance one body; return the result, or None, and the retraction of each finger's bone [m]."""
        b, frame = body.index, float(window.chunk.frames[i])
        surface, turn, origin, _, _ = self._posed.at(b, i)
        contexts: dict[int, HoldContext] = {}
        retractions = []
        for f in fingers:
            stepper, approach = self._steppers[f], window.fingers[f]
            around, own = stepper.around(approach, i, untouched=True), stepper.place_of(b)
            pose = rigid(approach.turn[i], approach.place[i])
            displaced = body.body(pose, surface, turn, origin, sample)
            tried = replace(around[own], rotation=displaced.rotation, translation=displaced.translation)
            retraction = stepper.bone.retraction([*around[:own], tried, *around[own + 1 :]], frame)
            if retraction > 0.0:
                down = np.array([0.0, 0.0, -retraction])
                around = [replace(a, translation=a.translation + down) for a in around]
                pose[:3, 3] -= pose[:3, :3] @ down
            retractions.append(retraction)
            contexts[f] = HoldContext(pose, tuple(around), own, stepper.bone.solver.history)
        step = body.step(sample, surface, turn, origin, [contexts.get(f) for f in body.order], frame)
        return step, retractions


def _holding_finger(stepper: SkinStepper) -> HoldingFinger:
    solver = stepper.bone.solver
    assert isinstance(solver.contact_points, Nodes)  # see `SkinStepper.stay_on_nodes`
    # the law is the same object, so that its state continues from grip to touch
    return HoldingFinger(solver.contact_points, stepper.name, solver.bone, solver.law)

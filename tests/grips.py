"""A grip of fingers that touch nothing else, frame after frame, with their friction's history."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from core.contact.solver.bodies import BONE, ContactBody
from core.contact.solver.grip import GripStep, HoldContext, HoldingFinger
from core.contact.solver.grip_solver import GripSolver
from core.contact.solver.history import ContactHistory
from core.contact.solver.nodes import Nodes
from core.skin.model import SkinModel
from core.surface.gap import Surface

Array = NDArray[np.float64]
NOTHING = np.zeros(3)


class LoneGrip:
    """Fingers that hold an object as heavy as its box, its centre of mass in the middle."""

    def __init__(
        self, surface: Surface, mass: float, fingers: Sequence[HoldingFinger], friction: float, gravity: Array
    ) -> None:
        size = surface.box[1] - surface.box[0]
        inertia = np.diag((size @ size - size**2) / 12.0)
        centre = surface.box.mean(axis=0)
        self.solver = GripSolver(surface, fingers, centre=centre, inertia=inertia, gravity=gravity, name="object")
        self.solver.mass, self.solver.friction = mass, friction
        self._histories = [ContactHistory(f.points.shape[0]) for f in fingers]

    def step(
        self,
        pose: Array,
        finger_poses: Sequence[Array],
        acceleration: Array = NOTHING,
        angular_velocity: Array = NOTHING,
        angular_acceleration: Array = NOTHING,
        scene_frame: float = 0.0,
    ) -> GripStep:
        """Solve the next frame; arguments as in `GripSolver.step_among`, and the fingers' poses, (4, 4) each."""
        alone = (ContactBody(self.solver.surface),)
        contexts = [HoldContext(p, alone, 0, h) for p, h in zip(finger_poses, self._histories, strict=True)]
        rates = acceleration, angular_velocity, angular_acceleration
        step = self.solver.step_among(pose, contexts, *rates, scene_frame=scene_frame)
        assert step is not None
        return step


def nodes_of(skin: SkinModel) -> Nodes:
    """Return the pad nodes of a skin."""
    return Nodes.of(skin.positions, skin.normals, skin.areas, skin.compliance, BONE)

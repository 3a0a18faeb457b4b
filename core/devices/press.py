"""Many poses of a platform pressed into the skin at once, each coming from rest.

A platform is a rigid disc under the pad, in a frame parallel to the finger's whose face looks along +Z, carried by
something: rigid legs, or cables and springs that give way. Giving way enters the contact problem as a compliance of
rank six, w = (C + J P J') f + b, so that platform and skin are in balance together.

Each row is a path of its own: from rest to the first touch without contact, then in `steps` equal parts into the skin,
with friction's memory from part to part as in `contact.solver.path`. The rows of a batch go through the alternating
method side by side: one matrix product for all of them.

Source: [S2] III.A (data collection); method as in `contact.solver.admm`
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32
from ..errors import DermisError
from .poses import Poses
from .press_problem import Carrier, PressProblem
from .press_state import PressState

STEPS = 3
BATCH = 256
TOUCH_MARGIN = 0.02  # the path in contact begins this share of the whole before the first touch


@dataclass(frozen=True, eq=False)
class Pressed:
    """Rows after pressing.

    Attributes:
        force: on the skin at the pad nodes [N], shape (n, m, 3), float32.
        displacement: of the pad nodes [m], shape (n, m, 3), float32.
        poses: of the platform, in balance.
        touching: shape (n,).
        residual: |f - P(f - w / rho)| / |f| of the contact, shape (n,).
        imbalance: force on the platform left over [N], shape (n,).
    """

    force: Floats32
    displacement: Floats32
    poses: Poses
    touching: NDArray[np.bool_]
    residual: Array
    imbalance: Array


class Press:
    """Presses one skin with one platform.

    Args:
        compliance: of the pad nodes [m/N], shape (3 m, 3 m).
        positions: undeformed pad nodes in the finger's frame [m], shape (m, 3).
        carrier: what carries the platform.
        friction: Coulomb's coefficient.
        steps: parts of the path in contact.

    Raises:
        DermisError: a compliance that is not positive definite, or no step.
    """

    def __init__(
        self, compliance: Array, positions: Array, carrier: Carrier, friction: float, *, steps: int = STEPS
    ) -> None:
        if steps < 1:
            raise DermisError("too few steps", where="platform", value=steps, limit=">= 1")
        self.problem = PressProblem(compliance, positions, carrier, friction)
        self.carrier, self.steps = carrier, int(steps)

    def press(self, commands: Array, *, via: Array | None = None) -> Pressed:
        """Press rows from rest, in batches.

        Args:
            commands: shape (n, motors).
            via: commands that each row goes to first and then comes back from, shape (n, motors); None for straight.
        """
        parts = [
            self._batch(commands[i : i + BATCH], None if via is None else via[i : i + BATCH])
            for i in range(0, len(commands), BATCH)
        ]
        if not parts:
            m = self.problem.count
            none = np.zeros((0, m, 3), np.float32)
            return Pressed(none, none, self.carrier.rest_poses(0), np.zeros(0, bool), np.zeros(0), np.zeros(0))
        return Pressed(
            np.concatenate([p.force for p in parts]),
            np.concatenate([p.displacement for p in parts]),
            Poses(np.concatenate([p.poses.rotation for p in parts]), np.concatenate([p.poses.centre for p in parts])),
            np.concatenate([p.touching for p in parts]),
            np.concatenate([p.residual for p in parts]),
            np.concatenate([p.imbalance for p in parts]),
        )

    # -- a batch -----------------------------------------------------------------------------------------------------

    def _batch(self, commands: Array, via: Array | None) -> Pressed:
        n, m = len(commands), self.problem.count
        rest = np.broadcast_to(self.carrier.rest, commands.shape)
        start = self.carrier.rest_poses(n)
        legs = [commands] if via is None else [via, commands]
        free = self.carrier.carry(legs[0], start)
        before, after = self.problem.gap(start).min(axis=1), self.problem.gap(free).min(axis=1)
        share = np.where(after < 0.0, before / np.maximum(before - after, 1e-12), 1.0) - TOUCH_MARGIN
        share = np.clip(share, 0.0, 1.0)[:, None]
        touch = rest + share * (legs[0] - rest)
        part = (1.0 - share) * start.centre + share * free.centre
        near = self.carrier.carry(touch, Poses(free.rotation, part))
        state = PressState(self.problem, near)
        path = [touch + (legs[0] - touch) * (k / self.steps) for k in range(1, self.steps + 1)]
        if via is not None:
            path += [via + (commands - via) * (k / self.steps) for k in range(1, self.steps + 1)]
        with np.errstate(over="ignore", invalid="ignore"):  # a row may have no balance; the others go on
            for k, command in enumerate(path):
                state.step(command, last=k == len(path) - 1)
        force = np.ascontiguousarray(state.force.reshape(n, 3, m).transpose(0, 2, 1))
        moved = np.ascontiguousarray(state.image.reshape(n, 3, m).transpose(0, 2, 1))
        touching = np.asarray(force.any(axis=(1, 2)))
        return Pressed(force, moved, state.poses, touching, state.residual, state.imbalance)

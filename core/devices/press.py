"""Many poses of a platform pressed into the skin at once, each coming from rest.

A platform is a rigid disc under the pad, in a frame parallel to the finger's whose face looks along +Z, carried by
something: rigid legs, or cables and springs that give way. Giving way enters the contact problem as a compliance of
rank six, w = (C + J P J') f + b, so that platform and skin are in balance together.

Each row is a path of its own: from rest to the first touch without contact, then in `steps` equal parts into the skin,
with friction's memory from part to part as in `contact.path`. The rows of a batch go through the alternating method
side by side: one matrix product for all of them.

Source: [S2] III.A (data collection); method as in `contact.admm`
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError
from .poses import Poses
from .press_state import PressState

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

ROUNDING = 1.0e-3  # [m] radius by which the disc's rim falls away
STEPS = 3
BATCH = 256
TOUCH_MARGIN = 0.02  # the path in contact begins this share of the whole before the first touch


class Carrier(Protocol):
    """What carries a platform."""

    @property
    def disc_radius(self) -> float:
        """Radius of the face that touches [m]."""
        ...

    @property
    def rest(self) -> Array:
        """Command of the reference configuration, shape (motors,)."""
        ...

    def carry(self, commands: Array, start: Poses) -> Poses:
        """Return where the platform is without load, for commands (n, motors), found from poses nearby."""
        ...

    def give(self, commands: Array, poses: Poses, *, first: bool) -> tuple[Array, Array] | None:
        """Return what carries the platform at poses that need not be in balance; None where it is rigid.

        Args:
            first: poses are a first guess, from which nobody should conclude that a cable hangs slack.

        Returns:
            Force [N] and moment about the finger's origin [N m] on the platform, shape (n, 6), and P, its movement
            (shift, turn) for a load, symmetric, shape (n, 6, 6).
        """
        ...

    def rest_poses(self, count: int) -> Poses:
        """Return the reference configuration, `count` times."""
        ...


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

    force: Floats
    displacement: Floats
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
        DermisError: shapes that do not fit, negative friction, or no step.
    """

    def __init__(
        self, compliance: Array, positions: Array, carrier: Carrier, friction: float, *, steps: int = STEPS
    ) -> None:
        m = len(positions)
        if compliance.shape != (3 * m, 3 * m):
            raise DermisError("the compliance does not fit the nodes", where="platform", value=compliance.shape)
        if not (np.isfinite(friction) and friction >= 0.0):
            raise DermisError("friction cannot be negative", where="platform", value=friction, limit=">= 0")
        if steps < 1:
            raise DermisError("too few steps", where="platform", value=steps, limit=">= 1")
        self.positions, self.carrier, self.friction, self.steps = positions, carrier, float(friction), int(steps)
        self.count = m
        # by component, so that each component of a batch is one block of columns
        order = np.arange(3 * m).reshape(m, 3).T.ravel()
        ends = np.linalg.eigvalsh(compliance)[[0, -1]]
        if not ends[0] > 0.0:
            raise DermisError("the compliance is not positive definite", where="platform", value=float(ends[0]))
        self._rho = float(np.sqrt(ends[0] * ends[1]))
        c = compliance[order][:, order]
        x, y, z = positions.T
        o, e = np.zeros(m), np.ones(m)
        # how a node of the platform moves: shift + turn x position
        self._jacobian = np.concatenate(
            [
                np.column_stack([e, o, o, o, z, -y]),
                np.column_stack([o, e, o, -z, o, x]),
                np.column_stack([o, o, e, y, -x, o]),
            ]
        )
        inverse = np.linalg.inv(c + self._rho * np.eye(3 * m))
        spread = inverse @ self._jacobian
        self._gram = self._jacobian.T @ spread
        self._compliance = np.ascontiguousarray(c, np.float32)
        self._inverse = np.ascontiguousarray(np.hstack([inverse, spread]), np.float32)
        self._spread = np.ascontiguousarray(spread.T, np.float32)

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
            m = self.count
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

    def gap(self, poses: Poses) -> Array:
        """Return the gap of every undeformed node [m], shape (n, m)."""
        return self._local(poses)[1]

    # -- a batch -----------------------------------------------------------------------------------------------------

    def _batch(self, commands: Array, via: Array | None) -> Pressed:
        n, m = len(commands), self.count
        rest = np.broadcast_to(self.carrier.rest, commands.shape)
        start = self.carrier.rest_poses(n)
        legs = [commands] if via is None else [via, commands]
        free = self.carrier.carry(legs[0], start)
        before, after = self.gap(start).min(axis=1), self.gap(free).min(axis=1)
        share = np.where(after < 0.0, before / np.maximum(before - after, 1e-12), 1.0) - TOUCH_MARGIN
        share = np.clip(share, 0.0, 1.0)[:, None]
        touch = rest + share * (legs[0] - rest)
        part = (1.0 - share) * start.centre + share * free.centre
        near = self.carrier.carry(touch, Poses(free.rotation, part))
        state = PressState(self, near)
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

    def _local(self, poses: Poses) -> tuple[Array, Array]:
        """Return nodes in the platform's frame, (n, m, 3), and their gaps, (n, m) [m]."""
        local = (self.positions[None] - poses.centre[:, None]) @ poses.rotation
        over = np.maximum(np.sqrt(local[:, :, 0] ** 2 + local[:, :, 1] ** 2) - self.carrier.disc_radius, 0.0)
        return local, local[:, :, 2] + over * over * (0.5 / ROUNDING)

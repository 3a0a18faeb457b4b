"""Many poses of a platform pressed into the skin at once, each coming from rest.

A platform is a rigid disc under the pad, in a frame parallel to the finger's whose face looks along +Z, carried by
something: rigid legs, or cables and springs that give way. Giving way enters the contact problem as a compliance of
rank six, w = (C + J P J') f + b, so that platform and skin are in balance together.

Each row is a path of its own: from rest to the first touch without contact, then in `steps` equal parts into the skin,
with friction's memory from part to part as in `contact.solver.path_solver`. The rows of a batch go through the
alternating method side by side: one matrix product for all of them.

Source: [S2] III.A (data collection); method as in `contact.solver.admm`
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32, Indices
from ..errors import DermisError
from .poses import Poses
from .press_problem import Carrier, PressPoints, PressProblem
from .press_state import PressState

STEPS = 3
FINER = 4  # times as many for rows that the law has not settled for
BATCH = 128
AT_ONCE = 1024  # rows whose poses without load are looked for together
DEEP = 3.0  # times as much as where a row presses, how deep it does so counts for which rows are alike
REACH = 0.3  # of a row's depth: undeformed points farther off are left out, and looked at afterwards
MOST = 0.8  # of the points: where more come near it is not worth while to leave any out
PASSED = 1e-6  # [m] of penetration by which a point that was left out is touched
TOUCH_MARGIN = 0.02  # the path in contact begins this share of the whole before the first touch


@dataclass(frozen=True, eq=False)
class Pressed:
    """Rows after pressing.

    Attributes:
        force: on the skin at the pad nodes [N], shape (n, m, 3), float32.
        displacement: displacement of the pressed points [m], shape (n, points, 3), float32.
        poses: poses of the platform, in balance with its carrier.
        touching: shape (n,).
        residual: |f - P(f - w / rho)| / |f| of the contact, shape (n,).
        imbalance: force on the platform left over [N], shape (n,).
        left: residual of the law where it did not settle, over the forces' own energy; 0 where it did, and on linear
            skin, shape (n,).
        amounts: see `Stimulus.given`, of skin that follows a law, float32, shape (n, 3 m); None of linear skin.
    """

    force: Floats32
    displacement: Floats32
    poses: Poses
    touching: NDArray[np.bool_]
    residual: Array
    imbalance: Array
    left: Array
    amounts: Floats32 | None = None

    def take(self, rows: Indices) -> Pressed:
        """Return some rows."""
        own: dict[str, Any] = {name: value for name, value in vars(self).items() if value is not None}
        some: dict[str, Any] = {k: v.take(rows) if isinstance(v, Poses) else v[rows] for k, v in own.items()}
        return Pressed(**some)

    def set(self, rows: Indices, found: Pressed) -> None:
        """Set the results of some rows."""
        for name in ("force", "displacement", "touching", "residual", "imbalance", "left"):
            getattr(self, name)[rows] = getattr(found, name)
        if self.amounts is not None and found.amounts is not None:
            self.amounts[rows] = found.amounts
        self.poses.rotation[rows], self.poses.centre[rows] = found.poses.rotation, found.poses.centre


class Press:
    """Presses one skin with one platform.

    Args:
        points: points of the skin that are pressed.
        carrier: carries the platform.
        friction: Coulomb's coefficient.
        steps: parts of the path in contact.

    Raises:
        DermisError: a compliance that is not positive definite, or no step.
    """

    def __init__(self, points: PressPoints, carrier: Carrier, friction: float, *, steps: int = STEPS) -> None:
        if steps < 1:
            raise DermisError("too few steps", where="platform", value=steps, limit=">= 1")
        self.problem = PressProblem(points.compliance, points.positions, carrier, friction)
        self.points, self.carrier, self.steps = points, carrier, int(steps)

    def press(self, commands: Array, *, via: Array | None = None) -> Pressed:
        """Press rows from rest, in batches of rows that press alike: so a batch needs few points.

        Args:
            commands: shape (n, motors).
            via: commands that each row goes to first and then comes back from, shape (n, motors); None for straight.
        """
        n, whole = len(commands), self.problem
        force, moved = (np.zeros((n, m, 3), np.float32) for m in (self.points.node_count, whole.count))
        poses = self.carrier.rest_poses(n)
        amounts = None if self.points.law is None else np.zeros((n, 3 * self.points.node_count), np.float32)
        made = Pressed(force, moved, poses, np.zeros(n, bool), np.zeros(n), np.zeros(n), np.zeros(n), amounts)
        first = commands if via is None else via
        free, where = self.carrier.rest_poses(n), np.zeros((n, 3))
        for rows in np.split(np.arange(n), range(AT_ONCE, n, AT_ONCE)):
            there = self.carrier.carry(first[rows], free.take(rows))
            free.rotation[rows], free.centre[rows], where[rows] = there.rotation, there.centre, self._where(there)
        for rows in _alike(np.arange(n), where):
            made.set(rows, self._batch(commands[rows], None if via is None else via[rows], free.take(rows), self.steps))
        again = np.flatnonzero(made.left > 0.0)
        if len(again):  # a way of more parts may settle
            turned = None if via is None else via[again]
            finer = self._batch(commands[again], turned, free.take(again), FINER * self.steps)
            better = np.flatnonzero(finer.left < made.left[again])
            made.set(again[better], finer.take(better))
        return made

    def _where(self, free: Poses) -> Array:
        """Return where rows press, and how deep [m], shape (n, 3), by their poses without load."""
        gap = self.problem.gap(free)
        low = np.minimum(gap.min(axis=1), 0.0)
        near = gap + REACH * low[:, None] <= 0.0
        middle = near @ self.problem.positions[:, :2] / np.maximum(near.sum(axis=1), 1)[:, None]
        return np.column_stack([middle, DEEP * low])

    # -- a batch -----------------------------------------------------------------------------------------------------

    def _batch(self, commands: Array, via: Array | None, free: Poses, steps: int) -> Pressed:
        """Press on those points that rows come near; rows in which others would be touched are pressed on all.

        Args:
            free: where rows first go, without load. steps: parts of a way.
        """
        n, problem = len(commands), self.problem
        gap = np.full((n, problem.count), np.inf)
        for aim in (free,) if via is None else (free, self.carrier.carry(commands, self.carrier.rest_poses(n))):
            own = problem.gap(aim)
            gap = np.minimum(gap, own + REACH * np.minimum(own.min(axis=1, keepdims=True), 0.0))
        near = np.flatnonzero((gap <= max(float(gap.min()), 0.0)).any(axis=0))
        if len(near) > MOST * problem.count:
            return self._pressed(commands, via, free, problem, np.arange(problem.count), steps)
        found = self._pressed(commands, via, free, problem.part(near), near, steps)
        other = np.ones(problem.count, bool)
        other[near] = False
        apart = problem.gap(found.poses)
        moved = np.einsum("nmi,nij->nmj", found.displacement, found.poses.rotation)
        touched = ((apart + moved[:, :, 2])[:, other] < -PASSED).any(axis=1)
        if touched.any():
            rows = np.flatnonzero(touched)
            there = None if via is None else via[rows]
            every = np.arange(problem.count)
            found.set(rows, self._pressed(commands[rows], there, free.take(rows), problem, every, steps))
        return found

    def _pressed(
        self, commands: Array, via: Array | None, free: Poses, problem: PressProblem, near: Indices, steps: int
    ) -> Pressed:
        """Press rows on some of the points."""
        n, whole = len(commands), self.problem
        rest = np.broadcast_to(self.carrier.rest, commands.shape)
        start = self.carrier.rest_poses(n)
        legs = [commands] if via is None else [via, commands]
        before, after = problem.gap(start).min(axis=1), problem.gap(free).min(axis=1)
        share = np.where(after < 0.0, before / np.maximum(before - after, 1e-12), 1.0) - TOUCH_MARGIN
        share = np.clip(share, 0.0, 1.0)[:, None]
        touch = rest + share * (legs[0] - rest)
        part = (1.0 - share) * start.centre + share * free.centre
        state = PressState(problem, self.points, self.carrier.carry(touch, Poses(free.rotation, part)))
        path = [touch + (legs[0] - touch) * (k / steps) for k in range(1, steps + 1)]
        if via is not None:
            path += [via + (commands - via) * (k / steps) for k in range(1, steps + 1)]
        with np.errstate(over="ignore", invalid="ignore"):  # a row may have no balance; the others go on
            for k, command in enumerate(path):
                state.step(command, last=k == len(path) - 1)
        flat = np.zeros((n, 3 * whole.count), np.float32)
        flat[:, whole.columns(near)] = state.force
        force = np.ascontiguousarray(flat.reshape(n, 3, -1).transpose(0, 2, 1))
        image = state.force @ whole.compliance[whole.columns(near)]
        amounts = None
        if state.laws is not None:
            amounts = state.laws.amounts
            image -= state.laws.less_at(whole.own).astype(np.float32)
        moved = np.ascontiguousarray(image.reshape(n, 3, -1).transpose(0, 2, 1))
        touching = np.asarray(force.any(axis=(1, 2)))
        ends = state.residual, state.imbalance, state.left
        return Pressed(self._nodal(force), moved, state.poses, touching, *ends, amounts)

    def _nodal(self, force: Floats32) -> Floats32:
        nodal = self.points.nodal
        if nodal is None:
            return force
        return (force.reshape(len(force), -1) @ nodal.T.astype(np.float32)).reshape(len(force), -1, 3)


def _alike(rows: Indices, where: Array) -> list[Indices]:
    """Return batches of rows that are near each other: halves of halves across the axis along which they differ most.

    Args:
        rows: indices of the rows, shape (k,).
        where: coordinates of all rows, shape (n, 3).
    """
    if len(rows) <= BATCH:
        return [rows] if len(rows) else []
    axis = int(np.ptp(where[rows], axis=0).argmax())
    rows = rows[np.argsort(where[rows, axis], kind="stable")]
    half = -(-len(rows) // BATCH) // 2 * BATCH
    return _alike(rows[:half], where) + _alike(rows[half:], where)

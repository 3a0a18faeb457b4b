"""Press: contact of a platform with the skin, for many commands at once.

A platform is a rigid disc under the pad, in a frame parallel to the finger's, with its face along +Z. Its carrier has
rigid legs, or elastic cables and springs. The elasticity enters the contact problem as a compliance of rank six,
w = (C + J P J') f + b, so that platform and skin are in equilibrium together.

Each row is a path of its own: from rest to first contact, and then in `steps` equal parts into the skin. The friction
history is kept from part to part, as in `contact.solver.path_solver`. The rows of a batch are solved side by side by
the alternating method, with one matrix product for all of them.

Source: [S2] III.A (data collection); the alternating method is that of `contact.solver.balance`
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

STEPS = 3  # default number of parts of the path in contact
FINER = 4  # factor of the number of parts for rows in which the law did not converge
BATCH = 128  # number of rows of a batch
AT_ONCE = 1024  # number of rows whose poses without load are computed together
DEEP = 3.0  # weight of the depth relative to the position when similar rows are grouped
REACH = 0.3  # points whose gap exceeds this share of a row's depth are left out, and checked afterwards
MOST = 0.8  # if more than this share of the points comes near, none is left out
PASSED = 1e-6  # penetration above which a point that was left out counts as touched [m]
TOUCH_MARGIN = 0.02  # the path in contact begins this share of the movement before first contact


@dataclass(frozen=True, eq=False)
class Pressed:
    """Result of pressing a batch of rows.

    Attributes:
        force: forces on the pad nodes [N], float32, shape (n, m, 3).
        displacement: displacement of the pressed points [m], float32, shape (n, points, 3).
        poses: poses of the platform, in equilibrium with its carrier.
        touching: whether the platform touches the skin, shape (n,).
        residual: residual |f - P(f - w / rho)| / |f| of the contact, shape (n,).
        imbalance: unbalanced force on the platform [N], shape (n,).
        left: residual of the nonlinear law if it did not converge, see `Miss.left`, shape (n,); else 0.
        amounts: correction of nonlinear skin [m], see `Stimulus.given`, float32, shape (n, 3 m); None for linear skin.
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
        carrier: mechanism that carries the platform.
        friction: Coulomb coefficient.
        steps: number of parts of the path in contact.

    Raises:
        DermisError: the compliance is not positive definite, or there is no step.
    """

    def __init__(self, points: PressPoints, carrier: Carrier, friction: float, *, steps: int = STEPS) -> None:
        if steps < 1:
            raise DermisError("too few steps", where="platform", value=steps, limit=">= 1")
        self.problem = PressProblem(points.compliance, points.positions, carrier, friction)
        self.points, self.carrier, self.steps = points, carrier, int(steps)

    def press(self, commands: Array, *, via: Array | None = None) -> Pressed:
        """Press rows from rest.

        They are grouped into batches of similar rows, because each such batch needs few points.

        Args:
            commands: commands at the end of each row's path, shape (n, motors).
            via: commands through which each row's path leads, shape (n, motors); None for direct paths.
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
        if len(again):  # with more parts the law may converge
            turned = None if via is None else via[again]
            finer = self._batch(commands[again], turned, free.take(again), FINER * self.steps)
            better = np.flatnonzero(finer.left < made.left[again])
            made.set(again[better], finer.take(better))
        return made

    def _where(self, free: Poses) -> Array:
        """Return positions and weighted depths at which rows press [m], (n, 3).

        They are estimated from the poses without load.
        """
        gap = self.problem.gap(free)
        low = np.minimum(gap.min(axis=1), 0.0)
        near = gap + REACH * low[:, None] <= 0.0
        middle = near @ self.problem.positions[:, :2] / np.maximum(near.sum(axis=1), 1)[:, None]
        return np.column_stack([middle, DEEP * low])

    # -- a batch -----------------------------------------------------------------------------------------------------

    def _batch(self, commands: Array, via: Array | None, free: Poses, steps: int) -> Pressed:
        """Press a batch of rows on the points that come near.

        Rows in which other points would be touched are pressed again, on all points.

        Args:
            commands, via: as for `press`.
            free: poses without load at the end of the first part of the path.
            steps: number of parts of the path in contact.
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
        """Press rows on some of the points.

        Arguments are those of `_batch`, the contact problem of these points, and their indices `near`.
        """
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
        with np.errstate(over="ignore", invalid="ignore"):  # a row may have no equilibrium; the others continue
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
    """Return batches of similar rows.

    Rows are halved repeatedly, each time along the coordinate of largest extent.

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

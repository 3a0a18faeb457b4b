"""A batch of platforms on their way into the skin: poses, forces, and the points of the platform that nodes stick to.

The contact of all rows is iterated side by side by the alternating method of `contact.solver.admm`, in single
precision.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32
from .poses import Poses, inverted, limited
from .press_problem import PressPoints, PressProblem
from .row_laws import RowLaws

TOLERANCE = 2e-4  # of the iteration, relative to the forces of a row: below the last of 12 bits
MAX_ITERATIONS = 240
CHECK_EVERY = 4
LEAVE = 8  # where one in so many of the rows that are left has settled, those that have are taken out
RELAXATION = 1.8
LINEARISATIONS = 4
BALANCE = 2e-3  # [N] that may be left over on a platform that gives way
LOOKS = 8, 24  # at the law of skin that follows one, on the way and at the last commands


class PressState:
    """A batch between two steps: poses, forces, and the points of the platform that nodes stick to."""

    def __init__(self, problem: PressProblem, points: PressPoints, poses: Poses) -> None:
        self.problem, self.free, self.poses = problem, poses, poses
        n, m = len(poses), problem.count
        self.anchor = problem.local(poses)[0][:, :, :2]
        self.deflection = np.zeros((n, 6))
        self.force = np.zeros((n, 3 * m), np.float32)
        self.shift = np.zeros((n, 3 * m), np.float32)  # y of the method
        self.image = np.zeros((n, 3 * m), np.float32)
        self.sticking = np.zeros((n, m), bool)
        self.residual, self.left = np.zeros(n), np.zeros(n)
        self.imbalance, self.lost = np.zeros(n), np.zeros(n, bool)
        self.laws = None if points.law is None else RowLaws(points, problem.own, n)

    def step(self, commands: Array, *, last: bool) -> None:
        """Go to the next commands; at the last the platform's balance is linearised anew until it holds."""
        problem = self.problem
        self.free = problem.carrier.carry(commands, self.free)
        self.poses = self.free.moved(self.deflection)
        rounds = LINEARISATIONS if last else 1
        if self.laws is not None:
            self.laws.begin()
            rounds = LOOKS[last]
        unsettled = np.arange(len(self.poses))
        self.residual[:] = self.left[:] = 0.0
        for k in range(rounds):
            given = problem.carrier.give(commands, self.poses, first=k == 0)
            local, gap = problem.local(self.poses)
            offset = local.copy()
            offset[:, :, :2] -= self.anchor
            offset[:, :, 2] = gap
            offset = (offset @ self.poses.rotation.transpose(0, 2, 1)).transpose(0, 2, 1).reshape(len(gap), -1)
            if given is not None:
                ahead = np.einsum("nij,nj->ni", given[1], given[0])  # where the carrier would go without contact
                offset -= ahead @ problem.jacobian.T
            rows = np.flatnonzero((gap.min(axis=1) < 0.0) | self.force.any(axis=1))
            if given is None:  # rows that stay where they are and have settled need no more
                rows = np.intersect1d(rows, unsettled)
            if len(rows):
                self._solve(rows, offset, self.poses.rotation[:, :, 2], None if given is None else given[1])
            if given is not None and k < LINEARISATIONS and self.laws is not None:
                self.laws.look_anew()  # the platform gave way: it is another touch
            unsettled = self._looked(rows, k == rounds - 2)
            if given is None:
                if not len(unsettled):
                    break
                continue
            load = self._load()
            movement = limited(np.einsum("nij,nj->ni", given[1], given[0] + load))
            self.poses = self.poses.moved(movement)
            self.deflection += movement
            if last:
                after = problem.carrier.give(commands, self.poses, first=False)
                assert after is not None
                self.imbalance = np.linalg.norm((after[0] + load)[:, :3], axis=1)
                if self.imbalance.max(initial=0.0) <= BALANCE and not len(unsettled):
                    break
        if self.laws is not None:
            self.left[self.lost] = np.inf
        self._settle()

    def _looked(self, rows: NDArray[np.intp], ends: bool) -> NDArray[np.intp]:
        """Ask the law about rows; return those that it has not settled for.

        Args:
            ends: contact is solved once more, with the offsets of least residual.
        """
        if self.laws is None or not len(rows):
            return rows[:0]
        left = rows[~self.laws.look(rows, self.force[rows])]
        if ends:
            self.laws.take_best(left)
        self.left[rows] = self.laws.left(rows)
        return left

    def _load(self) -> Array:
        """Force and moment of the skin on the platform, shape (n, 6)."""
        return -(self.force.astype(np.float64) @ self.problem.jacobian)

    def _settle(self) -> None:
        """Nodes that stick keep their anchor, all others take it along."""
        local = self.problem.local(self.poses)[0]
        moved = self.image.reshape(len(local), 3, -1).transpose(0, 2, 1) @ self.poses.rotation
        now = local[:, :, :2] + moved[:, :, :2]
        self.anchor = np.where(self.sticking[:, :, None], self.anchor, now)

    def _solve(self, rows: NDArray[np.intp], offset: Array, normal: Array, gives: Array | None) -> None:
        """Iterate a batch's contact; rows leave as they settle."""
        problem, m = self.problem, self.problem.count
        rho = np.float32(problem.rho)
        self.sticking[:] = False
        core = None
        if gives is not None:
            core = gives[rows]
            core = (core @ inverted(np.eye(6) + problem.gram @ core)).astype(np.float32)  # Woodbury
        b = (offset[rows] if self.laws is None else offset[rows] - self.laws.less[rows]).astype(np.float32)
        n = normal[rows].astype(np.float32)
        z, y = self.force[rows].copy(), self.shift[rows].copy()
        active = np.arange(len(rows))
        residual = np.ones(len(rows))
        for iteration in range(1, MAX_ITERATIONS + 1):
            right = z - y
            right *= rho
            right -= b
            product = right @ problem.inverse
            f = product[:, : 3 * m]
            if core is not None:
                f = f - np.matmul(core, product[:, 3 * m :, None])[:, :, 0] @ problem.spread
            v: Floats32 = np.multiply(f, np.float32(RELAXATION))
            v += (1.0 - RELAXATION) * z
            v += y
            new, stick = _projected(v, n, problem.friction, m)
            check = iteration % CHECK_EVERY == 0 or iteration == MAX_ITERATIONS
            if check:
                size = np.maximum(np.einsum("ij,ij->i", new, new), 1e-16)
                d, e = f - new, z - new
                left = np.sqrt((np.einsum("ij,ij->i", d, d) + np.einsum("ij,ij->i", e, e)) / size)
            y = v - new
            z = new
            if check:
                done = ~(left > TOLERANCE)  # rows that have no balance leave too
                if iteration == MAX_ITERATIONS:
                    done[:] = True
                if done.all() or done.sum() * LEAVE >= len(done):
                    at = rows[active[done]]
                    self.force[at], self.shift[at], self.sticking[at] = z[done], y[done], stick[done]
                    residual[active[done]] = left[done]
                    keep = ~done
                    active, z, y, b, n = active[keep], z[keep], y[keep], b[keep], n[keep]
                    core = None if core is None else core[keep]
                    if not len(active):
                        break
        self.lost[rows] = lost = ~np.isfinite(residual)
        if lost.any():  # an offset far off drove them beyond numbers: they begin anew, from no force
            self.force[rows[lost]], self.shift[rows[lost]], self.sticking[rows[lost]] = 0.0, 0.0, False
            residual[lost] = 1.0
        self.residual[rows] = residual
        self.image[rows] = self.force[rows] @ problem.compliance
        if self.laws is not None:
            self.image[rows] -= self.laws.less[rows].astype(np.float32)


def _projected(v: Floats32, normal: Floats32, friction: float, m: int) -> tuple[Floats32, NDArray[np.bool_]]:
    """Return Coulomb's projection of a batch (n, 3 m, by component) and which nodes stick, (n, m)."""
    a, b, c = (normal[:, i : i + 1] for i in range(3))
    vx, vy, vz = v[:, :m], v[:, m : 2 * m], v[:, 2 * m :]
    push = a * vx + b * vy + c * vz
    out = np.empty_like(v)
    tx, ty, tz = out[:, :m], out[:, m : 2 * m], out[:, 2 * m :]
    np.subtract(vx, a * push, out=tx)
    np.subtract(vy, b * push, out=ty)
    np.subtract(vz, c * push, out=tz)
    np.maximum(push, 0.0, out=push)
    length = tx * tx
    length += ty * ty
    length += tz * tz
    np.sqrt(length, out=length)
    limit = np.float32(friction) * push
    stick = (length <= limit) & (push > 0.0)
    share = limit / np.maximum(length, np.float32(1e-30))
    np.minimum(share, np.float32(1.0), out=share)
    tx *= share
    ty *= share
    tz *= share
    tx += a * push
    ty += b * push
    tz += c * push
    return out, stick

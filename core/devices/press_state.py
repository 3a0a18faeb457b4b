"""PressState: state of a batch of platforms pressed into the skin.

The contact of all rows is solved side by side by an alternating method, in single precision.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32
from .poses import Poses, inverted, limited
from .press_problem import PressPoints, PressProblem
from .row_laws import RowLaws

TOLERANCE = 2e-4  # change per iteration at which a row has converged, relative to its forces; less than 1 / 2^12
MAX_ITERATIONS = 240
CHECK_EVERY = 4  # iterations from one test of convergence to the next
LEAVE = 8  # rows that have converged are removed if they are at least one in this many
RELAXATION = 1.8  # over-relaxation of the alternating method
LINEARISATIONS = 4  # largest number of linearisations of the equilibrium at the last commands
BALANCE = 2e-3  # largest unbalanced force on an elastic platform [N]
LOOKS = 8, 24  # largest numbers of evaluations of the nonlinear law, at intermediate and at the last commands


class PressState:
    """State of a batch of platforms: poses, forces and anchors of friction.

    Args:
        problem: contact problem of skin and platform.
        points: points of the skin.
        poses: poses of the platforms before contact.
    """

    def __init__(self, problem: PressProblem, points: PressPoints, poses: Poses) -> None:
        self.problem, self.free, self.poses = problem, poses, poses
        n, m = len(poses), problem.count
        self.anchor = problem.local(poses)[0][:, :, :2]
        self.deflection = np.zeros((n, 6))
        self.force = np.zeros((n, 3 * m), np.float32)
        self.shift = np.zeros((n, 3 * m), np.float32)  # dual variable y of the alternating method
        self.image = np.zeros((n, 3 * m), np.float32)
        self.sticking = np.zeros((n, m), bool)
        self.residual, self.left = np.zeros(n), np.zeros(n)
        self.imbalance, self.lost = np.zeros(n), np.zeros(n, bool)
        self.laws = None if points.law is None else RowLaws(points, problem.own, n)

    def step(self, commands: Array, *, last: bool) -> None:
        """Advance to the next commands.

        Args:
            commands: commands of the motors, shape (n, motors).
            last: whether they are the last ones. The equilibrium of an elastic platform is then iterated.
        """
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
                ahead = np.einsum("nij,nj->ni", given[1], given[0])  # movement of the platform without contact
                offset -= ahead @ problem.jacobian.T
            rows = np.flatnonzero((gap.min(axis=1) < 0.0) | self.force.any(axis=1))
            if given is None:  # on a rigid carrier, rows whose law has converged are done
                rows = np.intersect1d(rows, unsettled)
            if len(rows):
                self._solve(rows, offset, self.poses.rotation[:, :, 2], None if given is None else given[1])
            if given is not None and k < LINEARISATIONS and self.laws is not None:
                self.laws.look_anew()  # the platform has moved, so the contact is another one
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
        # The residual is relative to the forces, and means nothing where the platform has come off the skin.
        free = np.flatnonzero(~self.force.any(axis=1))
        off = problem.gap(self.poses.take(free)).min(axis=1, initial=np.inf) >= 0.0
        self.residual[free[off]] = 0.0
        self._settle()

    def _looked(self, rows: NDArray[np.intp], ends: bool) -> NDArray[np.intp]:
        """Evaluate the nonlinear law for rows; return those not converged.

        Args:
            rows: indices of the rows.
            ends: whether this is the last evaluation. Contact is then solved once more with the best corrections.
        """
        if self.laws is None or not len(rows):
            return rows[:0]
        left = rows[~self.laws.look(rows, self.force[rows])]
        if ends:
            self.laws.take_best(left)
        self.left[rows] = self.laws.left(rows)
        return left

    def _load(self) -> Array:
        """Return force [N] and moment [N m] of skin on platforms, shape (n, 6)."""
        return -(self.force.astype(np.float64) @ self.problem.jacobian)

    def _settle(self) -> None:
        """Move the anchors of all nodes that do not stick."""
        local = self.problem.local(self.poses)[0]
        moved = self.image.reshape(len(local), 3, -1).transpose(0, 2, 1) @ self.poses.rotation
        now = local[:, :, :2] + moved[:, :, :2]
        self.anchor = np.where(self.sticking[:, :, None], self.anchor, now)

    def _solve(self, rows: NDArray[np.intp], offset: Array, normal: Array, gives: Array | None) -> None:
        """Solve the contact of rows by the alternating method.

        Args:
            rows: indices of the rows, shape (k,).
            offset: relative displacement without forces [m], shape (n, 3 m).
            normal: normals of the platforms, shape (n, 3).
            gives: compliance of the carriers, shape (n, 6, 6); None if they are rigid.
        """
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
                f -= np.matmul(core, product[:, 3 * m :, None])[:, :, 0] @ problem.spread
            v: Floats32 = np.multiply(f, np.float32(RELAXATION))
            v += (1.0 - RELAXATION) * z
            v += y
            new, stick = _projected(v, n, problem.friction, m)
            check = iteration % CHECK_EVERY == 0 or iteration == MAX_ITERATIONS
            if check:
                size = np.maximum(np.einsum("ij,ij->i", new, new), 1e-16)
                d, e = f - new, z - new
                left = np.sqrt((np.einsum("ij,ij->i", d, d) + np.einsum("ij,ij->i", e, e)) / size)
            y = np.subtract(v, new, out=v)
            z = new
            if check:
                done = ~(left > TOLERANCE)  # also true for rows that diverged
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
        if lost.any():  # rows that diverged, by a wrong correction, start again without force
            self.force[rows[lost]], self.shift[rows[lost]], self.sticking[rows[lost]] = 0.0, 0.0, False
            residual[lost] = 1.0
        self.residual[rows] = residual
        self.image[rows] = self.force[rows] @ problem.compliance
        if self.laws is not None:
            self.image[rows] -= self.laws.less[rows].astype(np.float32)


def _projected(v: Floats32, normal: Floats32, friction: float, m: int) -> tuple[Floats32, NDArray[np.bool_]]:
    """Return Coulomb's projection of forces, and which nodes stick.

    Forces that pull become zero. Tangential forces above the friction limit are shortened to it.

    Args:
        v: forces in the order by component, shape (n, 3 m).
        normal: normals of the platforms, shape (n, 3).
        friction: Coulomb coefficient.
        m: number of nodes.

    Returns:
        Projected forces, shape (n, 3 m), and whether each node sticks, shape (n, m).
    """
    n, v = normal[:, :, None], v.reshape(len(v), 3, m)
    work = n * v
    push = work[:, 0] + work[:, 1]
    push += work[:, 2]
    out = v - np.multiply(n, push[:, None], out=work)
    np.maximum(push, 0.0, out=push)
    np.multiply(out, out, out=work)
    length = work[:, 0] + work[:, 1]
    length += work[:, 2]
    np.sqrt(length, out=length)
    limit = np.float32(friction) * push
    stick = (length <= limit) & (push > 0.0)
    np.maximum(length, np.float32(1e-30), out=length)
    share = np.divide(limit, length, out=limit)
    np.minimum(share, np.float32(1.0), out=share)
    out *= share[:, None]
    out += np.multiply(n, push[:, None], out=work)
    return out.reshape(len(v), 3 * m), stick

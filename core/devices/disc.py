"""Contact of a rigid disc with the skin: forces and their derivatives.

The disc's material moves with the disc, so sticking skin is sheared when the disc tilts, shifts or turns. The history
of friction is a `FrictionState`, which has an anchor on the disc for every point of the skin. The state is held
constant while poses are tried, and updated by `DiscContact.settle` for the chosen pose (staggering). The gap at the
rounded rim is computed at the position of the deformed skin, as in `contact.solver.history`. A sticking point is at its
anchor. Any other point is at its position after the last step.

Contact at a pose is solved on the condensed compliance by a semi-smooth Newton method, which is compiled
(`core/kernels/disc.c`). All points of a rigid flat disc
have the same normal, and Coulomb's projection is homogeneous of degree one, so the Newton system reduces to A f = -D b
with A = (I - D) / r + D C. Here f are the forces, C is the compliance, and b is the relative displacement without
forces. D is the derivative of the projection, and r is the weight of displacements against forces in the projection.
The LU factors of A also give the exact derivative df by implicit differentiation. In a frame that turns with the disc,
Coulomb's law does not change. The derivative is therefore df = Omega f + h. The part Omega f turns the forces with the
disc, and h obeys A h = -D (C Omega f - Omega C f + db'), where db' is the change of b in the disc's frame.

The displacement of neo-Hookean skin is that of linear skin minus a correction c. While poses are tried, c is constant
and is subtracted from b. `DiscContact.solve` solves contact at one pose by the law itself (`DiscLaw`).

Source: [S0] 3.1 (rigid disc on the skin), 3.4 and 5.1 (friction state); Alart and Curnier 1991.
"""

from __future__ import annotations

import ctypes
from ctypes import byref
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..contact.solver.cone import along
from ..contact.solver.law_skin import LawState
from ..contact.solver.sweeps import MOST_SWEEPS, Swept, sweep
from ..errors import DermisError
from ..kernels import records
from ..kernels.library import kernels
from ..kernels.records import address
from .disc_law import DiscLaw
from .disc_pose import FALLBACK_TOLERANCE, TOLERANCE, Disc, DiscPose, DiscSolution, FrictionState
from .press_problem import PressPoints

MAX_STEPS = 10  # largest number of Newton steps at one pose
MAX_ROUNDS = 24  # largest number of alternations between contact and the nonlinear law at one pose
# The candidates for contact are the points with gaps below NEAR [m]. They are chosen again as soon as the gap of
# another point is below MARGIN [m].
NEAR, MARGIN = 0.9e-3, 0.3e-3
_AT, _POSE = (records.place_of(records.SearchRecord, name) for name in ("at", "pose"))


class DiscContact:
    """Contact of one skin with a disc, solved for one pose after another.

    Args:
        points: points of the skin that carry forces: points of the smooth skin, or the nodes of its mesh.
        disc: surface of the disc.
        friction: Coulomb's coefficient of friction.

    Attributes:
        law: nonlinear law of the skin; None for linear skin.
    """

    def __init__(self, points: PressPoints, disc: Disc, friction: float) -> None:
        self.points, self.disc, self.friction = points, disc, float(friction)
        self.count = len(points.positions)
        self.compliance, self.positions = (
            np.ascontiguousarray(given, np.float64) for given in (points.compliance, points.positions)
        )
        self.law = None if points.law is None else DiscLaw(points.law, points.modulus, points.nodal)
        self._less: Array | None = None  # the correction c at the points, constant while poses are tried
        self.near: NDArray[np.intp] = np.zeros(0, np.intp)
        self._places, self._gap = self.positions.copy(), np.empty(self.count)
        self._all = np.ones(self.count, bool)
        self._built: Array | None = None
        # Forces to start from, with their derivative if there is one, and the configuration to which they belong.
        self._told: tuple[Array, Array | None] = (np.zeros((0, 3, 1)), None)
        self._record = records.DiscRecord(
            points=self.count,
            positions=address(self.positions),
            places=address(self._places),
            radius=disc.radius,
            rounding=disc.rounding,
            friction=self.friction,
            weight=1.0 / float(np.median(np.diag(self.compliance))),  # the stiffness of a point of median compliance
            margin=MARGIN,
            gap=address(self._gap),
        )
        self._settled = records.SettledRecord(
            points=self.count, positions=address(self.positions), compliance=address(self.compliance)
        )
        self.hold(FrictionState.rest(self.count))

    def hold(self, state: FrictionState) -> None:
        """Set the friction state for the following poses.

        The candidates are taken from the last contact of this state. Results therefore do not depend on poses that were
        solved before, not even by rounding.
        """
        self.state = state
        np.add(self.positions, state.moved, out=self._places)
        # The record holds addresses only, so the arrays are held here.
        self._held = tuple(map(np.ascontiguousarray, (state.anchor, state.anchored, state.sticking)))
        record = self._record
        record.anchors, record.anchored, record.sticking = map(address, self._held)
        near = np.zeros(0, np.intp) if state.last is None else state.last.near
        if self.law is not None:
            self.law.begin(state.law)
            self._less = self.law.less
        self._take(near)

    def go_on(self, state: LawState | None) -> None:
        """Go back to a state of the nonlinear law; None for rest.

        This is necessary after solutions without convergence.
        """
        assert self.law is not None
        self.law.go_on(state)
        self._less = self.law.less

    def gap(self, pose: DiscPose) -> Array:
        """Return the gap of every undeformed point [m], shape (m,)."""
        local = (self.positions - pose.centre) @ pose.rotation
        return self._fallen(local[:, :2]) - local[:, 2]

    def _fallen(self, across: Array) -> Array:
        """Return the depth of the rounded rim below the face [m], shape (m,).

        Args:
            across: positions in the disc's plane [m], shape (m, 2).
        """
        over = np.maximum(np.sqrt(across[:, 0] ** 2 + across[:, 1] ** 2) - self.disc.radius, 0.0)
        return over * over * (0.5 / self.disc.rounding)

    def solve(self, pose: DiscPose, known: DiscSolution | None = None) -> DiscSolution:
        """Solve contact at a pose.

        The friction state is that of `hold`. On nonlinear skin, the solution of contact and the evaluation of the law
        alternate until the law converges.

        Args:
            pose: pose of the disc.
            known: result of `tried` for this pose. It replaces the first solution if the correction has not changed
                since.
        """
        law = self.law
        if law is None:
            return self.tried(pose)
        law.look_anew()
        for again in range(MAX_ROUNDS):
            first = again == 0 and known is not None and known.less is self._less
            found = known if first and known is not None else self.tried(pose)
            lost = law.look(self.nodal(found))
            if law.settled:
                break
            if not lost and again == MAX_ROUNDS - 1:
                law.take_best()
                lost = True
            self._less = law.less
            if lost:  # no step lowers the residual: this is the solution for the best correction
                found = self.tried(pose)
                break
        return replace(found, amounts=law.amounts, law=law.save(), less=self._less)

    def tried(self, pose: DiscPose) -> DiscSolution:
        """Solve contact at a pose with a constant correction c.

        On linear skin there is no correction, and the result is exact.
        """
        record = self._pressed(pose, *self._told)
        if record.strays or not len(self.near):  # another point has come close: choose the candidates again
            self._take(np.flatnonzero(self._gap < NEAR))
            record = self._pressed(pose, *self._told)
        answer, w, status = self._out
        method, residual, steps = "newton", float(record.residual), int(record.steps)
        if not record.touching:
            return DiscSolution(pose, self.near, answer, w, status, 0.0, 0, "none")
        if residual > TOLERANCE:
            method = "fallback"
            other = self._solved_otherwise(pose, answer[:, :, 0])
            record = self._pressed(pose, other.force[:, :, None], None, steps=1)
            answer, w, status = self._out
            steps += other.sweeps + int(record.steps)
            residual = float(record.residual)
            if residual > other.residual:
                answer[:, :, 0], w, status, residual = other.force, other.displacement, other.status, other.residual
        self._told = answer, pose.x
        return DiscSolution(pose, self.near, answer, w, status, residual, steps, method, less=self._less)

    def _pressed(self, pose: DiscPose, told: Array, at: Array | None, steps: int = MAX_STEPS) -> records.DiscRecord:
        """Press the disc on the candidates at a pose by Newton's method.

        The results are in the record, in `_out` (forces with their derivative, displacements w and status of the
        candidates) and in `_offset`.

        Args:
            pose: pose of the disc.
            told: forces to start from [N], each followed by its derivative unless `at` is None, shape (s, 3, 1 + n).
            at: configuration to which `told` belongs, shape (n,).
            steps: largest number of Newton steps.

        Raises:
            DermisError: a number is not finite.
        """
        record = self._armed(len(pose.spin), pose.turning, told, at, steps)
        self._out = out = _results(len(self.near), len(pose.spin))
        record.answer, record.moved, record.status = (address(array) for array in out)
        ahead = pose.x if at is None else pose.x - at
        parts = pose.rotation.ravel(), pose.centre, pose.spin.ravel(), pose.shift.ravel(), ahead
        placed = np.concatenate(parts)
        record.pose = address(placed)
        _done(kernels().press_disc(byref(record)), record)
        return record

    def _armed(self, n: int, turning: int, told: Array, at: Array | None, steps: int) -> records.DiscRecord:
        """Return the record, complete but for a pose and arrays for the results.

        Args:
            n: number of values in a configuration.
            turning: see `DiscPose.turning`.
            told, at, steps: as for `_pressed`.
        """
        record, size = self._record, len(self.near)
        if record.count != size or record.freedoms != n:
            self._room = np.empty((60 + 3 * n + 18 * size) * size), np.empty(8 * size, np.int64)
            self._offset, self._trial = np.empty((size, 3)), _results(size, n)
            record.count, record.freedoms, record.turning = size, n, turning
            record.room, record.indices = address(self._room[0]), address(self._room[1])
            record.offset = address(self._offset)
        told = np.ascontiguousarray(told)
        record.told, record.leading = address(told), 0 if at is None else n
        if self._built is None:
            record.compliance = address(self._matrix)
        less = None if self._less is None else np.ascontiguousarray(self._less, np.float64)
        record.less = None if less is None else address(less)
        record.tolerance, record.most = TOLERANCE, steps
        self._given = told, less  # the record holds addresses only
        return record

    def lend(self, search: records.SearchRecord) -> None:
        """Give this contact to a search of the kernels, with arrays for the contact at its result.

        The search continues from the last pose that was solved.
        """
        told, at = self._told
        record = self._armed(3, 2, told, at, MAX_STEPS)
        record.answer, record.moved, record.status = (address(array) for array in self._trial)
        search.disc, search.held, search.own = ctypes.addressof(record), 0, 0
        search.at[:] = (0.0, 0.0, 0.0) if at is None else at.tolist()
        self._lent = _results(len(self.near), 3)
        search.answer, search.moved, search.status = (address(array) for array in self._lent)

    def taken(self, search: records.SearchRecord, numbers: Array) -> DiscSolution | None:
        """Return the contact at the result of a search to which `lend` gave this contact.

        Args:
            search: the search.
            numbers: its numbers, see `records.place_of`.

        Returns:
            The contact; None if the search did not solve it.
        """
        if not search.held:
            return None
        answer, moved, status = self._lent
        at, pose = numbers[_AT], numbers[_POSE]
        self._told = answer, at
        if not search.own:
            return None
        turn, spin, shift = pose[:9].reshape(3, 3), pose[12:21].reshape(3, 3), pose[21:30].reshape(3, 3)
        placed, record = DiscPose(turn, pose[9:12], spin, shift, at), self._record
        how = record.residual, record.steps, "newton"
        return DiscSolution(placed, self.near, answer, moved, status, *how, less=self._less)

    def _solved_otherwise(self, pose: DiscPose, start: Array) -> Swept:
        """Solve contact by Gauss-Seidel sweeps.

        They are slower than Newton's method but more robust.

        Args:
            pose: pose of the disc.
            start: forces to start from [N], shape (s, 3).
        """
        b = self._offset if self._less is None else self._offset - self._less[self.near]
        normals = np.tile(pose.normal, (len(b), 1))
        friction, rigid = np.full(len(b), self.friction), np.zeros(len(b))
        if not (along(b, normals) < 0.0).any():
            start = np.zeros_like(start)  # no forces are needed
        return sweep(self._matrix, b, normals, friction, rigid, start, FALLBACK_TOLERANCE, MOST_SWEEPS)

    def nodal(self, solution: DiscSolution) -> Array:
        """Return the forces on the nodes of the skin's mesh [N], shape (m, 3)."""
        return self.nodal_forces([solution])[0]

    def nodal_forces(self, solutions: list[DiscSolution]) -> Array:
        """Return the forces of contacts on the nodes of the skin's mesh [N], shape (n, m, 3)."""
        forces, nodal = np.zeros((len(solutions), self.count, 3)), self.points.nodal
        for force, solution in zip(forces, solutions, strict=True):
            force[solution.near] = solution.force
        if nodal is None:
            return forces
        loaded = np.flatnonzero(forces.any(axis=(0, 2)))  # few points carry forces, and each acts on a few nodes
        made = forces[:, loaded].reshape(len(forces), -1) @ nodal[:, _degrees(loaded)].T
        return np.asarray(made.reshape(len(forces), -1, 3))

    def settle(self, solution: DiscSolution) -> FrictionState:
        """Return the friction state after a step that ended with a solution.

        A sticking point keeps its anchor. A slipping or open point gets a new anchor at its own position.

        Raises:
            DermisError: a number is not finite.
        """
        pose, answer, record = solution.pose, solution.answer, self._settled
        out = (
            np.empty((self.count, 3)),
            np.empty((self.count, 3)),
            np.empty((self.count, 2)),
            np.empty(self.count, bool),
        )
        record.moved, record.force, record.anchor, record.sticks = (address(array) for array in out)
        placed = np.concatenate([pose.rotation.ravel(), pose.centre])
        record.anchors, record.anchored = self._record.anchors, self._record.anchored
        less = None if solution.less is None else np.ascontiguousarray(solution.less, np.float64)
        record.less = None if less is None else address(less)
        record.pose, record.count, record.width = address(placed), len(answer), answer.shape[2]
        record.near, record.answer, record.status = address(solution.near), address(answer), address(solution.status)
        _done(kernels().settle_disc(byref(record)), record)
        moved, force, anchor, sticking = out
        return FrictionState(self._all, anchor, force, sticking, moved, solution, solution.law)

    # -- parts -------------------------------------------------------------------------------------------------------

    def _take(self, near: NDArray[np.intp]) -> None:
        """Set the candidates and their part of the friction state.

        Args:
            near: indices of the candidates, shape (s,).
        """
        if near is not self.near and not np.array_equal(near, self.near):
            self._built = None
        self.near = near = np.ascontiguousarray(near)
        self._record.near = address(near)
        last = self.state.last
        if last is None:
            self._told = self.state.force[near][:, :, None], None
            return
        answer = last.answer
        if last.near is not near:
            whole = np.zeros((self.count, *answer.shape[1:]))
            whole[last.near] = answer
            answer = whole[near]
        self._told = answer, last.pose.x

    @property
    def _matrix(self) -> Array:
        """Compliance between the candidates [m/N], shape (3 s, 3 s).

        It is built at its first use after a choice of candidates.
        """
        if self._built is None:
            rows = _degrees(self.near)
            self._built = np.ascontiguousarray(self.compliance[np.ix_(rows, rows)])
        return self._built


def _results(size: int, n: int) -> tuple[Array, Array, NDArray[np.int8]]:
    """Return arrays for forces with their derivative, displacements, and status of `size` candidates."""
    return np.empty((size, 3, 1 + n)), np.empty((size, 3)), np.empty(size, np.int8)


def _done(status: int, record: records.DiscRecord | records.SettledRecord) -> None:
    """Raise an error if the kernels refused a point."""
    if status == records.NOT_FINITE:
        raise DermisError("a number in the contact with the disc is not finite", where=f"point {record.wrong}")


def _degrees(points: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the indices of the x, y and z components of points, shape (3 k,)."""
    out: NDArray[np.intp] = (3 * points[:, None] + np.arange(3)).ravel()
    return out

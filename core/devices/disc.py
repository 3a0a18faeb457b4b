"""Contact of a rigid disc with the skin: forces and their derivatives.

The disc's material moves with the disc, so sticking skin is sheared when the disc tilts, shifts or turns. The history
of friction is a `FrictionState`, which has an anchor on the disc for every point of the skin. The state is held
constant while poses are tried, and updated by `DiscContact.settle` for the chosen pose (staggering). The gap at the
rounded rim is computed at the position of the deformed skin, as in `contact.solver.history`. A sticking point is at its
anchor. Any other point is at its position after the last step.

Contact at a pose is solved on the condensed compliance by a semi-smooth Newton method. All points of a rigid flat disc
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

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..contact.solver.cone import OPEN, SLIP, STICK
from ..contact.solver.law_skin import LawState
from ..contact.solver.solve import Solution
from ..contact.solver.solve import solve as solve_contact
from .disc_law import DiscLaw
from .disc_pose import FALLBACK_TOLERANCE, TOLERANCE, Disc, DiscPose, DiscSolution, FrictionState
from .poses import crossing
from .press_problem import PressPoints

MAX_STEPS = 10  # largest number of Newton steps at one pose
MAX_ROUNDS = 24  # largest number of alternations between contact and the nonlinear law at one pose
_UNIT, _NO_LAW = np.eye(3), np.zeros((0, 3, 3))  # `_NO_LAW`: `_Factors.law` if no point slips
_STICKS, _SLIPS = np.int8(STICK), np.int8(SLIP)
# The candidates for contact are the points with gaps below NEAR [m]. They are chosen again as soon as the gap of
# another point is below MARGIN [m].
NEAR, MARGIN = 0.9e-3, 0.3e-3


@dataclass(frozen=True, eq=False)
class _Factors:
    """Factors of a Newton step, for the derivative of the forces.

    Attributes:
        lower, pivots: LU factors of A, as LAPACK returns them.
        active: indices of the touching points among the candidates, shape (a,).
        slips: indices of the slipping points among the active ones, shape (k,).
        law: D at the slipping points, shape (k, 3, 3).
    """

    lower: Array
    pivots: NDArray[np.int32]
    active: NDArray[np.intp]
    slips: NDArray[np.intp]
    law: Array


@dataclass(frozen=True, eq=False)
class _Block:
    """Compliance between touching points, and its LU factors.

    Attributes:
        key: indices of the points, as bytes.
        matrix: compliance [m/N], shape (3 a, 3 a).
        lower, pivots: LU factors, as LAPACK returns them.
        sound: whether the factorisation succeeded.
    """

    key: bytes
    matrix: Array
    lower: Array
    pivots: NDArray[np.int32]
    sound: bool


@dataclass(frozen=True, eq=False)
class _Seen:
    """Positions of all points in the disc's frame at a pose.

    Attributes:
        local: positions of the undeformed points [m], shape (m, 3).
        across: positions of the deformed points in the disc's plane, for the gap at the rim [m], shape (m, 2).
        reach: distance of the positions `across` from the disc's axis [m], shape (m,).
        gap: gap of the undeformed points, with the rim at `across` [m], shape (m,).
    """

    local: Array
    across: Array
    reach: Array
    gap: Array


class DiscContact:
    """Contact of one skin with a disc, solved for one pose after another.

    Args:
        points: points of the skin that carry forces: points of the smooth skin, or the nodes of its mesh.
        disc: surface of the disc.
        friction: Coulomb's coefficient of friction.

    Attributes:
        solved: number of poses that were solved.
        fallbacks: number of poses for which Newton's method did not converge.
        law: nonlinear law of the skin; None for linear skin.
    """

    def __init__(self, points: PressPoints, disc: Disc, friction: float) -> None:
        self.points, self.disc, self.friction = points, disc, float(friction)
        self.compliance, self.positions, self.count = points.compliance, points.positions, len(points.positions)
        self.law = None if points.law is None else DiscLaw(points.law, points.modulus, points.nodal)
        self._less: Array | None = None  # the correction c at the points, constant while poses are tried
        # Weight of displacement against force in the projection: the stiffness of a point of median compliance.
        self._stiffness = 1.0 / float(np.median(np.diag(self.compliance)))
        self.near: NDArray[np.intp] = np.zeros(0, np.intp)
        self._built: Array | None = None
        self._rest_positions = np.zeros((0, 3))
        self._block: _Block | None = None
        self._guess: tuple[Array, Array, Array] | None = None  # a configuration, its forces and their derivative
        # The undeformed positions of all points, then their positions after the last step.
        self._all = np.concatenate([self.positions, self.positions])
        # Homogeneous coordinates of the candidates: undeformed, and after the last step.
        self._rest4, self._places4 = np.ones((0, 4)), np.ones((0, 4))
        self.choice = 0  # number of choices of candidates; while it stays the same, tables for the candidates are valid
        self.solved = self.fallbacks = 0
        from scipy.linalg.lapack import dgetrf, dgetrs

        self._factorise, self._back = dgetrf, dgetrs
        self.hold(FrictionState.rest(self.count))

    def hold(self, state: FrictionState) -> None:
        """Set the friction state for the following poses.

        The candidates are taken from the last contact of this state. Results therefore do not depend on poses that were
        solved before, not even by rounding.
        """
        self.state = state
        np.add(self.positions, state.moved, out=self._all[self.count :])
        self._stuck = state.sticking.nonzero()[0]
        self._stuck_at = state.anchor[self._stuck]
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
        seen = self._seen(pose)
        self._choose(seen)
        self.solved += 1
        offset, change = self._offsets(pose, seen)
        if not (seen.gap[self.near] < 0.0).any():
            zero = np.zeros_like(offset)
            nothing = np.zeros(len(offset), np.int8)
            return DiscSolution(pose, self.near, zero, offset, np.zeros_like(change), nothing, 0.0, 0, "none")
        guess = self._held_force
        if self._guess is not None:
            # The forces are extrapolated to first order, so that the guess nearly always has the right status.
            at, guess, slope = self._guess
            guess = guess + slope @ (pose.x - at)
        force, w, slope, status, residual, steps = self._newton(pose, offset, change, guess)
        method = "newton"
        if residual > TOLERANCE:
            self.fallbacks += 1
            method = "fallback"
            other = self._solved_otherwise(pose, offset, force)
            force, w, slope, status, residual, more = self._newton(pose, offset, change, other.force, steps=1)
            if residual > other.residual:
                force, w, status, residual = other.force, other.displacement, other.status, other.residual
            steps += other.iterations + more
        self._guess = (pose.x, force, slope)
        return DiscSolution(pose, self.near, force, w, slope, status, residual, steps, method, less=self._less)

    def _solved_otherwise(self, pose: DiscPose, offset: Array, start: Array) -> Solution:
        """Solve contact by Gauss-Seidel sweeps.

        They are slower than Newton's method but more robust.

        Args:
            pose: pose of the disc.
            offset: offset b of the candidates [m], shape (s, 3).
            start: forces to start from [N], shape (s, 3).
        """
        b = offset if self._less is None else offset - self._less[self.near]
        normals = np.tile(pose.normal, (len(offset), 1))
        return solve_contact(
            self._matrix, b.ravel(), self.friction, normals=normals, start=start, tolerance=FALLBACK_TOLERANCE
        )

    def nodal(self, solution: DiscSolution) -> Array:
        """Return the forces on the nodes of the skin's mesh [N], shape (m, 3)."""
        spread = self.points.nodal
        if spread is None:
            return solution.spread(self.count)
        loaded = np.flatnonzero(solution.status != OPEN)
        columns = _degrees(solution.near[loaded])
        return (spread[:, columns] @ solution.force[loaded].ravel()).reshape(-1, 3)

    def settle(self, solution: DiscSolution) -> FrictionState:
        """Return the friction state after a step that ended with a solution.

        A sticking point keeps its anchor. A slipping or open point gets a new anchor at its own position.
        """
        pose = solution.pose
        local = (self.positions - pose.centre) @ pose.rotation
        anchor = local[:, :2].copy()
        force = solution.spread(self.count)
        moved = np.zeros((self.count, 3))
        loaded = np.flatnonzero(solution.status != OPEN)
        if len(loaded):
            rows = _degrees(solution.near[loaded])
            moved = (self.compliance[rows].T @ solution.force[loaded].ravel()).reshape(-1, 3)
            if solution.less is not None:
                moved -= solution.less
            anchor += (moved @ pose.rotation)[:, :2]
        kept = solution.near[(solution.status == STICK) & self.state.anchored[solution.near]]
        anchor[kept] = self.state.anchor[kept]
        sticking = np.zeros(self.count, bool)
        sticking[solution.near[solution.status == STICK]] = True
        return FrictionState(np.ones(self.count, bool), anchor, force, sticking, moved, solution, solution.law)

    # -- parts -------------------------------------------------------------------------------------------------------

    def _newton(
        self, pose: DiscPose, offset: Array, change: Array, guess: Array, steps: int = MAX_STEPS
    ) -> tuple[Array, Array, Array, NDArray[np.int8], float, int]:
        """Solve by Newton's method.

        Args:
            pose: pose of the disc.
            offset, change: offset b of the candidates and its derivative, see `_offsets`.
            guess: forces to start from [N], shape (s, 3).
            steps: largest number of steps.

        Returns:
            Forces [N], shape (s, 3), displacements w [m], shape (s, 3), derivative of the forces, shape (s, 3, n),
            status, shape (s,), residual, and number of steps.
        """
        normal, r, mu, size = pose.normal, self._stiffness, self.friction, len(offset)
        untouched = offset
        if self._less is not None:
            offset = offset - self._less[self.near]
        force, step = guess, 0
        best = (np.inf, force, offset, np.zeros(size, np.int8))
        factors: _Factors | None = None
        best_factors: _Factors | None = None
        while True:
            w = (self._matrix @ force.ravel()).reshape(size, 3) + offset
            v = force - r * w
            vn = v @ normal
            tangent = v - vn[:, None] * normal
            length = np.sqrt(np.einsum("ij,ij->i", tangent, tangent))
            np.maximum(length, 1e-300, out=length)
            pushed = np.maximum(vn, 0.0)
            share = np.minimum(mu * pushed / length, 1.0)
            if step:  # the guess itself is not a result
                wanted = tangent * share[:, None] + pushed[:, None] * normal
                miss = (wanted - force).ravel()
                weight = max(float(np.vdot(wanted, wanted)), float(np.vdot(force, force)))
                residual = math.sqrt(float(miss @ miss) / weight) if weight > 0.0 else 0.0
                if residual < best[0]:
                    status = np.where(share < 1.0, _SLIPS, _STICKS)
                    status[vn <= 0.0] = OPEN
                    best, best_factors = (residual, force, w, status), factors
                if step == steps or residual <= TOLERANCE:
                    break
            step += 1
            active = (vn > 0.0).nonzero()[0]
            force, factors = np.zeros((size, 3)), None
            if len(active) == 0:
                continue
            right = offset[active]
            block = self._active_block(active)
            lower, pivots, sound = block.lower, block.pivots, block.sound
            slips, law = (share[active] < 1.0).nonzero()[0], _NO_LAW
            if len(slips):
                at = active[slips]
                law = _projection_slope(normal, tangent[at] / length[at, None], mu, share[at])
                matrix = block.matrix.reshape(len(active), 3, -1).copy()
                matrix[slips] = law @ matrix[slips]
                matrix.reshape(len(active), 3, len(active), 3)[slips, :, slips] += (_UNIT - law) / r
                right[slips] = (law @ right[slips, :, None])[:, :, 0]
                # The transpose is in Fortran order, which avoids a copy.
                lower, pivots, info = self._factorise(matrix.reshape(3 * len(active), -1).T, overwrite_a=True)
                sound = info == 0
            if not sound:
                break
            factors = _Factors(lower, pivots, active, slips, law)
            answer, _ = self._back(lower, pivots, -right.ravel(), trans=1)
            force[active] = answer.reshape(-1, 3)
        residual, force, w, status = best
        slope = self._slope(pose, best_factors, force, w - untouched, change)
        return force, w, slope, status, residual, step

    def _slope(self, pose: DiscPose, factors: _Factors | None, force: Array, moved: Array, change: Array) -> Array:
        """Return the derivative of the forces, shape (s, 3, n).

        The derivative is with respect to the configuration.

        Args:
            pose: pose of the disc.
            factors: factors of the last Newton step; None if nothing touches.
            force: forces [N], shape (s, 3).
            moved: displacement by the forces [m], shape (s, 3).
            change: derivative of the offset, shape (s, 3, n).
        """
        slope = np.zeros_like(change)
        if factors is None:
            return slope
        active, count, slips = factors.active, pose.turning, factors.slips
        turn = crossing(pose.spin[:count]).reshape(-1, 3).T
        right = change[active]
        right[:, :, :count] -= (moved[active] @ turn).reshape(-1, count, 3).transpose(0, 2, 1)
        turned = None
        if len(slips):  # if no point slips, these terms cancel
            turned = (force[active] @ turn).reshape(-1, count, 3).transpose(0, 2, 1)  # Omega f
            block = self._active_block(active).matrix
            right[:, :, :count] += (block @ turned.reshape(-1, count)).reshape(-1, 3, count)
            right[slips] = factors.law @ right[slips]
        answer, _ = self._back(factors.lower, factors.pivots, -right.reshape(-1, right.shape[2]), trans=1)
        slope[active] = answer.reshape(right.shape)
        if turned is not None:
            slope[active, :, :count] += turned
        return slope

    def _seen(self, pose: DiscPose) -> _Seen:
        """Return the positions of all points in the disc's frame.

        For the gap at the rim, a sticking point is at its anchor.
        """
        both = (self._all - pose.centre) @ pose.rotation
        local, across = both[: self.count], both[self.count :, :2]
        across[self._stuck] = self._stuck_at
        square = across * across
        reach = np.sqrt(square[:, 0] + square[:, 1])
        over = np.maximum(reach - self.disc.radius, 0.0)
        return _Seen(local, across, reach, over * over * (0.5 / self.disc.rounding) - local[:, 2])

    def _offsets(self, pose: DiscPose, seen: _Seen) -> tuple[Array, Array]:
        """Return the offset b of the candidates and its derivative.

        Returns:
            Relative displacement without force [m], shape (s, 3), and its derivative with respect to the configuration,
            without the part that turns b with the disc, shape (s, 3, n).
        """
        turn, near, n = pose.rotation, self.near, len(pose.spin)
        out = seen.local.take(near, axis=0)
        out[:, :2] -= self._anchor
        out[:, 2] = -seen.gap[near]
        motion = -pose.motion().transpose(2, 1, 0).reshape(4, 3 * n)
        move = (self._rest4 @ motion).reshape(-1, 3, n)
        if not self._all_anchored:  # a point without an anchor has no tangential displacement relative to the disc
            loose = ~self._anchored
            out[loose, :2] = 0.0
            move[loose] = turn[:, 2:] * (turn[:, 2] @ move[loose])[:, None]
        slides = ((seen.reach[near] > self.disc.radius) & ~self._sticking).nonzero()[0]
        if len(slides):  # points beyond the flat face, whose gap changes along the rounded rim
            reach, across = seen.reach[near[slides]], seen.across[near[slides]]
            steep = (reach - self.disc.radius) / (self.disc.rounding * reach)
            outwards = (across * steep[:, None]) @ turn[:, :2].T
            past = (self._places4[slides] @ motion).reshape(-1, 3, n)
            move[slides] -= turn[:, 2:] * (outwards[:, None] @ past)
        return out @ turn.T, move

    def _choose(self, seen: _Seen) -> None:
        """Choose the candidates again if another point comes close."""
        close = seen.gap < MARGIN
        if len(self.near) and np.count_nonzero(close[self.near]) == np.count_nonzero(close):
            return
        self._take(np.flatnonzero(seen.gap < NEAR))

    def _take(self, near: NDArray[np.intp]) -> None:
        """Set the candidates and their part of the friction state.

        Args:
            near: indices of the candidates, shape (s,).
        """
        if near is not self.near and not np.array_equal(near, self.near):
            self.choice += 1
            self._built = self._block = None
            self._rest4, self._places4 = np.ones((2, len(near), 4))
            self._rest4[:, :3] = self.positions[near]
        self.near = near
        self._places4[:, :3] = self._all[self.count + near]
        state = self.state
        self._anchored, self._anchor, self._sticking = state.anchored[near], state.anchor[near], state.sticking[near]
        self._all_anchored = bool(self._anchored.all())
        self._held_force, last = state.force[near], state.last
        self._guess = None
        if last is not None:
            slope = last.slope
            if last.near is not near:
                whole = np.zeros((self.count, *slope.shape[1:]))
                whole[last.near] = slope
                slope = whole[near]
            self._guess = (last.pose.x, self._held_force, slope)

    @property
    def _matrix(self) -> Array:
        """Compliance between the candidates [m/N], shape (3 s, 3 s).

        It is built at its first use, which is when something touches.
        """
        if self._built is None:
            rows = _degrees(self.near)
            self._built = np.ascontiguousarray(self.compliance[np.ix_(rows, rows)])
        return self._built

    def _active_block(self, active: NDArray[np.intp]) -> _Block:
        """Return the compliance and the factors of the active points.

        Those of the last step are returned if the points are the same.
        """
        key = active.tobytes()
        if self._block is None or self._block.key != key:
            rows = _degrees(active)
            matrix = self._matrix[rows[:, None], rows]
            lower, pivots, info = self._factorise(matrix.T)
            self._block = _Block(key, matrix, lower, pivots, info == 0)
        return self._block


def _degrees(points: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the indices of the x, y and z components of points, shape (3 k,)."""
    out: NDArray[np.intp] = (3 * points[:, None] + np.arange(3)).ravel()
    return out


def _projection_slope(normal: Array, direction: Array, friction: float, share: Array) -> Array:
    """Return the derivative of Coulomb's projection at slipping points.

    The shape is (k, 3, 3).

    Args:
        normal: unit normal, shape (3,).
        direction: unit vectors of the tangential part, shape (k, 3).
        friction: friction coefficient.
        share: factor by which the projection shortens the tangential part, shape (k,).
    """
    nn = normal[:, None] * normal
    out: Array = direction[:, :, None] * (friction * normal - share[:, None] * direction)[:, None, :]
    out += nn + share[:, None, None] * (_UNIT - nn)
    return out

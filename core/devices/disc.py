"""A rigid disc against the skin: contact forces for a pose of the disc, and how they change with the pose.

The disc's material moves with it, so what sticks is sheared when the disc tilts, shifts or turns. What friction
remembers is a `FrictionState`: for every point of the skin near the disc the place of the disc that it sticks to. It is
fixed while poses are tried and renewed by `DiscContact.settle` once a pose is chosen (staggering). How far the rim
falls away under a point is asked where the skin is, not where it would be untouched: at the anchor of a point that
sticks, else where the last step left it, as in `contact.solver.history`.

A pose is tried by solving the frictional contact on the condensed compliance with a semi-smooth Newton method. With a
rigid flat disc all points share one normal, Coulomb's projection is homogeneous of degree one, and the Newton system
reduces to A f = -D b with A = (I - D) / r + D C. The same factors give the exact derivative (implicit
differentiation): in a frame that turns with the disc the law does not change, so with the turning part taken out,
h = df - Omega f obeys A h = -D (C Omega f - Omega C f + db'), where db' is the change of b as the disc sees it.

Skin that follows the neo-Hookean law gives way less than linear skin by an offset c, which is frozen while poses are
tried: b is less by it. `solve` finds the contact at one pose by the law itself (`DiscLaw`).

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

MAX_STEPS = 10
MAX_ROUNDS = 24  # of contact and the law by turns, at one pose
_UNIT, _NO_LAW = np.eye(3), np.zeros((0, 3, 3))
_STICKS, _SLIPS = np.int8(STICK), np.int8(SLIP)
NEAR, MARGIN = 0.9e-3, 0.3e-3  # candidates have gaps below NEAR; they are chosen anew when others come to MARGIN


@dataclass(frozen=True, eq=False)
class _Factors:
    """LU factors of a Newton step, and which points it was for."""

    lower: Array
    pivots: NDArray[np.int32]
    active: NDArray[np.intp]
    slips: NDArray[np.intp]
    law: Array


@dataclass(frozen=True, eq=False)
class _Block:
    """Compliance between points that touch, (3 a, 3 a), which are told by a key, and its LU factors."""

    key: bytes
    matrix: Array
    lower: Array
    pivots: NDArray[np.int32]
    sound: bool


@dataclass(frozen=True, eq=False)
class _Seen:
    """What the disc sees of all points at a pose, in its own frame.

    Attributes:
        local: where they are untouched, shape (m, 3).
        across: where they are on the disc when its rim is asked for, shape (m, 2). reach: how far out, shape (m,).
        gap: of the untouched points, shape (m,).
    """

    local: Array
    across: Array
    reach: Array
    gap: Array


class DiscContact:
    """Contact of one skin with a disc, pose after pose.

    Args:
        points: of the skin, that carry forces: of the smooth skin, or the nodes of its mesh.
        disc: radius and rim.
        friction: Coulomb's coefficient.

    Attributes:
        solved, fallbacks: how many poses were solved, and for how many Newton's method was not enough.
        law: of skin that follows it; None where skin is linear.
    """

    def __init__(self, points: PressPoints, disc: Disc, friction: float) -> None:
        self.points, self.disc, self.friction = points, disc, float(friction)
        self.compliance, self.positions, self.count = points.compliance, points.positions, len(points.positions)
        self.law = None if points.law is None else DiscLaw(points.law, points.modulus, points.nodal)
        self._less: Array | None = None  # by how much less than linear skin the points give way, frozen
        # weighs displacement against force: between the softest and the stiffest point, as in the iteration
        self._stiffness = 1.0 / float(np.median(np.diag(self.compliance)))
        self.near: NDArray[np.intp] = np.zeros(0, np.intp)
        self._built: Array | None = None
        self._rest_positions = np.zeros((0, 3))
        self._block: _Block | None = None
        self._guess: tuple[Array, Array, Array] | None = None  # a configuration, forces there and their slope
        self._all = np.concatenate([self.positions, self.positions])  # the points untouched, and where they were last
        self._rest4, self._places4 = np.ones((0, 4)), np.ones((0, 4))  # the candidates, with a one each
        self.choice = 0  # counts how often the candidates were chosen, for those who keep tables by them
        self.solved = self.fallbacks = 0
        from scipy.linalg.lapack import dgetrf, dgetrs

        self._factorise, self._back = dgetrf, dgetrs
        self.hold(FrictionState.rest(self.count))

    def hold(self, state: FrictionState) -> None:
        """Fix the friction state for the poses that follow.

        What is found then depends on nothing that was solved before, be it by rounding: the candidates are the state's.
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
        """Let skin with a law give way as at a state of it, None at rest: what was solved since led astray."""
        assert self.law is not None
        self.law.go_on(state)
        self._less = self.law.less

    def gap(self, pose: DiscPose) -> Array:
        """Return the gap of every undeformed point [m], shape (m,)."""
        local = (self.positions - pose.centre) @ pose.rotation
        return self._fallen(local[:, :2]) - local[:, 2]

    def _fallen(self, across: Array) -> Array:
        """Return how far the disc's rim has fallen away at places in its plane [m], shape (m,)."""
        over = np.maximum(np.sqrt(across[:, 0] ** 2 + across[:, 1] ** 2) - self.disc.radius, 0.0)
        return over * over * (0.5 / self.disc.rounding)

    def solve(self, pose: DiscPose, known: DiscSolution | None = None) -> DiscSolution:
        """Return the contact at a pose from the friction state that is held, of skin with a law by the law.

        The offset is then the one that the law wants at this pose.

        Args:
            known: what `tried` returned of this pose last; it serves where the offset has not changed since.
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
            if lost:  # no step leads nearer: this is where least was left
                found = self.tried(pose)
                break
        return replace(found, amounts=law.amounts, law=law.save(), less=self._less)

    def tried(self, pose: DiscPose) -> DiscSolution:
        """Return the contact at a pose with the offset frozen that skin with a law has; linear skin's is exact."""
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
            # forces move with the disc to first order: nearly always the right points stick and slip at once
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
        """Return what a slower way finds."""
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
        """Return the friction state after a step that ended in this solution.

        A point that sticks keeps its anchor, one that slips takes it along, one that is open hovers over it.
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
        """Newton's method on the forces, and their derivatives from its last factors."""
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
            if step:  # a guess is no candidate
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
                # the transpose is in Fortran order already, which saves a copy
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
        """Differentiate the forces by the configuration with the factors of the last Newton step, (s, 3, n)."""
        slope = np.zeros_like(change)
        if factors is None:
            return slope
        active, count, slips = factors.active, pose.turning, factors.slips
        turn = crossing(pose.spin[:count]).reshape(-1, 3).T
        right = change[active]
        right[:, :, :count] -= (moved[active] @ turn).reshape(-1, count, 3).transpose(0, 2, 1)
        turned = None
        if len(slips):  # what sticks all over turns with the disc by itself
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
        """Return what the disc sees at a pose: a point that sticks stays where it is on the disc."""
        both = (self._all - pose.centre) @ pose.rotation
        local, across = both[: self.count], both[self.count :, :2]
        across[self._stuck] = self._stuck_at
        square = across * across
        reach = np.sqrt(square[:, 0] + square[:, 1])
        over = np.maximum(reach - self.disc.radius, 0.0)
        return _Seen(local, across, reach, over * over * (0.5 / self.disc.rounding) - local[:, 2])

    def _offsets(self, pose: DiscPose, seen: _Seen) -> tuple[Array, Array]:
        """Relative displacement without force, (s, 3), and its derivative but for turning with the disc, (s, 3, n)."""
        turn, near, n = pose.rotation, self.near, len(pose.spin)
        out = seen.local.take(near, axis=0)
        out[:, :2] -= self._anchor
        out[:, 2] = -seen.gap[near]
        motion = -pose.motion().transpose(2, 1, 0).reshape(4, 3 * n)
        move = (self._rest4 @ motion).reshape(-1, 3, n)
        if not self._all_anchored:  # what was never touched has nothing to be sheared from
            loose = ~self._anchored
            out[loose, :2] = 0.0
            move[loose] = turn[:, 2:] * (turn[:, 2] @ move[loose])[:, None]
        slides = ((seen.reach[near] > self.disc.radius) & ~self._sticking).nonzero()[0]
        if len(slides):  # past the rim, which falls away
            reach, across = seen.reach[near[slides]], seen.across[near[slides]]
            steep = (reach - self.disc.radius) / (self.disc.rounding * reach)
            outwards = (across * steep[:, None]) @ turn[:, :2].T
            past = (self._places4[slides] @ motion).reshape(-1, 3, n)
            move[slides] -= turn[:, 2:] * (outwards[:, None] @ past)
        return out @ turn.T, move

    def _choose(self, seen: _Seen) -> None:
        """Choose the candidates anew if others come close."""
        close = seen.gap < MARGIN
        if len(self.near) and np.count_nonzero(close[self.near]) == np.count_nonzero(close):
            return
        self._take(np.flatnonzero(seen.gap < NEAR))

    def _take(self, near: NDArray[np.intp]) -> None:
        """Take these candidates, with what the friction state says of them."""
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
        """Compliance between the candidates, built when something touches."""
        if self._built is None:
            rows = _degrees(self.near)
            self._built = np.ascontiguousarray(self.compliance[np.ix_(rows, rows)])
        return self._built

    def _active_block(self, active: NDArray[np.intp]) -> _Block:
        """Return what is known of points that touch, from the step before where they are the same."""
        key = active.tobytes()
        if self._block is None or self._block.key != key:
            rows = _degrees(active)
            matrix = self._matrix[rows[:, None], rows]
            lower, pivots, info = self._factorise(matrix.T)
            self._block = _Block(key, matrix, lower, pivots, info == 0)
        return self._block


def _degrees(points: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return where the components of some points are, x, y, z each, shape (3 k,)."""
    out: NDArray[np.intp] = (3 * points[:, None] + np.arange(3)).ravel()
    return out


def _projection_slope(normal: Array, direction: Array, friction: float, share: Array) -> Array:
    """Derivative of Coulomb's projection at slipping points, shape (k, 3, 3)."""
    nn = normal[:, None] * normal
    out: Array = direction[:, :, None] * (friction * normal - share[:, None] * direction)[:, None, :]
    out += nn + share[:, None, None] * (_UNIT - nn)
    return out

"""Contact of the deformed nodes with an exact shape, with Coulomb's friction or without. Lengths in mm, forces in N.

A shape rises in steps. In each, gap and normal are linearised about the nodes' places, contact is solved on that
exactly, and the linearisation is repeated about the places found until they stay. Without friction the linearised
problem is one of complementarity, solved by active sets, and the rounds are carried ahead (Nesterov 1983, begun again
where energy rises). With friction it is solved by a semi-smooth Newton method (Alart and Curnier 1991); nodes that
stick move with the shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve

from .shapes import Shape

Array = NDArray[np.float64]
Index = NDArray[np.integer]
TOLERANCE = 3e-6  # of gaps and of changes from one linearisation to the next [mm]
MAX_SETS, MAX_ROUNDS, MAX_NEWTON = 60, 200, 80
ON_THE_WAY, DRAGGED = (1e-3, 10), (3e-5, 100)  # tolerance [mm] and rounds of the steps between, and with friction
NEAR = 0.05  # nodes closer than this may come to touch in a linearisation [mm]
SLACK = 1e-13  # [mm]
SOLVED = 1e-11  # residual of the linearised problem, over its forces
SHORTEST = 1.0 / 64.0  # share of a Newton step


@dataclass(frozen=True, eq=False)
class Pressed:
    """Contact at one depth.

    Attributes:
        force: on each touched node [N], shape (k, 3). displacement: of each [mm], shape (k, 3).
        place: the shape's origin [mm], shape (3,).
        change: of the displacement by the last linearisation [mm]: above `TOLERANCE` where it did not settle.
        rounds: linearisations. residual: how far it is from the laws of contact, `Press.residual`.
    """

    force: Array
    displacement: Array
    place: Array
    change: float = 0.0
    rounds: int = 0
    residual: float = 0.0

    @property
    def loaded(self) -> NDArray[np.bool_]:
        """Which nodes carry force, shape (k,)."""
        return self.force.any(axis=1)


class Press:
    """Skin to press a shape on.

    Args:
        compliance: of the nodes that may touch [mm/N], shape (3 k, 3 k). points: where they are at rest, shape (k, 3).
        shape: what presses. friction: Coulomb's coefficient. cut: which nodes do not move along x, shape (k,).

    Raises:
        ArithmeticError: a linearised problem cannot be solved.
    """

    def __init__(
        self,
        compliance: Array,
        points: Array,
        shape: Shape,
        friction: float = 0.0,
        cut: NDArray[np.bool_] | None = None,
    ) -> None:
        self.compliance, self.points, self.shape, self.friction = compliance, points, shape, friction
        self.cut = np.zeros(len(points), bool) if cut is None else cut

    def depths(self, start: Array, depths: Sequence[float], step: float) -> list[Pressed]:
        """Press along +Z.

        Args:
            start: the shape's origin at depth 0 [mm], shape (3,). depths: rising [mm]. step: longest step [mm].
        """
        state, found = self.untouched(start), list[Pressed]()
        for depth in depths:
            state = self.moved(state, start + np.array([0.0, 0.0, depth]), step)
            found.append(state)
        return found

    def untouched(self, place: Array) -> Pressed:
        """Return skin at rest, with the shape's origin where it does not touch [mm], shape (3,)."""
        return Pressed(np.zeros_like(self.points), np.zeros_like(self.points), np.asarray(place, float))

    def moved(self, state: Pressed, place: Array, step: float) -> Pressed:
        """Return contact after a straight way of the shape to a place [mm], shape (3,), in steps no longer than one."""
        count = max(int(np.ceil(float(np.linalg.norm(place - state.place)) / step - 1e-9)), 1)
        way = state.place + np.linspace(0.0, 1.0, count + 1)[1:-1, None] * (place - state.place)
        for part in way:
            state = self.settled(part, state, *self._on_the_way)
        end = self.settled(np.asarray(place, float), state, TOLERANCE, MAX_ROUNDS)
        return replace(end, residual=self.residual(end, state))

    @property
    def _on_the_way(self) -> tuple[float, int]:
        return DRAGGED if self.friction else ON_THE_WAY

    def settled(self, place: Array, last: Pressed, tolerance: float, most: int) -> Pressed:
        """Return contact with the shape in one place, from contact with it in the last."""
        way, held = place - last.place, last.loaded
        about = last.displacement + np.where(held[:, None], way, 0.0)
        force, moved, energy, ahead, rounds = last.force, about, np.inf, 0, 0
        while rounds < most:
            rounds += 1
            gap, normal = self.shape.gap(self.points + about - place)
            load = force.any(axis=1)
            near = np.flatnonzero((gap < NEAR) | load)
            offset = gap[near] - np.einsum("ij,ij->i", normal[near], about[near])
            if self.friction:
                own = self._sliding(near, normal[near], offset, last.displacement[near] + way, force[near])
            else:
                matrix = self._between(near, normal[near])
                own = complementary(matrix, offset, load[near])[:, None] * normal[near]
            force = np.zeros_like(self.points)
            force[near] = np.where((self.cut[near, None]) & (np.arange(3) == 0), 0.0, own)
            before, moved = moved, (self.compliance @ force.ravel()).reshape(-1, 3)
            change = float(np.abs(moved - about)[near].max(initial=0.0))
            deepest = -float(self.shape.gap(self.points + moved - place)[0].min())
            if change < tolerance and deepest < tolerance:
                break
            if self.friction:
                about = moved
                continue
            former, energy = energy, 0.5 * float(np.vdot(force, moved))
            ahead = ahead + 1 if energy <= former else 0
            about = moved + ahead / (ahead + 3.0) * (moved - before)
        return Pressed(force, moved, place, change, rounds)

    def residual(self, state: Pressed, last: Pressed) -> float:
        """Return how far a state is from the laws of contact, each over its own scale.

        They are: no node in the shape, no force without touch, no pull, friction within Coulomb's cone, and slip
        against the friction that is on the cone. Gaps and slips count over 1 mm, forces over the largest.
        """
        gap, normal = self.shape.gap(self.points + state.displacement - state.place)
        slid = state.displacement - last.displacement - (state.place - last.place)
        push = np.einsum("ij,ij->i", state.force, normal)
        drag = state.force - push[:, None] * normal
        drag[self.cut, 0] = 0.0
        slid = slid - np.einsum("ij,ij->i", slid, normal)[:, None] * normal
        slid[self.cut, 0] = 0.0
        most, size, scale = self.friction * push, np.linalg.norm(drag, axis=1), max(np.abs(push).max(), 1e-30)
        loaded = state.loaded
        slack = np.where(loaded, np.clip(1.0 - size / np.maximum(most, 1e-30), 0.0, 1.0), 0.0)
        rate = np.linalg.norm(slid, axis=1)
        parts = [-gap.min(), np.abs(gap[loaded]).max(initial=0.0), -push.min() / scale]
        parts.append(float((size - most).max(initial=0.0)) / scale)
        if self.friction:
            unit = drag / np.maximum(size, 1e-30)[:, None]
            parts.append(float((slack * np.minimum(rate, push / scale))[loaded].max(initial=0.0)))
            parts.append(float((rate + np.einsum("ij,ij->i", slid, unit))[loaded & (slack < 1e-9)].max(initial=0.0)))
        return float(max(parts))

    def _between(self, nodes: Index, directions: Array) -> Array:
        """Return the compliance between nodes, each in its own direction, shape (n, n)."""
        rows = 3 * nodes[:, None] + np.arange(3)
        out = np.zeros((len(nodes), len(nodes)))
        some = np.flatnonzero(directions.any(axis=0))
        for i in some:
            for j in some:
                out += directions[:, i, None] * self.compliance[np.ix_(rows[:, i], rows[:, j])] * directions[:, j]
        return out

    def _sliding(self, near: Index, normal: Array, offset: Array, stuck: Array, force: Array) -> Array:
        """Return the forces of nodes under linearised gaps, shape (n, 3).

        Args:
            offset: gaps without displacement, shape (n,). stuck: displacement of nodes that move with the shape.
            force: where to start.
        """
        frame = np.stack([normal, *tangents(normal)], axis=1)
        rows = (3 * near[:, None] + np.arange(3)).ravel()
        block = self.compliance[np.ix_(rows, rows)].reshape(len(near), 3, len(near), 3)
        held = np.flatnonzero(self.cut[near])
        block[held, 0, held, 0] = block[held, 2, held, 2]  # which leaves no force there: they do not move that way
        turned = (frame @ block.reshape(len(near), 3, -1)).reshape(len(rows), len(near), 3).transpose(1, 0, 2)
        matrix = (turned @ frame.transpose(0, 2, 1)).transpose(1, 0, 2).reshape(len(rows), -1)
        free = np.column_stack([offset, -np.einsum("iak,ik->ia", frame[:, 1:], stuck)])
        local = coulomb(matrix, free, self.friction, np.einsum("iak,ik->ia", frame, force))
        return np.einsum("iak,ia->ik", frame, local)


def tangents(normal: Array) -> tuple[Array, Array]:
    """Return two unit vectors across each normal, shape (n, 3)."""
    axis = np.eye(3)[np.abs(normal).argmin(axis=1)]
    one = np.cross(normal, axis)
    one /= np.linalg.norm(one, axis=1)[:, None]
    return one, np.cross(normal, one)


def complementary(compliance: Array, gap: Array, active: NDArray[np.bool_]) -> Array:
    """Return x >= 0 with C x + gap >= 0 and x (C x + gap) = 0, by active sets.

    Args:
        compliance: symmetric positive definite, shape (n, n). gap: without forces, shape (n,).
        active: where to start from, shape (n,).

    Raises:
        ArithmeticError: the sets do not settle.
    """
    for _ in range(MAX_SETS):
        x = np.zeros(len(gap))
        own = np.flatnonzero(active)
        if own.size:
            x[own] = solve(compliance[np.ix_(own, own)], -gap[own], assume_a="pos")
        wanted = np.where(active, x > 0.0, compliance @ x + gap < -SLACK)
        if (wanted == active).all():
            return x
        active = wanted
    raise ArithmeticError("the active set does not settle")


def coulomb(compliance: Array, free: Array, friction: float, start: Array) -> Array:
    """Return forces (normal, two tangents) that follow Coulomb's laws, shape (n, 3).

    With w = C x + free: x_n >= 0, w_n >= 0, x_n w_n = 0, |x_t| <= friction x_n, and w_t against x_t where it is equal.

    Args:
        compliance: shape (3 n, 3 n). free: w without forces, shape (n, 3). start: forces to start from, shape (n, 3).

    Raises:
        ArithmeticError: Newton's method does not find them.
    """
    count = len(free)
    stiff = 1.0 / np.maximum(np.diag(compliance).reshape(count, 3).mean(axis=1), 1e-12)

    def residual(x: Array) -> tuple[Array, Array, Array]:
        """Return x less the projection of x - r w on the cone, what was projected, and where tangents slip."""
        trial = x - stiff[:, None] * ((compliance @ x.ravel()).reshape(-1, 3) + free)
        push, size = np.maximum(trial[:, 0], 0.0), np.linalg.norm(trial[:, 1:], axis=1)
        slips = size > friction * push
        share = np.where(slips, friction * push / np.maximum(size, 1e-300), 1.0)
        return x - np.column_stack([push, share[:, None] * trial[:, 1:]]), trial, slips

    x = np.column_stack([np.maximum(start[:, 0], 0.0), start[:, 1:]])
    left, trial, slips = residual(x)
    for _ in range(MAX_NEWTON):
        if np.linalg.norm(left) <= SOLVED * np.linalg.norm(x):
            return x
        own = trial[:, 0] > 0.0
        rows = np.flatnonzero(np.repeat(own, 3))
        slope = _projection_slope(trial[own], slips[own], friction)
        relaxed = np.eye(len(rows)) - np.repeat(stiff[own], 3)[:, None] * compliance[np.ix_(rows, rows)]
        matrix = np.eye(len(rows)) - (slope @ relaxed.reshape(-1, 3, len(rows))).reshape(len(rows), -1)
        # what leaves contact goes to zero at once; the rest answers to that as well
        gone = np.where(own[:, None], 0.0, -x)
        moved = stiff[own, None] * (compliance[rows] @ gone.ravel()).reshape(-1, 3)
        right = -left[own] - np.einsum("iab,ib->ia", slope, moved)
        step = gone
        step[own] = solve(matrix, right.ravel(), check_finite=False).reshape(-1, 3)
        share, size = 1.0, np.linalg.norm(left)
        while True:
            tried = residual(x + share * step)
            if np.linalg.norm(tried[0]) < (1.0 - 0.1 * share) * size or share <= SHORTEST:
                break
            share *= 0.5
        x = x + share * step
        left, trial, slips = tried
    raise ArithmeticError(f"friction is not solved: {np.linalg.norm(left) / np.linalg.norm(x):.1e}")


def _projection_slope(trial: Array, slips: NDArray[np.bool_], friction: float) -> Array:
    """Return the derivative of the projection on the cone where it is pressed, shape (n, 3, 3)."""
    out = np.tile(np.eye(3), (len(trial), 1, 1))
    size = np.maximum(np.linalg.norm(trial[:, 1:], axis=1), 1e-300)
    unit = trial[:, 1:] / size[:, None]
    across = np.eye(2) - unit[:, :, None] * unit[:, None, :]
    out[slips, 1:, 1:] = ((friction * trial[:, 0] / size)[:, None, None] * across)[slips]
    out[slips, 1:, 0] = friction * unit[slips]
    return out

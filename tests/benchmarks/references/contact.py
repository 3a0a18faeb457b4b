"""Frictionless contact of the deformed nodes with an exact shape. Lengths in mm, forces in N.

A signed distance to a convex solid is convex: its linearisation about any place is below it, so what the linearised
gap allows is outside the solid, and the least energy under one linearisation after another falls to a minimum
(convex-concave procedure; Lipp and Boyd 2016). Between the rounds it is carried ahead (Nesterov 1983, begun again
where energy rises).

Nodes that are free to slide off a sharp edge do so to both sides, and it comes through between them, unless elements
there are far smaller than the rounding, over which skin is stretched to many times its width: by a fifth of the force
on an edge of 60 degrees. A line of nodes is therefore held on top of the edge, and the edge is moved sideways until
that takes no force. In half a symmetric mesh the cut does so. In two dimensions both go to the same force.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve

from .shapes import Shape

Array = NDArray[np.float64]
STEP = 0.1  # the shape comes in such steps [mm]
TOLERANCE = 3e-6  # of gaps and of changes from one linearisation to the next [mm]
MAX_SETS, MAX_ROUNDS = 60, 200
ON_THE_WAY = (1e-2, 2)  # tolerance and rounds of the steps between
NEAR = 0.05  # nodes closer than this may come to touch in a linearisation [mm]
ASIDE, MAX_ASIDE = 0.05, 15  # longest step aside [mm], and how many
NEARLY = (3e-5, 40)  # tolerance and rounds of the steps aside
HELD = 2e-4  # force along X that may be left on a line, over the one along Z
SLACK = 1e-13  # [mm]


@dataclass(frozen=True, eq=False)
class Pressed:
    """Contact at one depth.

    Attributes:
        force: on each touched node [N], shape (k, 3). displacement: of each [mm], shape (k, 3).
        change: of the displacement by the last linearisation [mm]: above `TOLERANCE` where it did not settle.
        penetration: deepest of the deformed nodes in the shape [mm]. rounds: linearisations.
        place: the shape's origin [mm], shape (3,). held: force that holds a line of nodes on top of it, along X [N].
    """

    force: Array
    displacement: Array
    change: float
    penetration: float
    rounds: int
    place: Array
    held: float = 0.0


class Press:
    """Skin to press shapes on.

    Args:
        compliance: of the nodes that may touch [mm/N], shape (3 k, 3 k). points: where they are at rest, shape (k, 3).
        shape: what presses. line: which nodes are held on top of it, shape (k,).

    Raises:
        ArithmeticError: an active set does not settle.
    """

    def __init__(self, compliance: Array, points: Array, shape: Shape, line: NDArray[np.bool_] | None = None) -> None:
        self.compliance, self.points, self.shape = compliance, points, shape
        self.line = np.zeros(len(points), bool) if line is None else line

    def depths(self, at: Callable[[float], Array], sideways: float, depths: Sequence[float]) -> list[Pressed]:
        """Press step by step along +Z, and then aside until no force is needed to hold a line.

        Args:
            at: the shape's origin at some x where it first meets the smooth skin [mm], shape (3,).
            sideways: x to begin at. depths: beyond first contact, rising.
        """
        found: list[Pressed] = []
        none, start = np.zeros_like(self.points), at(sideways)
        state, reached = Pressed(none, none, 0.0, 0.0, 0, start), 0.0
        for depth in depths:
            count = max(int(np.ceil((depth - reached) / STEP - 1e-9)), 1)
            for part in np.linspace(reached, depth, count + 1)[1:-1]:
                state = self.settled(start + [0.0, 0.0, part], state, *ON_THE_WAY)
            state = self.settled(start + [0.0, 0.0, depth], state, TOLERANCE, MAX_ROUNDS)
            found.append(self._balanced(state, at, depth) if self.line.any() else state)
            reached = depth
        return found

    def _balanced(self, state: Pressed, at: Callable[[float], Array], depth: float) -> Pressed:
        x = [float(state.place[0])]
        held = [state.held]
        for _ in range(MAX_ASIDE):
            slope = (held[-1] - held[-2]) / (x[-1] - x[-2]) if len(x) > 1 else np.inf
            step = -held[-1] / slope if slope > 0.0 and np.isfinite(slope) else -np.sign(held[-1]) * ASIDE
            x.append(x[-1] + float(np.clip(step, -ASIDE, ASIDE)))
            state = self.settled(at(x[-1]) + [0.0, 0.0, depth], state, *NEARLY)
            held.append(state.held)
            if abs(state.held) < HELD * state.force[:, 2].sum():
                break
        return self.settled(state.place, state, TOLERANCE, MAX_ROUNDS)

    def settled(self, place: Array, state: Pressed, tolerance: float, most: int) -> Pressed:
        """Return contact with the shape in one place, from contact with it nearby."""
        moved, load, about = state.displacement, np.linalg.norm(state.force, axis=1), state.displacement
        energy, ahead, rounds = np.inf, 0, 0
        while True:
            rounds += 1
            gap, normal = self.shape.gap(self.points + about - place)
            near = np.flatnonzero((gap < NEAR) | (load > 0.0))
            held = np.flatnonzero(self.line & ((load > 0.0) | (gap < 0.0)))
            both = np.concatenate([near, held])
            direction = np.concatenate([normal[near], np.tile([1.0, 0.0, 0.0], (len(held), 1))])
            offset = -np.einsum("ij,ij->i", direction, about[both])
            offset[: len(near)] += gap[near]
            offset[len(near) :] = self.points[held, 0] - place[0]
            amount = complementary(_projected(self.compliance, both, direction), offset, load[near] > 0.0)
            force, load = np.zeros_like(self.points), np.zeros(len(self.points))
            np.add.at(force, both, amount[:, None] * direction)
            load[near] = amount[: len(near)]
            before, moved = moved, (self.compliance @ force.ravel()).reshape(-1, 3)
            change = float(np.abs(moved - about).max())
            deepest = -float(self.shape.gap(self.points + moved - place)[0].min())
            if (change < tolerance and deepest < tolerance) or rounds == most:
                return Pressed(force, moved, change, deepest, rounds, place, float(amount[len(near) :].sum()))
            last, energy = energy, 0.5 * float(np.vdot(force, moved))
            ahead = ahead + 1 if energy <= last else 0
            about = moved + ahead / (ahead + 3.0) * (moved - before)


def _projected(compliance: Array, nodes: NDArray[np.integer], directions: Array) -> Array:
    """Return the compliance between nodes, each in its own direction, shape (n, n)."""
    rows = 3 * nodes[:, None] + np.arange(3)
    out = np.zeros((len(nodes), len(nodes)))
    some = np.flatnonzero(directions.any(axis=0))
    for i in some:
        for j in some:
            out += directions[:, i, None] * compliance[np.ix_(rows[:, i], rows[:, j])] * directions[:, j]
    return out


def complementary(compliance: Array, gap: Array, active: NDArray[np.bool_]) -> Array:
    """Return x with C x + gap = 0, but for the first x >= 0, C x + gap >= 0 and x (C x + gap) = 0: by active sets.

    Args:
        compliance: symmetric positive definite, shape (n, n). gap: without forces, shape (n,).
        active: which of the first to start from, shape (k,), k <= n.

    Raises:
        ArithmeticError: the sets do not settle.
    """
    count = len(active)
    for _ in range(MAX_SETS):
        x = np.zeros(len(gap))
        own = np.concatenate([np.flatnonzero(active), np.arange(count, len(gap))])
        if own.size:
            x[own] = solve(compliance[np.ix_(own, own)], -gap[own], assume_a="pos")
        wanted = np.where(active, x[:count] > 0.0, compliance[:count] @ x + gap[:count] < -SLACK)
        if (wanted == active).all():
            return x
        active = wanted
    raise ArithmeticError("the active set does not settle")

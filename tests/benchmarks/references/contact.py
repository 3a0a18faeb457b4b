"""Frictionless contact of the deformed nodes with an exact shape. Lengths in mm, forces in N.

A signed distance to a convex solid is convex: its linearisation about any place is below it, so what the linearised
gap allows is outside the solid, and the least energy under one linearisation after another falls to a minimum
(convex-concave procedure; Lipp and Boyd 2016). Between the rounds it is carried ahead (Nesterov 1983, begun again
where energy rises).

Nodes that may slide off an edge do so, and it comes through between them, unless elements there are far smaller than
the rounding, over which skin is stretched to many times its width: what is free to slide is then too soft by as much as
what is held on top is too stiff. With quadratic elements both meet.
"""

from __future__ import annotations

from collections.abc import Sequence
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
SLACK = 1e-13  # [mm]


@dataclass(frozen=True, eq=False)
class Pressed:
    """Contact at one depth.

    Attributes:
        force: on each touched node [N], shape (k, 3). displacement: of each [mm], shape (k, 3).
        change: of the displacement by the last linearisation [mm]: above `TOLERANCE` where it did not settle.
        penetration: deepest of the deformed nodes in the shape [mm]. rounds: linearisations.
    """

    force: Array
    displacement: Array
    change: float
    penetration: float
    rounds: int


def press(compliance: Array, points: Array, shape: Shape, at: Array, depths: Sequence[float]) -> list[Pressed]:
    """Press a shape in, step by step.

    Args:
        compliance: of the nodes that may touch [mm/N], shape (3 k, 3 k). points: where they are at rest, shape (k, 3).
        at: the shape's origin where it first meets the smooth skin, shape (3,).
        depths: beyond that, along +Z, rising.

    Raises:
        ArithmeticError: an active set does not settle.
    """
    found: list[Pressed] = []
    none, reached = np.zeros_like(points), 0.0
    state = Pressed(none, none, 0.0, 0.0, 0)
    for depth in depths:
        count = max(int(np.ceil((depth - reached) / STEP - 1e-9)), 1)
        for part in np.linspace(reached, depth, count + 1)[1:-1]:
            state = _settled(compliance, points, shape, at + [0.0, 0.0, part], state, *ON_THE_WAY)
        state = _settled(compliance, points, shape, at + [0.0, 0.0, depth], state, TOLERANCE, MAX_ROUNDS)
        found.append(state)
        reached = depth
    return found


def _settled(
    compliance: Array, points: Array, shape: Shape, place: Array, state: Pressed, tolerance: float, most: int
) -> Pressed:
    """Return contact with the shape in one place, from contact with it nearby."""
    moved, load, about = state.displacement, np.linalg.norm(state.force, axis=1), state.displacement
    energy, ahead, rounds = np.inf, 0, 0
    while True:
        rounds += 1
        gap, normal = shape.gap(points + about - place)
        near = np.flatnonzero((gap < NEAR) | (load > 0.0))
        direction = normal[near]
        offset = gap[near] - np.einsum("ij,ij->i", direction, about[near])
        amount = complementary(_projected(compliance, near, direction), offset, load[near] > 0.0)
        force, load = np.zeros_like(points), np.zeros(len(points))
        force[near], load[near] = amount[:, None] * direction, amount
        before, moved = moved, (compliance @ force.ravel()).reshape(-1, 3)
        change = float(np.abs(moved - about).max())
        deepest = -float(shape.gap(points + moved - place)[0].min())
        if (change < tolerance and deepest < tolerance) or rounds == most:
            return Pressed(force, moved, change, deepest, rounds)
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
    """Return x >= 0 with C x + gap >= 0 and x (C x + gap) = 0, by primal-dual active sets.

    Args:
        compliance: symmetric positive definite, shape (n, n). gap: without forces, shape (n,).
        active: which to start from, shape (n,).

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

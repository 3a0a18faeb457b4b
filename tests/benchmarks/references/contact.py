"""Frictionless contact without penetration of the nodes, to 1e-8. Lengths in mm, forces in N.

By two laws of the gap: linear about the undeformed nodes, and at the deformed nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve

from .shapes import Shape

Array = NDArray[np.float64]
STEP = 0.1  # the shape comes in such steps [mm]
TOLERANCE = 1e-8  # of gaps [mm] and of changes from one linearisation to the next
MAX_SETS, MAX_ROUNDS = 60, 60
NEAR = 0.05  # nodes closer than this may come to touch in a linearisation [mm]
LEAST_SHARE = 0.1  # of a linearisation's step that is taken, where steps do not shrink
SLACK = 1e-13  # [mm]


@dataclass(frozen=True, eq=False)
class Pressed:
    """Contact at one depth.

    Attributes:
        force: on each touched node [N], shape (k, 3). displacement: of each [mm], shape (k, 3).
        change: of the displacement by the last linearisation [mm]: above `TOLERANCE` where it did not settle.
        penetration: deepest of the deformed nodes in the shape, by the law that was solved [mm]. rounds: linearisations.
    """

    force: Array
    displacement: Array
    change: float
    penetration: float
    rounds: int


def press(compliance: Array, points: Array, shape: Shape, at: Array, depths: Sequence[float]) -> list[Pressed]:
    """Press a shape in, step by step.

    The gap is linear about the deformed place of each node, and linearised anew until it stands; so forces act along
    the normals of the shape where the skin really lies on it.

    Args:
        compliance: of the nodes that may touch [mm/N], shape (3 k, 3 k). points: where they are at rest, shape (k, 3).
        at: the shape's origin where it first meets the smooth skin, shape (3,).
        depths: beyond that, along +Z, rising.

    Raises:
        ArithmeticError: an active set does not settle.
    """
    found: list[Pressed] = []
    state = Pressed(np.zeros_like(points), np.zeros_like(points), 0.0, 0.0, 0)
    reached = 0.0
    for depth in depths:
        parts = np.linspace(reached, depth, max(int(np.ceil((depth - reached) / STEP - 1e-9)), 1) + 1)[1:]
        for part in parts:
            place, wanted = at + [0.0, 0.0, part], (TOLERANCE, MAX_ROUNDS) if part == depth else (1e-4, 12)
            state = _settled(compliance, points, shape, place, state, *wanted)
        found.append(state)
        reached = depth
    return found


def press_linear(compliance: Array, points: Array, shape: Shape, place: Array) -> Pressed:
    """Press a shape in at once, with the gap of each node linear about where the node is undeformed.

    Convex, so there is one answer; at an edge it is off by what the skin moves along the faces.

    Args:
        compliance: of the nodes that may touch [mm/N], shape (3 k, 3 k). points: where they are at rest, shape (k, 3).
        place: the shape's origin, shape (3,).

    Raises:
        ArithmeticError: the active set does not settle.
    """
    gap, normal = shape.gap(points - place)
    amount = complementary(_projected(compliance, np.arange(len(points)), normal), gap)
    force = amount[:, None] * normal
    moved = (compliance @ force.ravel()).reshape(-1, 3)
    left = np.einsum("ij,ij->i", normal, moved) + gap
    return Pressed(force, moved, 0.0, -float(left.min()), 1)


def _settled(
    compliance: Array, points: Array, shape: Shape, place: Array, state: Pressed, tolerance: float, most: int
) -> Pressed:
    """Return contact with the shape in one place, from contact with it nearby."""
    moved, load, share, before = state.displacement, np.linalg.norm(state.force, axis=1), 1.0, np.inf
    for count in range(1, most + 1):
        here = points + moved - place
        gap, normal = shape.gap(here)
        near = np.flatnonzero((gap < NEAR) | (load > 0.0))
        bent = near[(shape.bend(here[near]) * load[near]) > 0.0]
        # where the surface bends, the normal turns with the slip s = t.(u - u_k): the force gains load * bend * s * t
        along = np.stack([normal[bent, 2], np.zeros(len(bent)), -normal[bent, 0]], axis=1)
        turning = shape.bend(here[bent]) * load[bent]
        both = np.concatenate([near, bent])
        direction = np.concatenate([normal[near], along])
        flexible = _projected(compliance, both, direction)
        n = len(near)
        flexible[np.arange(n, len(both)), np.arange(n, len(both))] -= 1.0 / turning
        offset = np.concatenate([gap[near], np.zeros(len(bent))]) - np.einsum("ij,ij->i", direction, moved[both])
        amount = complementary(flexible, offset, n, load[near] > 0.0)
        force = np.zeros_like(points)
        np.add.at(force, both, amount[:, None] * direction)
        load = np.zeros(len(points))
        load[near] = amount[:n]
        target = (compliance @ force.ravel()).reshape(-1, 3)
        change = float(np.abs(target - moved).max())
        share = min(1.0, 2.0 * share) if change < 0.5 * before else max(0.5 * share, LEAST_SHARE)
        before = change
        moved = moved + share * (target - moved)
        deepest = -float(shape.gap(points + moved - place)[0].min())
        if change < tolerance and deepest < 10.0 * tolerance:
            break
    return Pressed(force, moved, change, deepest, count)


def _projected(compliance: Array, nodes: NDArray[np.integer], directions: Array) -> Array:
    """Return the compliance between nodes, each in its own direction, shape (n, n)."""
    rows = 3 * nodes[:, None] + np.arange(3)
    out = np.zeros((len(nodes), len(nodes)))
    for i in range(3):
        for j in range(3):
            out += directions[:, i, None] * compliance[np.ix_(rows[:, i], rows[:, j])] * directions[:, j]
    return out


def complementary(compliance: Array, gap: Array, count: int | None = None, active: Any = None) -> Array:
    """Return x with C x + gap = 0, but for the first `count` x >= 0 with C x + gap >= 0 and x (C x + gap) = 0.

    By primal-dual active sets.

    Args:
        compliance: symmetric, shape (n, n). gap: without forces, shape (n,).
        active: which of the first to start from, shape (count,).

    Raises:
        ArithmeticError: the sets do not settle.
    """
    count = len(gap) if count is None else count
    active = gap[:count] < 0.0 if active is None else active
    for _ in range(MAX_SETS):
        x = np.zeros(len(gap))
        own = np.concatenate([np.flatnonzero(active), np.arange(count, len(gap))])
        if own.size:
            x[own] = solve(compliance[np.ix_(own, own)], -gap[own], assume_a="sym")
        left = (compliance[:count] @ x + gap[:count]) < -SLACK
        wanted = np.where(active, x[:count] > 0.0, left)
        if (wanted == active).all():
            return x
        active = wanted
    raise ArithmeticError(f"the active set does not settle: {np.count_nonzero(wanted != active)} of {count}")

"""Balance: the forces of several grips that obey friction and together supply a required force and torque.

The object gives way until they do, but in one frame by no more than `REACH`. Where friction cannot supply the required
wrench, the object is drawn that far past the skin, and the forces are the nearest that friction can carry. Both are
one problem: minimise the skin's energy plus REACH |G f - h| over forces that Coulomb's law admits, an exact penalty.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...arrays import Array
from .cone import natural_residual, project
from .grip import Grip, cross_matrix

TOLERANCE = 1e-8
SLIDING_TOLERANCE = 1e-5
MAX_ITERATIONS = 6000
RELAXATION = 1.8
# An object that holds moves in a frame by no more than this where the skin holds it [m]: an object that is drawn
# so far past a pad slips on all of it.
REACH = 3e-3


class Balance(NamedTuple):
    """Forces that hold, or all that friction can do.

    Attributes:
        forces: contact force on the near nodes of each grip [N], one (k, 3) a grip.
        scaled: -w / rho at these nodes [N], one (k, 3) a grip.
        shifts: change of b there by the object's displacement [m], likewise.
        move: the object's displacement: translation of its middle [m], rotation vector [rad], shape (6,).
        size: norm of the object's displacement, with rotations scaled to lengths [m].
        centre: centre of the grip, from the object's middle [m], shape (3,).
        holds: the forces supply the required wrench.
        residual: residual of the contact laws.
        iterations: number of iterations of the method.
    """

    forces: list[Array]
    scaled: list[Array]
    shifts: list[Array]
    move: Array
    size: float
    centre: Array
    holds: bool
    residual: float
    iterations: int


def balance(
    grips: Sequence[Grip], forces: Sequence[Array], scaled: Sequence[Array], required: Array, rho: float
) -> Balance:
    """Return forces in their cones with G f = h, or as near to it as friction allows.

    By the alternating method with the object eliminated. The skin feels f, the object -f, so h on the skin is minus
    the required wrench on the object.

    Args:
        forces, scaled: start values for the near nodes of each grip [N], shape (k, 3).
        required: force and torque on the object [N, N m], shape (6,).
        rho: compliance that the steps are weighed with [m/N].
    """
    ends = np.cumsum([0] + [3 * g.near.size for g in grips])
    parts = [slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]
    normals = np.concatenate([g.gaps.normal[g.near] for g in grips])
    mu = np.concatenate([g.friction for g in grips])
    b = np.concatenate([g.offset.reshape(-1) for g in grips])
    wrench = np.concatenate([g.wrench for g in grips], axis=1)
    # torques are taken about the grip's centre and measured in its lever, so that both halves of the wrench weigh alike
    arms = np.concatenate([g.arms for g in grips])
    centre = arms.mean(axis=0)
    lever = max(float(np.sqrt(((arms - centre) ** 2).sum(axis=1).mean())), 1e-6)
    frame = np.eye(6)
    frame[3:, :3] = -cross_matrix(centre)
    frame[3:] /= lever
    g_rows, target = frame @ wrench, frame @ -required
    image = np.concatenate([grip.inverse @ g_rows[:, p].T for grip, p in zip(grips, parts, strict=True)])
    give = _Give(g_rows @ image)
    z, _ = project(np.concatenate(forces), normals, mu)
    y = np.concatenate(scaled)
    load = float(np.linalg.norm(target))
    move, short = np.zeros(6), np.inf
    for iteration in range(1, MAX_ITERATIONS + 1):
        rhs = rho * (z - y).reshape(-1) - b
        free = np.concatenate([grip.inverse @ rhs[p] for grip, p in zip(grips, parts, strict=True)])
        move = give(target - g_rows @ free)
        force = (free + image @ move).reshape(-1, 3)
        v = RELAXATION * force + (1.0 - RELAXATION) * z + y
        new, _ = project(v, normals, mu)
        y = v - new
        change = float(np.abs(new - z).max()) + float(np.abs(force - new).max())
        z = new
        if iteration % 10:
            continue
        # a load of nothing is met as well as the grip is known
        whole = max(load + float(np.abs(z).sum()), 1e-300)
        short = float(np.linalg.norm(g_rows @ z.reshape(-1) - target)) / whole
        settled = change / max(float(np.abs(z).max()), 1e-300)
        if settled <= TOLERANCE and short <= TOLERANCE or give.slides and settled <= SLIDING_TOLERANCE:
            break
    moved = -g_rows.T @ move
    w = np.concatenate([g.matrix @ z.reshape(-1)[p] for g, p in zip(grips, parts, strict=True)])
    residual = natural_residual(z, (w + b + moved).reshape(-1, 3), normals, mu, 1.0 / rho)
    held, scaled_w, shifts = ([x.reshape(-1)[p].reshape(-1, 3) for p in parts] for x in (z, y, moved))
    holds = not give.slides and short <= 100.0 * TOLERANCE
    size = float(np.linalg.norm(move))
    return Balance(held, scaled_w, shifts, frame.T @ move, size, centre, holds, residual, iteration)


class _Give:
    """How far an object gives way to a wrench: by its grip's compliance, but no farther than `REACH`.

    Args:
        stiffness: stiffness of the grip, with the weight of the steps added, in scaled coordinates [N/m], shape (6, 6).
    """

    def __init__(self, stiffness: Array) -> None:
        values, vectors = np.linalg.eigh(stiffness)
        kept = values > 1e-10 * max(float(values[-1]), 1e-300)  # a direction that nothing holds does not move either
        self._values, self._vectors = values[kept], vectors[:, kept]
        self._more = 0.0
        self.slides = False

    def __call__(self, wrench: Array) -> Array:
        """Return the displacement d [m], shape (6,): (S + l I) d = wrench with the least l >= 0 that keeps it short."""
        part = self._vectors.T @ wrench
        move = part / self._values
        self.slides = float(move @ move) > REACH * REACH
        if self.slides:
            more = max(self._more, 0.0)
            for _ in range(30):  # Newton on 1 / |d|, which is nearly straight
                stiff = self._values + more
                move = part / stiff
                length = float(np.sqrt(move @ move))
                if abs(length - REACH) <= 1e-9 * REACH:
                    break
                slope = float((move * move / stiff).sum()) / (length * length)
                more = max(more + (length / REACH - 1.0) / slope, 0.0)
            self._more = more
        out: Array = self._vectors @ move
        return out

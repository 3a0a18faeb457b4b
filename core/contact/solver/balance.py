"""Balance: contact forces of several grips that obey Coulomb's law and supply a required wrench.

A wrench is a force and a torque. The object is displaced until the forces supply it, but by no more than `REACH` in one
frame. If friction cannot supply the wrench, the object is displaced by `REACH`, and the forces are the nearest ones
that friction admits. Both cases are one problem with an exact penalty: minimise the skin's energy plus REACH |G f - h|
over forces f in their friction cones, where G maps f to a wrench and h is the required one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...arrays import Array
from .cone import assess, project
from .grip import Grip, cross_matrix

TOLERANCE = 1e-8  # relative change and imbalance at which the iteration ends
SLIDING_TOLERANCE = 1e-5  # relative change at which it ends if friction cannot supply the wrench
MAX_ITERATIONS = 6000
RELAXATION = 1.8  # over-relaxation of the alternating method
# Largest displacement of the object in a frame [m]. An object that is displaced so far along a pad slips everywhere.
REACH = 3e-3


class Balance(NamedTuple):
    """Result of a balance.

    Attributes:
        forces: contact forces on the near nodes of each grip [N], shape (k, 3) each.
        scaled: -w / rho at these nodes [N], shape (k, 3) each.
        shifts: change of the offset b at these nodes by the object's displacement [m], shape (k, 3) each.
        move: displacement of the object: translation of its centre of mass [m] and rotation vector [rad], shape (6,).
        size: norm of the displacement, with rotations multiplied by a lever [m].
        centre: centre of the grip relative to the object's centre of mass [m], shape (3,).
        holds: whether the forces supply the required wrench.
        residual: residual of the contact laws.
        iterations: number of iterations.
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
    """Return forces in their friction cones with G f = h, or as near to it as friction allows.

    The method alternates between the linear problem and the projection on the cones; the object's displacement is
    eliminated. The forces f act on the skin and -f on the object, so h is minus the required wrench on the object.

    Args:
        grips: grips of the fingers.
        forces, scaled: start values for the near nodes of each grip [N], shape (k, 3) each.
        required: required force [N] and torque [N m] on the object, shape (6,).
        rho: compliance by which the steps of the method are weighted [m/N].
    """
    ends = np.cumsum([0] + [3 * g.near.size for g in grips])
    parts = [slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]
    normals = np.concatenate([g.gaps.normal[g.near] for g in grips])
    mu = np.concatenate([g.friction for g in grips])
    b = np.concatenate([g.offset.reshape(-1) for g in grips])
    wrench = np.concatenate([g.wrench for g in grips], axis=1)
    # Torques are about the grip's centre and divided by its lever, so that they are comparable with forces.
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
        # Without a load, the imbalance is relative to the grip's forces.
        whole = max(load + float(np.abs(z).sum()), 1e-300)
        short = float(np.linalg.norm(g_rows @ z.reshape(-1) - target)) / whole
        settled = change / max(float(np.abs(z).max()), 1e-300)
        if settled <= TOLERANCE and short <= TOLERANCE or give.slides and settled <= SLIDING_TOLERANCE:
            break
    moved = -g_rows.T @ move
    w = np.concatenate([g.matrix @ z.reshape(-1)[p] for g, p in zip(grips, parts, strict=True)])
    residual, _ = assess(z, (w + b + moved).reshape(-1, 3), normals, mu, 1.0 / rho)
    held, scaled_w, shifts = ([x.reshape(-1)[p].reshape(-1, 3) for p in parts] for x in (z, y, moved))
    holds = not give.slides and short <= 100.0 * TOLERANCE
    size = float(np.linalg.norm(move))
    return Balance(held, scaled_w, shifts, frame.T @ move, size, centre, holds, residual, iteration)


class _Give:
    """Displacement of an object under a wrench: by the stiffness of its grip, limited to `REACH`.

    Args:
        stiffness: stiffness of the grip, with the weight of the steps added, in scaled coordinates [N/m], shape (6, 6).

    Attributes:
        slides: whether the last displacement was limited.
    """

    def __init__(self, stiffness: Array) -> None:
        values, vectors = np.linalg.eigh(stiffness)
        kept = values > 1e-10 * max(float(values[-1]), 1e-300)  # directions without stiffness are not displaced
        self._values, self._vectors = values[kept], vectors[:, kept]
        self._more = 0.0
        self.slides = False

    def __call__(self, wrench: Array) -> Array:
        """Return the displacement d [m], shape (6,): (S + l I) d = wrench with the least l >= 0 for |d| <= REACH."""
        part = self._vectors.T @ wrench
        move = part / self._values
        self.slides = float(move @ move) > REACH * REACH
        if self.slides:
            more = max(self._more, 0.0)
            for _ in range(30):  # Newton's method for 1 / |d|, which is nearly linear in l
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

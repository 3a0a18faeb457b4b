"""Balance: the forces of several grips that obey friction and together supply a required force and torque."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...arrays import Array
from .cone import natural_residual, project
from .grip import Grip

TOLERANCE = 1e-8
MAX_ITERATIONS = 6000
RELAXATION = 1.6
# A displacement beyond these in one frame is no grip any more [m], [rad].
LOST, TURNED = 0.01, 0.5


class Balance(NamedTuple):
    """Forces that hold.

    Attributes:
        forces: of each grip's near nodes [N], one (k, 3) a grip. scaled: -w / rho there [N], likewise.
        shifts: what the object's displacement adds to b there [m], likewise.
        move: the object's displacement: translation [m], rotation vector [rad], shape (6,).
        residual: of the contact laws. iterations: of the method.
    """

    forces: list[Array]
    scaled: list[Array]
    shifts: list[Array]
    move: Array
    residual: float
    iterations: int


def balance(
    grips: Sequence[Grip], forces: Sequence[Array], scaled: Sequence[Array], required: Array, rho: float
) -> Balance | None:
    """Return forces in their cones with G f = h, or None where friction cannot supply it.

    By the alternating method with the object eliminated. The skin feels f, the object -f, so h on the skin is minus
    what is required on the object.

    Args:
        forces, scaled: where to start from: of each grip's near nodes [N], shape (k, 3).
        required: force and torque on the object [N, N m], shape (6,).
        rho: compliance that the steps are weighed with [m/N].
    """
    ends = np.cumsum([0] + [3 * g.near.size for g in grips])
    parts = [slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]
    normals = np.concatenate([g.gaps.normal[g.near] for g in grips])
    mu = np.concatenate([g.friction for g in grips])
    b = np.concatenate([g.offset.reshape(-1) for g in grips])
    wrench = np.concatenate([g.wrench for g in grips], axis=1)
    # torques are measured in the lever of the contacts, so that both halves of the wrench weigh alike
    lever = max(float(np.sqrt((wrench[3:] ** 2).mean() / (wrench[:3] ** 2).mean())), 1e-6)
    scale = np.concatenate([np.ones(3), np.full(3, 1.0 / lever)])
    g_rows, target = wrench * scale[:, None], -required * scale
    image = np.concatenate([grip.inverse @ g_rows[:, p].T for grip, p in zip(grips, parts, strict=True)])
    schur = np.linalg.pinv(g_rows @ image, rcond=1e-10)
    z, _ = project(np.concatenate(forces), normals, mu)
    y = np.concatenate(scaled)
    size = max(float(np.linalg.norm(target)), 1e-12)
    move = np.zeros(6)
    for iteration in range(1, MAX_ITERATIONS + 1):
        rhs = rho * (z - y).reshape(-1) - b
        free = np.concatenate([grip.inverse @ rhs[p] for grip, p in zip(grips, parts, strict=True)])
        move = schur @ (target - g_rows @ free)
        force = (free + image @ move).reshape(-1, 3)
        v = RELAXATION * force + (1.0 - RELAXATION) * z + y
        new, _ = project(v, normals, mu)
        y = v - new
        change = float(np.abs(new - z).max()) + float(np.abs(force - new).max())
        z = new
        if iteration % 10:
            continue
        shift, turn = float(np.linalg.norm(move[:3])), float(np.linalg.norm(move[3:])) / lever
        if iteration > 200 and (shift > LOST or turn > TURNED):
            return None
        short = float(np.linalg.norm(g_rows @ z.reshape(-1) - target)) / size
        if short <= TOLERANCE and change <= TOLERANCE * max(float(np.abs(z).max()), 1e-300):
            break
    shift, turn = float(np.linalg.norm(move[:3])), float(np.linalg.norm(move[3:])) / lever
    short = float(np.linalg.norm(g_rows @ z.reshape(-1) - target)) / size
    if short > 100.0 * TOLERANCE or shift > LOST or turn > TURNED:
        return None
    moved = -g_rows.T @ move
    w = np.concatenate([g.matrix @ z.reshape(-1)[p] for g, p in zip(grips, parts, strict=True)])
    residual = natural_residual(z, (w + b + moved).reshape(-1, 3), normals, mu, 1.0 / rho)
    held, scaled_w, shifts = ([whole.reshape(-1)[p].reshape(-1, 3) for p in parts] for whole in (z, y, moved))
    return Balance(held, scaled_w, shifts, move * scale, residual, iteration)

"""Forward kinematics of a 3-RRS platform: the pose that servo angles hold it in, by a guarded Newton iteration.

With a servo's angle q its knee stands still, and the rod says all there is to say of its leg:

    |(r, h) - L1 (cos q, sin q)|^2 = L2^2

which is smooth at any pose, where the servo's angle of a pose is not: its slope grows without bound as the leg
stretches. The determinant of the three rods' slopes is the singularity margin but for its scale.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import DermisError
from .linkage import Linkage

TOLERANCE = 1e-13  # of the platform's radius, or radians, that a last step is at most
STEPS = 40
LONGEST = 0.25  # [rad] of tilt, or of distance over the platform's radius: longer ones jump over singular poses
SHORTEST = 1e-3  # share of a step
FINEST = 1 / 256  # of the way from the start to the angles wanted, where the direct way gets stuck


def configuration(linkage: Linkage, angles: ArrayLike, start: ArrayLike) -> Array:
    """Return the configuration x that servo angles [rad] hold the platform in, on the level pose's side.

    Beyond a singular pose the same angles belong to another pose, which the platform never gets to.

    Args:
        start: a pose on that side, to begin with.

    Raises:
        DermisError: no such configuration was found.
    """
    wanted, x = np.asarray(angles, dtype=np.float64), np.array(start, dtype=np.float64)
    found = _closed(linkage, wanted, x)
    if found is not None and _bent(linkage, wanted, found):
        return found
    first, at, share = linkage.servo_angles(x)[0], 0.0, 0.25
    while at < 1.0 and share >= FINEST:
        to = min(at + share, 1.0)
        found = _closed(linkage, first + to * (wanted - first), x)
        if found is None:
            share /= 2
        else:
            at, x, share = to, found, 2 * share
    if at < 1.0 or not _bent(linkage, wanted, x):
        raise DermisError("no pose of the platform has these servo angles", where="thimble", value=wanted.tolist())
    return x


def _bent(linkage: Linkage, angles: Array, x: Array) -> bool:
    """Return whether all knees point to their side; on the other one a leg closes too."""
    planes = linkage.leg_planes(linkage.pose(x))
    sides = (h * np.cos(q) - r * np.sin(q) for (r, h, _, _), q in zip(planes, angles.tolist(), strict=True))
    return all(linkage.bend * side > 0.0 for side in sides)


def _rods(linkage: Linkage, angles: Array, x: Array) -> tuple[Array, Array]:
    """Return by how much each rod would have to be longer, over the platform's radius, shape (3,), and the slopes."""
    size, rod = linkage.platform_radius, linkage.rod
    miss, slopes = [], []
    for (r, h, dr, dh), q in zip(linkage.leg_planes(linkage.pose(x)), angles.tolist(), strict=True):
        out, rise = r - linkage.crank * np.cos(q), h - linkage.crank * np.sin(q)
        miss.append((out * out + rise * rise - rod * rod) / (2 * rod * size))
        slopes.append([(out * a + rise * b) / (rod * size) for a, b in zip(dr, dh, strict=True)])
    scaled: Array = np.array(slopes) * [1.0, 1.0, size]
    return np.array(miss), scaled


def _closed(linkage: Linkage, angles: Array, x: Array) -> Array | None:
    """Return the configuration near x at which the rods fit; None where the way there is barred."""
    scale = np.array([1.0, 1.0, linkage.platform_radius])  # keeps tilt and distance alike
    miss, slopes = _rods(linkage, angles, x)
    for _ in range(STEPS):
        if not linkage.side * np.linalg.det(slopes) > 0.0:
            return None
        step = np.asarray(np.linalg.solve(slopes, -miss), np.float64)
        longest = float(np.abs(step).max())
        if longest <= TOLERANCE:
            return x + scale * step
        share = min(1.0, LONGEST / longest)
        while share > SHORTEST:
            trial = x + share * scale * step
            left, there = _rods(linkage, angles, trial)
            if left @ left < miss @ miss and linkage.side * np.linalg.det(there) > 0.0:
                break
            share /= 2
        else:
            return x if longest <= 100 * TOLERANCE else None
        x, miss, slopes = trial, left, there
    return None

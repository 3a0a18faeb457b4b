"""Forward kinematics of a 3-RRS platform by Newton's method.

The pose is computed from the servo angles. For a servo angle q, the position of the knee is known, and the length L2 of
the rod gives one equation for each leg:

    |(r, h) - L1 (cos q, sin q)|^2 = L2^2

Here L1 is the length of the crank, and (r, h) is the position of the joint at the platform, see `Linkage.leg_planes`.
This equation is smooth at every pose. The servo angle as a function of the pose is not smooth: its derivative grows
without bound as the leg stretches. The determinant of the derivatives of the three equations is the singularity margin
up to a factor.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import DermisError
from .linkage import Linkage

# Steps are measured by their largest component: tilt [rad], or distance divided by the platform's radius.
TOLERANCE = 1e-13  # step at which the iteration ends
STEPS = 40  # largest number of steps
LONGEST = 0.25  # longest step; a longer one could jump over a singular pose
SHORTEST = 1e-3  # smallest fraction of a step that is tried
# If the direct iteration fails, the servo angles are changed in parts, from the angles at the start to the wanted
# angles. This is the smallest part.
FINEST = 1 / 256


def configuration(linkage: Linkage, angles: ArrayLike, start: ArrayLike) -> Array:
    """Return the configuration of the platform for servo angles, shape (3,).

    The configuration is on the same side of the singular poses as the level pose. Beyond a singular pose, the same
    angles belong to another pose, which the platform cannot reach.

    Args:
        linkage: links of the platform.
        angles: servo angles [rad], shape (3,).
        start: configuration from which the search starts, on the same side as the level pose, shape (3,).

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
    """Return whether all knees point to the side of `Linkage.bend`.

    The equations of the rods also have solutions with knees on the other side.
    """
    planes = linkage.leg_planes(linkage.pose(x))
    sides = (h * np.cos(q) - r * np.sin(q) for (r, h, _, _), q in zip(planes, angles.tolist(), strict=True))
    return all(linkage.bend * side > 0.0 for side in sides)


def _rods(linkage: Linkage, angles: Array, x: Array) -> tuple[Array, Array]:
    """Return the residuals of the rods' equations and their derivatives.

    A residual is, to first order, the missing length of a rod, divided by the platform's radius. The derivatives are
    with respect to the tilt and to the distance divided by this radius. The shapes are (3,) and (3, 3).

    Args:
        linkage: links of the platform.
        angles: servo angles [rad], shape (3,).
        x: configuration, shape (3,).
    """
    size, rod = linkage.platform_radius, linkage.rod
    miss, slopes = [], []
    for (r, h, dr, dh), q in zip(linkage.leg_planes(linkage.pose(x)), angles.tolist(), strict=True):
        out, rise = r - linkage.crank * np.cos(q), h - linkage.crank * np.sin(q)
        miss.append((out * out + rise * rise - rod * rod) / (2 * rod * size))
        slopes.append([(out * a + rise * b) / (rod * size) for a, b in zip(dr, dh, strict=True)])
    scaled: Array = np.array(slopes) * [1.0, 1.0, size]
    return np.array(miss), scaled


def _closed(linkage: Linkage, angles: Array, x: Array) -> Array | None:
    """Solve the rods' equations by a damped Newton method.

    Return the configuration, shape (3,), or None if the method does not converge from the start x.
    """
    scale = np.array([1.0, 1.0, linkage.platform_radius])  # makes tilt and distance comparable
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

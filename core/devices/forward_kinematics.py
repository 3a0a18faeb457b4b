"""Forward kinematics of a 3-RRS platform: the pose that servo angles hold it in, by a guarded Newton iteration."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import DermisError
from .inverse_kinematics import inverse_kinematics
from .linkage import Linkage

TOLERANCE = 1e-13  # [rad] of the servo angles
STEPS = 80
LONGEST = 0.25  # [rad] of tilt, or of distance over the platform's radius: longer ones jump over where the legs end
SHORTEST = 1e-6  # share of a step
WAYPOINTS = 12  # between the start and the angles wanted, where the direct way gets stuck


def configuration(linkage: Linkage, angles: ArrayLike, start: ArrayLike) -> Array:
    """Return the configuration x that servo angles [rad] hold the platform in, on the level pose's side.

    Beyond a singular pose the same angles belong to another pose, which the platform never gets to.

    Args:
        start: a pose on that side, to begin with.

    Raises:
        DermisError: no such configuration was found.
    """
    wanted, x = np.asarray(angles, dtype=np.float64), np.array(start, dtype=np.float64)
    found = _newton(linkage, wanted, x)
    if found is None:
        at, first = x, linkage.servo_angles(x)[0]
        for share in np.linspace(0.0, 1.0, WAYPOINTS + 1)[1:].tolist():
            found = _newton(linkage, first + share * (wanted - first), at)
            at = at if found is None else found
    if found is None:
        raise DermisError("no pose of the platform has these servo angles", where="thimble", value=wanted.tolist())
    return found


def _reached(linkage: Linkage, x: Array) -> Array | None:
    """Return the servo angles of a configuration; None where a leg does not reach, or beyond a singular pose."""
    if not (linkage.leg_margins(x) > 0).all():
        return None
    try:
        beyond = inverse_kinematics(linkage, *x.tolist())[1] <= 0.0
        return None if beyond else linkage.servo_angles(x)[0]
    except DermisError:  # all but stretched, where margin and reach disagree in the last digits
        return None


def _newton(linkage: Linkage, wanted: Array, x: Array) -> Array | None:
    """Return the configuration nearest to x; None where the way there is barred."""
    scale = np.array([1.0, 1.0, linkage.platform_radius])  # keeps tilt and distance alike
    for _ in range(STEPS):
        now, slopes = linkage.servo_angles(x)
        miss = wanted - now
        if np.abs(miss).max() <= TOLERANCE:
            return x
        step: Array = np.linalg.solve(slopes * scale, miss)
        share = min(1.0, LONGEST / float(np.abs(step).max()))
        while share > SHORTEST:
            trial = x + share * scale * step
            angles = _reached(linkage, trial)
            if angles is not None and (left := wanted - angles) @ left < miss @ miss:
                break
            share /= 2
        else:
            break
        x = trial
    return x if np.abs(wanted - linkage.servo_angles(x)[0]).max() <= 100 * TOLERANCE else None

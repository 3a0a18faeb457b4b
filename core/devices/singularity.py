"""Singularity margin of a 3-RRS platform, and its derivative.

At a singular pose, the platform can move although all three servos are held, because the constraints of the rods are
linearly dependent. Singular poses are within the servos' range, at tilts of 30 degrees and more. A device must stay on
the same side of the singular poses as its level pose.

The joint of a leg on the platform lies r outwards of its servo and h above it, see `inverse_kinematics`. A movement of
the platform changes the length of a rod with unit direction l by l . d(r, h). The margin is the determinant of these
changes for the three rods, scaled to be 1 for a level platform on upright rods.

Source: [S0] 3.1, with its kinematics replaced by a closed form of the 3-RRS, see `core/THEORY.md`; Gosselin and Angeles
1990 for the kind of singularity
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Array
from .inverse_kinematics import UPRIGHT, inverse_kinematics
from .linkage import LEGS, Linkage


def singularity_margin(linkage: Linkage, pitch: float, roll: float, distance: float) -> tuple[float, Array]:
    """Return the singularity margin of a configuration and its derivative.

    The derivative is with respect to the configuration, shape (3,).

    Args:
        linkage: links of the platform.
        pitch, roll: tilt of the platform [rad].
        distance: distance of the platform from the base [m].

    Raises:
        DermisError: a leg cannot reach the platform.
    """
    angles, _ = inverse_kinematics(linkage, pitch, roll, distance)
    cp, sp, cr, sr = math.cos(pitch), math.sin(pitch), math.cos(roll), math.sin(roll)
    ex, ey = np.array(LEGS).T
    angle, size = np.array(angles) + linkage.servo_zero, linkage.platform_radius
    # First and second derivatives of a_z and of m with respect to (pitch, roll, distance / rp), one row for each leg.
    # Lengths are divided by rp.
    az, az_1 = cp * cr, np.array([-sp * cr, -cp * sr, 0.0])
    az_2 = np.array([[-cp * cr, sp * sr, 0.0], [sp * sr, -cp * cr, 0.0], [0.0, 0.0, 0.0]])
    m, none = sr * ex - sp * cr * ey, np.zeros(3)
    m_1 = np.stack([-cp * cr * ey, cr * ex + sp * sr * ey, none], axis=1)
    mixed = cp * sr * ey
    m_2 = np.array([[sp * cr * ey, mixed, none], [mixed, sp * cr * ey - sr * ex, none], [none, none, none]])
    m_2 = m_2.transpose(2, 0, 1)
    k, mm = 1.0 / (1.0 + az), m[:, None, None]
    crossed = m_1[:, :, None] * az_1
    r_1 = -az_1 / 2 - 4 * k * m[:, None] * m_1 + 2 * k**2 * m[:, None] ** 2 * az_1
    r_2 = (
        -az_2 / 2
        - 4 * k * (m_1[:, :, None] * m_1[:, None, :] + mm * m_2)
        + 4 * k**2 * mm * (crossed + crossed.transpose(0, 2, 1))
        - 4 * k**3 * mm**2 * np.outer(az_1, az_1)
        + 2 * k**2 * mm**2 * az_2
    )
    h_1, h_2 = -m_1 + [0.0, 0.0, 1.0], -m_2
    r, h = 1.5 - az / 2 - 2 * k * m**2 - linkage.base_radius / size, distance / size - m
    crank, rod = linkage.crank / size, linkage.rod / size
    sine, cosine = np.sin(angle), np.cos(angle)
    out, rise = (r - crank * cosine) / rod, (h - crank * sine) / rod
    answer = out[:, None] * r_1 + rise[:, None] * h_1  # change of each rod's length by each movement
    q_1 = answer / (crank * (rise * cosine - out * sine))[:, None]
    out_1, rise_1 = (r_1 + crank * sine[:, None] * q_1) / rod, (h_1 - crank * cosine[:, None] * q_1) / rod
    answer_1 = (
        r_1[:, :, None] * out_1[:, None, :]
        + h_1[:, :, None] * rise_1[:, None, :]
        + out[:, None, None] * r_2
        + rise[:, None, None] * h_2
    )
    a, b, c = answer
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)])
    slope = np.einsum("ij,ijk->k", cofactors, answer_1) * [1.0, 1.0, 1.0 / size]
    share = linkage.side / UPRIGHT
    return float(a @ cofactors[0]) * share, slope * share

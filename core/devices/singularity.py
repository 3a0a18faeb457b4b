"""Singularity margin: how far a 3-RRS platform is from giving way although all three servos are held.

Where the rods' grip on the platform loses rank, one set of servo angles belongs to two poses at once, and the platform
moves freely from one towards the other. Such singular poses lie within the servos' range, at 30 degrees of tilt and
more; a device must stay on the side of its level pose.

A leg's joint stands at r outwards of its servo and at height h. With the platform's normal a, which turns it without
torsion, and m = a.e of the leg's direction e:

    r = rp (3/2 - a_z / 2 - 2 m^2 / (1 + a_z)) - rb        h = z - rp m

The rod of unit direction l feels a movement of the platform through l . d(r, h); the margin is the determinant of the
three legs' answers, 1 for a level platform on upright rods.

Source: [S0] 3.1 with the kinematics of the project's corrections; Gosselin and Angeles 1990 for the kind of singularity
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from .linkage import LEGS, Linkage

UPRIGHT = 1.5 * math.sqrt(3.0)  # the determinant of a level platform on upright rods


def inverse_kinematics(linkage: Linkage, psi: float, theta: float, z: float) -> tuple[list[float], float]:
    """Return the servos' angles from neutral [rad] and the singularity margin, as plain numbers.

    Raises:
        DermisError: a leg cannot reach.
    """
    cp, sp, ct, st = math.cos(psi), math.sin(psi), math.cos(theta), math.sin(theta)
    up, up_psi, up_theta = cp * ct, -sp * ct, -cp * st
    across, turn = 1.0 / (1.0 + up), sp * st
    size, base, knee = linkage.platform_radius, linkage.base_radius, linkage.knee
    crank, rod = linkage.crank, linkage.rod
    fixed, double = crank * crank - rod * rod, 2.0 * crank
    angles: list[float] = []
    rows = []
    for ex, ey in LEGS:
        m, m_psi, m_theta = st * ex + up_psi * ey, -up * ey, ct * ex + turn * ey
        bent = 2.0 * m * across
        r, h = size * (1.5 - 0.5 * up - bent * m) - base, z - size * m
        squared = r * r + h * h
        cosine = (fixed + squared) / (double * math.sqrt(squared))
        if abs(cosine) >= 1.0:
            raise DermisError("a leg cannot reach the platform", where=f"thimble, leg {len(angles) + 1}")
        angle = math.atan2(h, r) - knee * math.acos(cosine)
        angles.append(angle - linkage.servo_zero)
        out, rise = r - crank * math.cos(angle), h - crank * math.sin(angle)  # the rod, of length L2
        curve = bent * m * across - 0.5
        rows.append(
            (
                out * (curve * up_psi - 2.0 * bent * m_psi) - rise * m_psi,
                out * (curve * up_theta - 2.0 * bent * m_theta) - rise * m_theta,
                rise,
            )
        )
    (a, b, c), (d, e, f), (g, i, j) = rows
    volume = a * (e * j - f * i) - b * (d * j - f * g) + c * (d * i - e * g)
    return angles, linkage.side * volume / (UPRIGHT * rod * rod * rod)


def singularity_margin(linkage: Linkage, psi: float, theta: float, z: float) -> tuple[float, Array]:
    """Return the singularity margin of a pose and its derivative by (psi, theta, z), shape (3,).

    Raises:
        DermisError: a leg cannot reach.
    """
    turned, _ = inverse_kinematics(linkage, psi, theta, z)
    cp, sp, ct, st = math.cos(psi), math.sin(psi), math.cos(theta), math.sin(theta)
    ex, ey = np.array(LEGS).T
    angle, size = np.array(turned) + linkage.servo_zero, linkage.platform_radius
    # by (psi, theta, z / rp); lengths over rp. First and second derivatives of a_z and of m, one row a leg
    az, az_1 = cp * ct, np.array([-sp * ct, -cp * st, 0.0])
    az_2 = np.array([[-cp * ct, sp * st, 0.0], [sp * st, -cp * ct, 0.0], [0.0, 0.0, 0.0]])
    m, none = st * ex - sp * ct * ey, np.zeros(3)
    m_1 = np.stack([-cp * ct * ey, ct * ex + sp * st * ey, none], axis=1)
    mixed = cp * st * ey
    m_2 = np.array([[sp * ct * ey, mixed, none], [mixed, sp * ct * ey - st * ex, none], [none, none, none]])
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
    r, h = 1.5 - az / 2 - 2 * k * m**2 - linkage.base_radius / size, z / size - m
    crank, rod = linkage.crank / size, linkage.rod / size
    sine, cosine = np.sin(angle), np.cos(angle)
    out, rise = (r - crank * cosine) / rod, (h - crank * sine) / rod
    answer = out[:, None] * r_1 + rise[:, None] * h_1  # of each rod to each movement
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

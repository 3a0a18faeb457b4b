"""Inverse kinematics of a 3-RRS platform, with the singularity margin.

The servo angles are computed from a configuration. The joint of a leg on the platform lies r outwards of its servo and
h above it. The platform is at a distance d from the base, has the normal a and turns without torsion. With m = a.e for
the direction e of the leg, and the radii rp of the platform and rb of the base:

    r = rp (3/2 - a_z / 2 - 2 m^2 / (1 + a_z)) - rb        h = d - rp m

At a singular pose, the platform can move although all three servos are held, because the constraints of the rods are
linearly dependent. Singular poses are within the servos' range, at tilts of 30 degrees and more. A device must stay on
the same side of the singular poses as its level pose. A movement of the platform changes the length of a rod with unit
direction l by l . d(r, h). The margin is the determinant of these changes for the three rods, scaled to be 1 for a
level platform on upright rods. The search of the kernels (`core/kernels/search.c`) has its derivative, too.

Source: [S0] 3.1; its kinematics are replaced by a closed form of the 3-RRS, see `core/THEORY.md`; Gosselin and Angeles
1990 for the kind of singularity
"""

from __future__ import annotations

import math

from ..errors import DermisError
from .linkage import LEGS, Linkage

# Largest absolute cosine of the angle between a crank and the line from its servo to the joint on the platform. The
# leg is then 0.08 degrees from stretched or folded. Closer to these, a turn of the servo hardly moves the platform, and
# the derivative of the servo's angle with respect to the pose grows without bound.
BENT = 1.0 - 1e-6
# Determinant for a level platform on upright rods of length 1. The margin is the determinant as a share of it.
UPRIGHT = 1.5 * math.sqrt(3.0)


def inverse_kinematics(linkage: Linkage, pitch: float, roll: float, distance: float) -> tuple[list[float], float]:
    """Return the angles of the servos and the singularity margin.

    All numbers are Python floats. The angles are counted from neutral [rad].

    Args:
        linkage: links of the platform.
        pitch, roll: tilt of the platform [rad].
        distance: distance of the platform from the base [m].

    Raises:
        DermisError: a leg cannot reach the platform, or is nearly stretched or folded.
    """
    cp, sp, cr, sr = math.cos(pitch), math.sin(pitch), math.cos(roll), math.sin(roll)
    up, up_pitch, up_roll = cp * cr, -sp * cr, -cp * sr
    across, turn = 1.0 / (1.0 + up), sp * sr
    size, base, bend = linkage.platform_radius, linkage.base_radius, linkage.bend
    crank, rod = linkage.crank, linkage.rod
    fixed, double = crank * crank - rod * rod, 2.0 * crank
    angles: list[float] = []
    rows = []
    for ex, ey in LEGS:
        m, m_pitch, m_roll = sr * ex + up_pitch * ey, -up * ey, cr * ex + turn * ey
        bent = 2.0 * m * across
        r, h = size * (1.5 - 0.5 * up - bent * m) - base, distance - size * m
        squared = r * r + h * h
        stretched, whole = fixed + squared, double * math.sqrt(squared)
        if abs(stretched) >= BENT * whole:
            raise DermisError("a leg cannot reach the platform", where=f"thimble, leg {len(angles) + 1}")
        angle = math.atan2(h, r) - bend * math.acos(stretched / whole)
        angles.append(angle - linkage.servo_zero)
        out, rise = r - crank * math.cos(angle), h - crank * math.sin(angle)  # vector along the rod, of length `rod`
        curve = bent * m * across - 0.5
        rows.append(
            (
                out * (curve * up_pitch - 2.0 * bent * m_pitch) - rise * m_pitch,
                out * (curve * up_roll - 2.0 * bent * m_roll) - rise * m_roll,
                rise,
            )
        )
    (a, b, c), (d, e, f), (g, i, j) = rows
    volume = a * (e * j - f * i) - b * (d * j - f * g) + c * (d * i - e * g)
    return angles, linkage.side * volume / (UPRIGHT * rod * rod * rod)

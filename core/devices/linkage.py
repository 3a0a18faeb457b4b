"""Linkage of a 3-RRS platform: pose and servo angles of a configuration.

Three identical legs are 120 degrees apart. A leg is a crank of length L1 on a servo, a rod of length L2 and a ball
joint on the platform. Each leg stays in its own vertical plane. This constraint makes the platform shift and yaw when
it tilts. The poses here include this parasitic shift and yaw.

The base frame has its origin at the base's centre and +Z from the base to the platform. A configuration is
x = (pitch, roll, distance): pitch about X, roll about Y, and distance of the platform from the base. The resulting pose
consists of the rotation of the platform and the position of its centre.

Source: [S0] 3.1; its kinematics are replaced by a closed form of the 3-RRS, see `core/THEORY.md`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import DermisError

LEG_ANGLES = np.radians([0.0, 120.0, 240.0])
LEG_DIRECTIONS = np.column_stack([np.cos(LEG_ANGLES), np.sin(LEG_ANGLES), np.zeros(3)])
LEGS = tuple((math.cos(a), math.sin(a)) for a in (0.0, 2 * math.pi / 3, 4 * math.pi / 3))


@dataclass(frozen=True)
class PlatformPose:
    """Pose of a platform in the base frame, with its derivatives.

    The derivatives are with respect to the configuration.

    Attributes:
        rotation: rotation from the platform's frame to the base's, shape (3, 3).
        centre: position of the platform's centre [m], shape (3,).
        spin: derivative of the rotation; row i is for x_i: dR/dx_i = spin_i x R, shape (n, 3).
        d_centre: derivative of the centre; column i is for x_i, shape (3, n).
        x: the configuration, which begins with pitch, roll and distance, shape (n,).
    """

    rotation: Array
    centre: Array
    spin: Array
    d_centre: Array
    x: Array


@dataclass(frozen=True)
class Linkage:
    """Dimensions of a 3-RRS platform.

    Attributes:
        platform_radius, base_radius: radii of the circles of joints [m].
        crank, rod: lengths L1 and L2 [m].
        servo_zero: servo angle at neutral [rad].
        bend: +1 if the legs' knees point outwards, -1 if inwards.
        side: +1 if the level platform hangs on its rods, -1 if it stands on them. The singularity margin is multiplied
            by this sign, which makes it positive for the level platform.
    """

    platform_radius: float
    base_radius: float
    crank: float
    rod: float
    servo_zero: float
    bend: float
    side: float = field(default=1.0, kw_only=True)

    def pose(self, x: ArrayLike) -> PlatformPose:
        """Return the pose of the platform at x = (pitch, roll, distance).

        It includes the parasitic shift and yaw.
        """
        # Python floats are faster here than NumPy arrays of three elements.
        at = np.array(x, dtype=np.float64)
        pitch, roll, distance = at.tolist()
        cp, sp, cr, sr = math.cos(pitch), math.sin(pitch), math.cos(roll), math.sin(roll)
        n, d = -sp * sr, cp + cr
        yaw = math.atan2(n, d)
        scale = 1.0 / (n * n + d * d)
        yaw_pitch = (d * -cp * sr + n * sp) * scale
        yaw_roll = (d * -sp * cr + n * sr) * scale
        c, s = math.cos(yaw), math.sin(yaw)
        axis = (sr, -sp * cr, cp * cr)  # the platform's normal, about which yaw turns
        first, second = (cr, sp * sr, -cp * sr), (0.0, cp, sp)
        u = [c * a + s * b for a, b in zip(first, second, strict=True)]
        v = [c * b - s * a for a, b in zip(first, second, strict=True)]
        spin = (
            (1.0 + yaw_pitch * axis[0], yaw_pitch * axis[1], yaw_pitch * axis[2]),
            (yaw_roll * axis[0], cp + yaw_roll * axis[1], sp + yaw_roll * axis[2]),
            (0.0, 0.0, 0.0),
        )
        r = self.platform_radius
        shift_x, shift_y = [], []
        for wx, wy, wz in spin:
            shift_x.append(r / 2 * (wy * u[2] - wz * u[1] - wz * v[0] + wx * v[2]))
            shift_y.append(-r * (wz * u[0] - wx * u[2]))
        return PlatformPose(
            np.array([[u[0], v[0], axis[0]], [u[1], v[1], axis[1]], [u[2], v[2], axis[2]]]),
            np.array([r / 2 * (u[0] - v[1]), -r * u[1], distance]),
            np.array(spin),
            np.array([shift_x, shift_y, [0.0, 0.0, 1.0]]),
            at,
        )

    def servo_angles(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return the servo angles and their derivatives.

        The angles [rad] have the shape (3,), their derivatives with respect to x the shape (3, 3).

        Raises:
            DermisError: a leg cannot reach the platform.
        """
        angles, slopes = self.angles_from_neutral(self.pose(x))
        return np.array(angles) + self.servo_zero, np.array(slopes)

    def angles_from_neutral(self, pose: PlatformPose) -> tuple[list[float], list[list[float]]]:
        """Return the angles of the servos at a pose, and their derivatives.

        They are Python floats. The angles are counted from neutral [rad]. The derivatives are with respect to x.

        Raises:
            DermisError: a leg cannot reach the platform.
        """
        angles, slopes = [], []
        crank, rod = self.crank, self.rod
        for leg, (r, h, dr, dh) in enumerate(self.leg_planes(pose)):
            squared = r * r + h * h
            distance = math.sqrt(squared)
            stretched, whole = crank * crank + squared - rod * rod, 2 * crank * distance
            if abs(stretched) >= whole:
                raise DermisError(
                    "a leg cannot reach the platform",
                    where=f"thimble, leg {leg + 1}",
                    value=f"{1e3 * distance:.2f} mm from its servo",
                    limit=f"{1e3 * abs(rod - crank):.2f} to {1e3 * (rod + crank):.2f} mm",
                    remedy="Use longer links or a smaller movement",
                )
            cosine = stretched / whole
            angles.append(math.atan2(h, r) - self.bend * math.acos(cosine) - self.servo_zero)
            slope = self.bend * (squared - crank * crank + rod * rod) / (2 * crank * squared)
            slope /= distance * math.sqrt(1.0 - cosine * cosine)
            # d atan2 = (r dh - h dr) / d^2, and the angle of the knee depends on d, with d' = (r dr + h dh) / d.
            by_r, by_h = slope * r - h / squared, slope * h + r / squared
            slopes.append([by_r * a + by_h * b for a, b in zip(dr, dh, strict=True)])
        return angles, slopes

    def leg_planes(self, pose: PlatformPose) -> list[tuple[float, float, list[float], list[float]]]:
        """Return the joint of each leg in the leg's plane.

        Returns:
            For each leg: distance r outwards of the servo [m], height h [m], and the derivatives of both with respect
            to x.
        """
        (ux, vx, _), (uy, vy, _), (uz, vz, _) = pose.rotation.tolist()
        x, y, z = pose.centre.tolist()
        shifts, spins = pose.d_centre.tolist(), pose.spin.tolist()
        size, legs = self.platform_radius, []
        for ex, ey in LEGS:
            ax, ay, az = size * (ux * ex + vx * ey), size * (uy * ex + vy * ey), size * (uz * ex + vz * ey)
            dr, dh = [], []
            for j, (wx, wy, wz) in enumerate(spins):
                dr.append(ex * (shifts[0][j] + wy * az - wz * ay) + ey * (shifts[1][j] + wz * ax - wx * az))
                dh.append(shifts[2][j] + wx * ay - wy * ax)
            legs.append((ex * (x + ax) + ey * (y + ay) - self.base_radius, z + az, dr, dh))
        return legs

"""Thimble 3-RRS: a disc under the finger pad, pitched, rolled and pressed by three servos above the nail.

Three identical legs stand 120 degrees apart. Each is a crank of length L1 on a servo, a rod of length L2 and a ball
joint on the platform, and stays in its own vertical plane. That constraint makes the platform shift and yaw when it
tilts; both are part of its pose here.

The base frame has its origin at the base's centre and +Z from the base to the platform. A configuration is
x = (psi, theta, z): pitch about X, roll about Y, distance of the platform from the base.

Source: [S0] 3.1 with the kinematics of the project's corrections (closed form of the 3-RRS).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import DermisError
from .firmness import LEGS, firmness, posture
from .forward_kinematics import configuration
from .servo_limits import servo_bounds, servo_speed
from .spec import DeviceSpec

Array = NDArray[np.float64]

LEG_ANGLES = np.radians([0.0, 120.0, 240.0])
LEG_DIRECTIONS = np.column_stack([np.cos(LEG_ANGLES), np.sin(LEG_ANGLES), np.zeros(3)])
FIRM = 0.03  # least firmness: there a servo's error turns the platform some 15 times as far, and beyond it gives way


@dataclass(frozen=True)
class PlatformPose:
    """Pose of the platform in the base frame, with its derivatives by (psi, theta, z).

    Attributes:
        rotation: shape (3, 3). centre: [m], shape (3,).
        spin: how it turns: dR/dx_i = spin_i x R, row i, shape (3, 3). d_centre: column i, shape (3, 3).
    """

    rotation: Array
    centre: Array
    spin: Array
    d_centre: Array


@dataclass(frozen=True)
class Thimble:
    """The mechanism.

    Attributes:
        platform_radius, base_radius: of the joints' circles [m].
        crank, rod: L1 and L2 [m].
        servo_zero: servo angle at neutral [rad]. servo_range: allowed to either side [rad].
        servo_speed: [rad/s].
        knee: +1 where the crank points outwards, -1 inwards.
        disc_radius: of the surface that touches the skin [m].
        mount: base frame in the finger's frame, shape (4, 4).
        pulse_neutral, pulse_gain: pulse width at neutral [s] and its change [s/rad].
        side: +1 where the level platform hangs on its rods, -1 where it stands on them: the sign of the determinant.
        bounds: lowest and highest angle from neutral of every servo [rad], shape (2, 3), where its channel is narrower
            than the range; None where none is.
    """

    platform_radius: float
    base_radius: float
    crank: float
    rod: float
    servo_zero: float
    servo_range: float
    servo_speed: float
    knee: float
    disc_radius: float
    mount: Array
    pulse_neutral: float
    pulse_gain: float
    side: float = 1.0
    bounds: Array | None = None

    @property
    def servo_limits(self) -> tuple[Array, Array]:
        """Lowest and highest angle of every servo from neutral [rad], shape (3,) each."""
        if self.bounds is None:
            return np.full(3, -self.servo_range), np.full(3, self.servo_range)
        return self.bounds[0], self.bounds[1]

    def pose(self, x: ArrayLike) -> PlatformPose:
        """Return the platform's pose at x = (psi, theta, z), with parasitic shift and yaw."""
        # plain floats: arrays of three elements cost more than the arithmetic on them
        psi, theta, z = np.asarray(x, dtype=np.float64).tolist()
        cp, sp, ct, st = math.cos(psi), math.sin(psi), math.cos(theta), math.sin(theta)
        n, d = -sp * st, cp + ct
        phi = math.atan2(n, d)
        scale = 1.0 / (n * n + d * d)
        phi_psi = (d * -cp * st + n * sp) * scale
        phi_theta = (d * -sp * ct + n * st) * scale
        c, s = math.cos(phi), math.sin(phi)
        axis = (st, -sp * ct, cp * ct)  # the platform's normal, which yaw turns about
        first, second = (ct, sp * st, -cp * st), (0.0, cp, sp)
        u = [c * a + s * b for a, b in zip(first, second, strict=True)]
        v = [c * b - s * a for a, b in zip(first, second, strict=True)]
        spin = (
            (1.0 + phi_psi * axis[0], phi_psi * axis[1], phi_psi * axis[2]),
            (phi_theta * axis[0], cp + phi_theta * axis[1], sp + phi_theta * axis[2]),
            (0.0, 0.0, 0.0),
        )
        r = self.platform_radius
        shift_x, shift_y = [], []
        for wx, wy, wz in spin:
            shift_x.append(r / 2 * (wy * u[2] - wz * u[1] - wz * v[0] + wx * v[2]))
            shift_y.append(-r * (wz * u[0] - wx * u[2]))
        return PlatformPose(
            np.array([[u[0], v[0], axis[0]], [u[1], v[1], axis[1]], [u[2], v[2], axis[2]]]),
            np.array([r / 2 * (u[0] - v[1]), -r * u[1], z]),
            np.array(spin),
            np.array([shift_x, shift_y, [0.0, 0.0, 1.0]]),
        )

    def reach(self, x: ArrayLike) -> Array:
        """Return per leg how far it is from being stretched or folded: >= 0 where it closes, shape (3,)."""
        legs = self._leg_planes(self.pose(x))
        distance = np.array([math.hypot(r, h) for r, h, _, _ in legs])
        return 1.0 - np.abs((self.crank**2 + distance**2 - self.rod**2) / (2 * self.crank * distance))

    def servo_angles(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return servo angles [rad], shape (3,), and their derivatives by x, shape (3, 3).

        Raises:
            DermisError: a leg cannot reach.
        """
        turns, slopes = self.servo_turns(self.pose(x))
        return np.array(turns) + self.servo_zero, np.array(slopes)

    def servo_turns(self, pose: PlatformPose) -> tuple[list[float], list[list[float]]]:
        """Return the servos' angles from neutral [rad] at a pose, and their derivatives, as plain numbers."""
        angles, slopes = [], []
        crank, rod = self.crank, self.rod
        for leg, (r, h, dr, dh) in enumerate(self._leg_planes(pose)):
            squared = r * r + h * h
            distance = math.sqrt(squared)
            cosine = (crank * crank + squared - rod * rod) / (2 * crank * distance)
            if abs(cosine) >= 1.0:
                raise DermisError(
                    "a leg cannot reach the platform",
                    where=f"thimble, leg {leg + 1}",
                    value=f"{1e3 * distance:.2f} mm from its servo",
                    limit=f"{1e3 * abs(rod - crank):.2f} to {1e3 * (rod + crank):.2f} mm",
                    remedy="Use longer links or a smaller movement",
                )
            angles.append(math.atan2(h, r) - self.knee * math.acos(cosine) - self.servo_zero)
            bend = self.knee * (squared - crank * crank + rod * rod) / (2 * crank * squared)
            bend /= distance * math.sqrt(1.0 - cosine * cosine)
            # d atan2 = (r dh - h dr) / d^2, and the knee bends with the distance, d' = (r dr + h dh) / d
            by_r, by_h = bend * r - h / squared, bend * h + r / squared
            slopes.append([by_r * a + by_h * b for a, b in zip(dr, dh, strict=True)])
        return angles, slopes

    def turns(self, psi: float, theta: float, z: float) -> list[float]:
        """Return the servos' angles from neutral [rad] as plain numbers, for those who try many configurations.

        Raises:
            DermisError: a leg cannot reach.
        """
        return posture(self, psi, theta, z)[0]

    def constraints(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return c(x) >= 0, shape (7,), and dc/dx, shape (7, 3).

        The first six are the room left of each servo to either side [rad], the last how far the platform is from the
        least firmness.

        Raises:
            DermisError: a leg cannot reach.
        """
        return self.constraints_within(x, *self.servo_limits)

    def constraints_within(self, x: ArrayLike, low: Array, high: Array) -> tuple[Array, Array]:
        """Return `constraints` for other limits of the servos' angles from neutral [rad], shape (3,) each."""
        at = np.asarray(x, dtype=np.float64)
        turned, slopes = self.servo_turns(self.pose(at))
        firm, softer = firmness(self, *at.tolist())
        angles, by_x = np.array(turned), np.array(slopes)
        return np.concatenate([high - angles, angles - low, [firm - FIRM]]), np.vstack([-by_x, by_x, softer])

    def feasible(self, x: ArrayLike) -> bool:
        """Tell whether the legs reach, the servos stay within their range, and hold the platform firmly."""
        low, high = self.servo_limits
        psi, theta, z = np.asarray(x, dtype=np.float64).tolist()
        return self.within(psi, theta, z, low.tolist(), high.tolist())

    def within(self, psi: float, theta: float, z: float, low: list[float], high: list[float]) -> bool:
        """Tell the same for limits of the servos' angles from neutral [rad]."""
        try:
            turned, firm = posture(self, psi, theta, z)
        except DermisError:
            return False
        return firm >= FIRM and all(a <= t <= b for a, t, b in zip(low, turned, high, strict=True))

    def workspace(self, pitch: ArrayLike, roll: ArrayLike, distance: ArrayLike) -> NDArray[np.bool_]:
        """Tell which of a grid of pitches, rolls [rad] and distances [m] are feasible, shape (a, b, c)."""
        grid = [np.asarray(values, dtype=np.float64).tolist() for values in (pitch, roll, distance)]
        return np.array([[[self.feasible((p, r, z)) for z in grid[2]] for r in grid[1]] for p in grid[0]])

    def forward(self, angles: ArrayLike, start: ArrayLike) -> Array:
        """Return the configuration that servo angles [rad] hold the platform in; see `configuration`.

        Raises:
            DermisError: no such configuration was found.
        """
        return configuration(self, angles, start)

    def pulse_width(self, angles: ArrayLike) -> Array:
        """Return the servos' pulse widths [s] for angles [rad]."""
        return self.pulse_neutral + self.pulse_gain * (np.asarray(angles, dtype=np.float64) - self.servo_zero)

    def in_finger(self, pose: PlatformPose) -> Array:
        """Return the platform's pose in the finger's frame, shape (4, 4)."""
        local = np.eye(4)
        local[:3, :3], local[:3, 3] = pose.rotation, pose.centre
        return self.mount @ local

    def _leg_planes(self, pose: PlatformPose) -> list[tuple[float, float, list[float], list[float]]]:
        """Joints in their legs' planes: distance r outwards of the servo and height h, with slopes by x."""
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


def mechanism(spec: DeviceSpec) -> Thimble:
    """Build the mechanism of a preset; the servos' zero is where the platform is level at `reference_distance`.

    Raises:
        DermisError: a length or limit that is not above zero, links that cannot close at the reference or do not hold
            the platform there, or a channel that leaves its servo no range.
    """
    where = f"device preset '{spec.key}'"
    names = ("platform_radius", "base_radius", "crank", "rod", "servo_range", "servo_speed", "disc_radius")
    sizes: dict[str, Any] = {name: spec.value(name) for name in names}
    reference = spec.value("reference_distance")
    # the base sits above the nail and looks down: its +Z is the finger's -Z, its +Y stays the finger's
    mount = np.diag([-1.0, 1.0, -1.0, 1.0])
    mount[:3, 3] = spec.value("mount_position") or (0.0, 0.0, reference)
    knee = -1.0 if spec.value("knee") == "inwards" else 1.0
    device = Thimble(
        **sizes,
        servo_zero=0.0,
        knee=knee,
        mount=mount,
        pulse_neutral=spec.value("pulse_neutral"),
        pulse_gain=spec.value("pulse_gain"),
    )
    try:
        zero = float(device.servo_angles([0.0, 0.0, reference])[0][0])
        firm = posture(device, 0.0, 0.0, reference)[1]
    except DermisError as error:
        raise DermisError("the links cannot close at the reference distance", where=where, value=str(error)) from error
    if abs(firm) < FIRM:
        raise DermisError(
            "the rods lie too flat to hold the platform at the reference distance",
            where=where,
            value=f"firmness {abs(firm):.3g}",
            limit=f">= {FIRM:g}",
            remedy="Use other link lengths or another distance",
        )
    sizes["servo_speed"] = servo_speed(spec, sizes["servo_speed"])
    bounds = servo_bounds(spec, sizes["servo_range"])
    return replace(device, **sizes, servo_zero=zero, side=math.copysign(1.0, firm), bounds=bounds)

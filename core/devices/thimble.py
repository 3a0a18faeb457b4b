"""Thimble 3-RRS: a disc under the finger pad, pitched, rolled and pressed by three servos above the nail.

Three identical legs stand 120 degrees apart. Each is a crank of length L1 on a servo, a rod of length L2 and a ball
joint on the platform, and stays in its own vertical plane. That constraint makes the platform shift and yaw when it
tilts; both are part of its pose here.

The base frame has its origin at the base's centre and +Z from the base to the platform. A configuration is
x = (psi, theta, z): pitch about X, roll about Y, distance of the platform from the base.

Source: [S0] 3.1 with the kinematics of the project's corrections (closed form of the 3-RRS).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import DermisError
from .spec import DeviceSpec

Array = NDArray[np.float64]

LEG_ANGLES = np.radians([0.0, 120.0, 240.0])
LEG_DIRECTIONS = np.column_stack([np.cos(LEG_ANGLES), np.sin(LEG_ANGLES), np.zeros(3)])
FORWARD_TOLERANCE = 1e-13  # [rad] of the servo angles
FORWARD_STEPS = 50

_KX = np.array([[0.0, 0, 0], [0, 0, -1], [0, 1, 0]])
_KY = np.array([[0.0, 0, 1], [0, 0, 0], [-1, 0, 0]])
_KZ = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 0]])


@dataclass(frozen=True)
class PlatformPose:
    """Pose of the platform in the base frame, with its derivatives by (psi, theta, z).

    Attributes:
        rotation: shape (3, 3). centre: [m], shape (3,).
        d_rotation: derivative i at [i], shape (3, 3, 3). d_centre: column i, shape (3, 3).
    """

    rotation: Array
    centre: Array
    d_rotation: Array
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

    def pose(self, x: ArrayLike) -> PlatformPose:
        """Return the platform's pose at x = (psi, theta, z), with parasitic shift and yaw."""
        psi, theta, z = np.asarray(x, dtype=np.float64)
        cp, sp, ct, st = np.cos(psi), np.sin(psi), np.cos(theta), np.sin(theta)
        n, d = -sp * st, cp + ct
        phi = np.arctan2(n, d)
        scale = 1.0 / (n * n + d * d)
        phi_psi = (d * -cp * st + n * sp) * scale
        phi_theta = (d * -sp * ct + n * st) * scale
        rx = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
        ry = np.array([[ct, 0, st], [0, 1, 0], [-st, 0, ct]])
        c, s = np.cos(phi), np.sin(phi)
        rz = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        rotation = rx @ ry @ rz
        d_rotation = np.zeros((3, 3, 3))
        d_rotation[0] = _KX @ rotation + rotation @ _KZ * phi_psi
        d_rotation[1] = rx @ _KY @ ry @ rz + rotation @ _KZ * phi_theta
        r = self.platform_radius
        centre = np.array([r / 2 * (rotation[0, 0] - rotation[1, 1]), -r * rotation[1, 0], z])
        d_centre = np.zeros((3, 3))
        d_centre[0] = r / 2 * (d_rotation[:, 0, 0] - d_rotation[:, 1, 1])
        d_centre[1] = -r * d_rotation[:, 1, 0]
        d_centre[2, 2] = 1.0
        return PlatformPose(rotation, centre, d_rotation, d_centre)

    def reach(self, x: ArrayLike) -> Array:
        """Return per leg how far it is from being stretched or folded: >= 0 where it closes, shape (3,)."""
        r, h, _, _ = self._leg_planes(self.pose(x))
        d = np.hypot(r, h)
        return 1.0 - np.abs((self.crank**2 + d**2 - self.rod**2) / (2 * self.crank * d))

    def servo_angles(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return servo angles [rad], shape (3,), and their derivatives by x, shape (3, 3).

        Raises:
            DermisError: a leg cannot reach.
        """
        r, h, dr, dh = self._leg_planes(self.pose(x))
        squared = r * r + h * h
        d = np.sqrt(squared)
        cosine = (self.crank**2 + squared - self.rod**2) / (2 * self.crank * d)
        if (np.abs(cosine) >= 1.0).any():
            leg = int(np.argmax(np.abs(cosine)))
            raise DermisError(
                "a leg cannot reach the platform",
                where=f"thimble, leg {leg + 1}",
                value=f"{1e3 * d[leg]:.2f} mm from its servo",
                limit=f"{1e3 * abs(self.rod - self.crank):.2f} to {1e3 * (self.rod + self.crank):.2f} mm",
                remedy="Use longer links or a smaller movement",
            )
        angles = np.arctan2(h, r) - self.knee * np.arccos(cosine)
        d_distance = (r[:, None] * dr + h[:, None] * dh) / d[:, None]
        d_cosine = d_distance * ((squared - self.crank**2 + self.rod**2) / (2 * self.crank * squared))[:, None]
        d_angles = (r[:, None] * dh - h[:, None] * dr) / squared[:, None]
        d_angles += self.knee * d_cosine / np.sqrt(1.0 - cosine**2)[:, None]
        return angles, d_angles

    def constraints(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return c(x) >= 0, the room left of each servo to either side [rad], shape (6,), and dc/dx, shape (6, 3)."""
        angles, slopes = self.servo_angles(x)
        turned = angles - self.servo_zero
        return np.concatenate([self.servo_range - turned, self.servo_range + turned]), np.vstack([-slopes, slopes])

    def feasible(self, x: ArrayLike) -> bool:
        """Tell whether the legs reach and the servos stay within their range."""
        if not (self.reach(x) > 0).all():
            return False
        return bool((self.constraints(x)[0] >= 0).all())

    def forward(self, angles: ArrayLike, start: ArrayLike) -> Array:
        """Return the configuration x that servo angles [rad] hold the platform in, nearest to `start`.

        Raises:
            DermisError: no such configuration was found.
        """
        wanted, x = np.asarray(angles, dtype=np.float64), np.array(start, dtype=np.float64)
        scale = np.array([1.0, 1.0, self.platform_radius])  # keeps tilt and distance alike
        for _ in range(FORWARD_STEPS):
            now, slopes = self.servo_angles(x)
            miss = wanted - now
            if np.abs(miss).max() <= FORWARD_TOLERANCE:
                return x
            step = scale * np.linalg.solve(slopes * scale, miss)
            length = 1.0
            while length > 1e-6:
                trial = x + length * step
                if (self.reach(trial) > 0).all():
                    closer = np.abs(wanted - self.servo_angles(trial)[0]).max()
                    if closer < np.abs(miss).max():
                        break
                length /= 2
            else:
                break
            x = trial
        miss = wanted - self.servo_angles(x)[0]
        if np.abs(miss).max() <= 100 * FORWARD_TOLERANCE:
            return x
        raise DermisError("no pose of the platform has these servo angles", where="thimble", value=wanted.tolist())

    def pulse_width(self, angles: ArrayLike) -> Array:
        """Return the servos' pulse widths [s] for angles [rad]."""
        return self.pulse_neutral + self.pulse_gain * (np.asarray(angles, dtype=np.float64) - self.servo_zero)

    def in_finger(self, pose: PlatformPose) -> Array:
        """Return the platform's pose in the finger's frame, shape (4, 4)."""
        local = np.eye(4)
        local[:3, :3], local[:3, 3] = pose.rotation, pose.centre
        return self.mount @ local

    def _leg_planes(self, pose: PlatformPose) -> tuple[Array, Array, Array, Array]:
        """Joints of the platform in their legs' planes: distance r outwards of the servo and height h, with slopes."""
        arms = self.platform_radius * LEG_DIRECTIONS
        joints = pose.centre + arms @ pose.rotation.T
        slopes = pose.d_centre[None] + np.einsum("iab,lb->lai", pose.d_rotation, arms)  # leg, axis, derivative
        r = np.einsum("la,la->l", LEG_DIRECTIONS, joints) - self.base_radius
        return r, joints[:, 2], np.einsum("la,lai->li", LEG_DIRECTIONS, slopes), slopes[:, 2]


def mechanism(spec: DeviceSpec) -> Thimble:
    """Build the mechanism of a preset; the servos' zero is where the platform is level at `reference_distance`.

    Raises:
        DermisError: a length or limit that is not above zero, or links that cannot close at the reference.
    """
    p, where = spec.parameters, f"device preset '{spec.key}'"
    names = ("platform_radius", "base_radius", "crank", "rod", "servo_range", "servo_speed", "disc_radius")
    sizes = {name: _positive(p, name, where) for name in names}
    reference = _positive(p, "reference_distance", where)
    # the base sits above the nail and looks down: its +Z is the finger's -Z, its +Y stays the finger's
    mount = np.diag([-1.0, 1.0, -1.0, 1.0])
    mount[:3, 3] = np.asarray(p.get("mount_position", [0.0, 0.0, reference]), dtype=np.float64)
    knee = -1.0 if p.get("knee", "outwards") == "inwards" else 1.0
    device = Thimble(
        **sizes,
        servo_zero=0.0,
        knee=knee,
        mount=mount,
        pulse_neutral=float(p.get("pulse_neutral", 1.5e-3)),
        pulse_gain=float(p.get("pulse_gain", 1e-3 / (np.pi / 2))),
    )
    try:
        zero = float(device.servo_angles([0.0, 0.0, reference])[0][0])
    except DermisError as error:
        raise DermisError("the links cannot close at the reference distance", where=where, value=str(error)) from error
    return Thimble(**{**device.__dict__, "servo_zero": zero})


def _positive(p: Mapping[str, Any], name: str, where: str) -> float:
    value = p.get(name)
    if value is None or not value > 0:
        raise DermisError(f"'{name}' must be above zero", where=where, value=value, limit="> 0")
    return float(value)

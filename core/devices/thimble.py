"""Thimble 3-RRS: a disc under the finger pad, moved by three servos.

The servos are above the nail. They pitch and roll the disc and press it into the pad. `Thimble` adds the servos, with
their range and speed, the disc and the mount on the finger to the linkage.

Source: [S0] 3.1; its kinematics are replaced by a closed form of the 3-RRS, see `core/THEORY.md`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from operator import sub
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import DermisError
from .forward_kinematics import configuration
from .inverse_kinematics import inverse_kinematics
from .linkage import Linkage, PlatformPose
from .servo_limits import SERVOS, servo_bounds, servo_speed
from .spec import DeviceSpec

# Least allowed singularity margin. At this margin an error of a servo's angle turns the platform by 15 times the error.
# At a margin of zero the servos do not hold the platform.
MIN_MARGIN = 0.03
# [rad] limit of pitch and roll. If pitch and roll are both beyond the limit, their pose is also that of a pair within
# the limit, but the singularity margin has the opposite sign. So no value beyond the limit is allowed.
QUARTER = math.pi / 2


@dataclass(frozen=True)
class Thimble(Linkage):
    """Mechanism of the thimble: 3-RRS linkage, servos, disc and mount.

    Attributes:
        servo_range: largest angle of a servo to either side of neutral [rad].
        servo_speed: largest speed of a servo [rad/s].
        disc_radius: radius of the surface that touches the skin [m].
        mount: pose of the base frame in the finger's frame, shape (4, 4), lengths in m.
        pulse_neutral: pulse width of a servo at neutral [s].
        pulse_gain: change of the pulse width per angle [s/rad].
        bounds: lowest and highest angle of each servo from neutral [rad], shape (2, 3). None if no servo's channel has
            a narrower range than `servo_range`.
    """

    servo_range: float
    servo_speed: float
    disc_radius: float
    mount: Array
    pulse_neutral: float
    pulse_gain: float
    bounds: Array | None = None

    @property
    def freedoms(self) -> int:
        """Number of values in a configuration, which is the number of servos."""
        return 3

    @property
    def servo_limits(self) -> tuple[Array, Array]:
        """Lowest and highest angle of each servo [rad], shape (3,) each.

        Angles are counted from neutral.
        """
        if self.bounds is None:
            return np.full(3, -self.servo_range), np.full(3, self.servo_range)
        return self.bounds[0], self.bounds[1]

    def constraints(self, x: ArrayLike, low: Array, high: Array) -> Array:
        """Return the constraints c(x) >= 0 of a configuration, shape (7,).

        The first three values are the highest angles minus the servos' angles [rad]. The next three are the servos'
        angles minus the lowest angles [rad]. The last is the singularity margin minus `MIN_MARGIN`.

        Args:
            x: pitch, roll [rad] and distance [m], shape (3,).
            low, high: limits of the servos' angles from neutral [rad], shape (3,) each.

        Raises:
            DermisError: a leg cannot reach.
        """
        angles, margin = inverse_kinematics(self, *np.asarray(x, dtype=np.float64).tolist())
        return np.concatenate([high - angles, angles - low, [margin - MIN_MARGIN]])

    def joints(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return the angles of the servos and their derivative.

        The angles are counted from neutral [rad], shape (3,). The derivative is with respect to x, shape (3, 3).

        Args:
            x: pitch, roll [rad] and distance [m], shape (3,).

        Raises:
            DermisError: a leg cannot reach.
        """
        angles, slopes = self.servo_angles(x)
        return angles - self.servo_zero, slopes

    def feasible(self, x: ArrayLike) -> bool:
        """Return whether a configuration is allowed by the device's limits.

        It is allowed if all legs reach, all servos are within `servo_limits`, and the singularity margin is at least
        `MIN_MARGIN`.

        Args:
            x: pitch, roll [rad] and distance [m], shape (3,).
        """
        return self.holds(np.asarray(x, dtype=np.float64), *self.servo_limits)

    def holds(self, x: Array, low: Array, high: Array) -> bool:
        """Return whether a configuration is allowed by other servo limits.

        Args:
            x: pitch, roll [rad] and distance [m], shape (3,).
            low, high: limits of the servos' angles from neutral [rad], shape (3,) each.
        """
        pitch, roll, distance = x.tolist()
        if not (abs(pitch) < QUARTER and abs(roll) < QUARTER):
            return False
        try:
            angles, margin = inverse_kinematics(self, pitch, roll, distance)
        except DermisError:
            return False
        return min([*map(sub, high.tolist(), angles), *map(sub, angles, low.tolist()), margin - MIN_MARGIN]) >= 0.0

    def forward(self, angles: ArrayLike, start: ArrayLike) -> Array:
        """Return the configuration for given servo angles, see `configuration`.

        Args:
            angles: servo angles from neutral [rad], shape (3,).
            start: configuration from which the search starts: pitch, roll [rad] and distance [m], shape (3,).

        Returns:
            Pitch, roll [rad] and distance [m], shape (3,).

        Raises:
            DermisError: no such configuration was found.
        """
        return configuration(self, np.asarray(angles, dtype=np.float64) + self.servo_zero, start)

    def in_finger(self, pose: PlatformPose) -> Array:
        """Return a pose of the platform in the finger's frame, shape (4, 4).

        Lengths are in m.
        """
        local = np.eye(4)
        local[:3, :3], local[:3, 3] = pose.rotation, pose.centre
        return self.mount @ local


def channel_values(angles: Array, x: Array) -> dict[str, Array]:
    """Return the values of each channel of a thimble, by the channel's name.

    Args:
        angles: servo angles from neutral [rad], shape (n, 3).
        x: pitch, roll [rad] and distance [m], shape (n, 3).

    Returns:
        Values of shape (n,) for each name: three servos, 'pitch', 'roll' and 'distance'.
    """
    return dict(zip((*SERVOS, "pitch", "roll", "distance"), (*angles.T, *x.T), strict=True))


def mechanism(spec: DeviceSpec) -> Thimble:
    """Build the mechanism of a preset.

    The servos are at neutral if the platform is level at the preset's `reference_distance`.

    Raises:
        DermisError: a length or limit is not above zero; the links do not reach the platform at the reference distance
            or do not hold it there; or a channel leaves its servo no range.
    """
    where = f"device preset '{spec.key}'"
    names = ("platform_radius", "base_radius", "crank", "rod", "servo_range", "servo_speed", "disc_radius")
    sizes: dict[str, Any] = {name: spec.value(name) for name in names}
    reference = spec.value("reference_distance")
    # The base is above the nail and faces the finger: its +Z is the finger's -Z, and its +Y is the finger's +Y.
    mount = np.diag([-1.0, 1.0, -1.0, 1.0])
    mount[:3, 3] = spec.value("mount_position") or (0.0, 0.0, reference)
    bend = -1.0 if spec.value("knee") == "inwards" else 1.0
    device = Thimble(
        **sizes,
        servo_zero=0.0,
        bend=bend,
        mount=mount,
        pulse_neutral=spec.value("pulse_neutral"),
        pulse_gain=spec.value("pulse_gain"),
    )
    try:
        zero = float(device.servo_angles([0.0, 0.0, reference])[0][0])
        margin = inverse_kinematics(device, 0.0, 0.0, reference)[1]
    except DermisError as error:
        raise DermisError("the links cannot close at the reference distance", where=where, value=str(error)) from error
    if abs(margin) < MIN_MARGIN:
        raise DermisError(
            "the rods lie too flat to hold the platform at the reference distance",
            where=where,
            value=f"singularity margin {abs(margin):.3g}",
            limit=f">= {MIN_MARGIN:g}",
            remedy="Use other link lengths or another distance",
        )
    sizes["servo_speed"] = servo_speed(spec, sizes["servo_speed"])
    bounds = servo_bounds(spec, sizes["servo_range"])
    return replace(device, **sizes, servo_zero=zero, side=math.copysign(1.0, margin), bounds=bounds)


def reference_distance(spec: DeviceSpec, device: Thimble) -> float:
    """Return the distance of the platform from the base at neutral [m].

    Forward kinematics can start from this distance.
    """
    return float(spec.parameters.get("reference_distance", device.mount[2, 3]))

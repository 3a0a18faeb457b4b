"""Thimble 3-RRS: a disc under the finger pad, pitched, rolled and pressed by three servos above the nail.

The linkage with what makes it a device: servos with a range and a speed, a disc, and its place on the finger.

Source: [S0] 3.1 with the kinematics of the project's corrections (closed form of the 3-RRS).
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
from .singularity import singularity_margin
from .spec import DeviceSpec

MIN_MARGIN = 0.03  # of singularity: there a servo's error turns the platform 15 times as far, beyond it gives way
QUARTER = math.pi / 2  # [rad] of pitch or roll: past both, they name a pose once more, its margin with the other sign


@dataclass(frozen=True)
class Thimble(Linkage):
    """The mechanism: its linkage, and beside it

    Attributes:
        servo_range: allowed to either side of neutral [rad]. servo_speed: [rad/s].
        disc_radius: of the surface that touches the skin [m].
        mount: base frame in the finger's frame, shape (4, 4).
        pulse_neutral, pulse_gain: pulse width at neutral [s] and its change [s/rad].
        bounds: lowest and highest angle from neutral of every servo [rad], shape (2, 3), where its channel is narrower
            than the range; None where none is.
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
        """Number of values in a configuration, and of servos."""
        return 3

    @property
    def servo_limits(self) -> tuple[Array, Array]:
        """Lowest and highest angle of every servo from neutral [rad], shape (3,) each."""
        if self.bounds is None:
            return np.full(3, -self.servo_range), np.full(3, self.servo_range)
        return self.bounds[0], self.bounds[1]

    def constraints(self, x: ArrayLike, low: Array, high: Array) -> tuple[Array, Array]:
        """Return c(x) >= 0, shape (7,), and dc/dx, shape (7, 3), within limits of the servos [rad], shape (3,) each.

        The first six are the room left of each servo to either side [rad], the last how far the platform is from the
        least singularity margin.

        Raises:
            DermisError: a leg cannot reach.
        """
        at = np.asarray(x, dtype=np.float64)
        angles, by_x = (np.array(rows) for rows in self.angles_from_neutral(self.pose(at)))
        margin, softer = singularity_margin(self, *at.tolist())
        return np.concatenate([high - angles, angles - low, [margin - MIN_MARGIN]]), np.vstack([-by_x, by_x, softer])

    def joints(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return the servos' angles from neutral [rad], shape (3,), and their derivative by x, shape (3, 3).

        Raises:
            DermisError: a leg cannot reach.
        """
        angles, slopes = self.servo_angles(x)
        return angles - self.servo_zero, slopes

    def feasible(self, x: ArrayLike) -> bool:
        """Return whether the legs reach, the servos stay within their range, and hold the platform firmly."""
        low, high = self.servo_limits
        pitch, roll, distance = np.asarray(x, dtype=np.float64).tolist()
        return self.within(pitch, roll, distance, low.tolist(), high.tolist())

    def holds(self, x: Array, low: Array, high: Array) -> bool:
        """Return the same for limits of the servos' angles from neutral [rad], shape (3,) each."""
        pitch, roll, distance = x.tolist()
        return self.within(pitch, roll, distance, low.tolist(), high.tolist())

    def within(self, pitch: float, roll: float, distance: float, low: list[float], high: list[float]) -> bool:
        """Return the same for limits of the servos' angles from neutral [rad]."""
        return self.room(pitch, roll, distance, low, high) is not None

    def room(
        self, pitch: float, roll: float, distance: float, low: list[float], high: list[float]
    ) -> list[float] | None:
        """Return c(x) as `constraints` does, as plain numbers; None where a leg cannot reach or any is below zero."""
        if not (abs(pitch) < QUARTER and abs(roll) < QUARTER):
            return None
        try:
            angles, margin = inverse_kinematics(self, pitch, roll, distance)
        except DermisError:
            return None
        room = [*map(sub, high, angles), *map(sub, angles, low), margin - MIN_MARGIN]
        return room if min(room) >= 0.0 else None

    def forward(self, angles: ArrayLike, start: ArrayLike) -> Array:
        """Return the configuration that servo angles from neutral [rad] hold the platform in; see `configuration`.

        Raises:
            DermisError: no such configuration was found.
        """
        return configuration(self, np.asarray(angles, dtype=np.float64) + self.servo_zero, start)

    def pulse_width(self, angles: ArrayLike) -> Array:
        """Return the servos' pulse widths [s] for angles [rad]."""
        return self.pulse_neutral + self.pulse_gain * (np.asarray(angles, dtype=np.float64) - self.servo_zero)

    def in_finger(self, pose: PlatformPose) -> Array:
        """Return the platform's pose in the finger's frame, shape (4, 4)."""
        local = np.eye(4)
        local[:3, :3], local[:3, 3] = pose.rotation, pose.centre
        return self.mount @ local


def channel_values(angles: Array, x: Array) -> dict[str, Array]:
    """Return what each channel of a thimble holds, by name.

    Args:
        angles: of the servos from neutral [rad], shape (..., 3). x: pitch, roll [rad] and distance [m], shape (..., 3).
    """
    return dict(zip((*SERVOS, "pitch", "roll", "distance"), (*angles.T, *x.T), strict=True))


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
    """Return the platform's distance from the base with all servos in their middle [m], as a start for poses."""
    return float(spec.parameters.get("reference_distance", device.mount[2, 3]))

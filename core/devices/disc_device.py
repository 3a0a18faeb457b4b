"""DiscDevice: interface of devices that carry a rigid disc under the finger pad.

A configuration begins with pitch, roll [rad] and distance [m]. Devices with six joints add two shifts of the disc along
the pad, in x and y of the finger's frame [m], and its yaw [rad].
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from .linkage import PlatformPose

LATERAL = ("shift x", "shift y", "yaw")  # names of the values of a configuration after the first three


class DiscDevice(Protocol):
    """Device as a search for a pose uses it; its n joints are angles of servos or lengths of legs."""

    @property
    def freedoms(self) -> int:
        """Number n of values in a configuration, which is the number of joints."""
        ...

    @property
    def disc_radius(self) -> float:
        """Radius of the surface that touches the skin [m]."""
        ...

    @property
    def platform_radius(self) -> float:
        """Length by which shifts are divided to compare them with angles [m]."""
        ...

    @property
    def mount(self) -> Array:
        """Pose of the base in the finger's frame, shape (4, 4)."""
        ...

    @property
    def servo_limits(self) -> tuple[Array, Array]:
        """Lowest and highest value of every joint from neutral [rad or m], shape (n,) each."""
        ...

    @property
    def servo_speed(self) -> float:
        """Speed of the slowest joint [rad/s, or m/s for legs]."""
        ...

    def forward(self, angles: ArrayLike, start: ArrayLike) -> Array:
        """Return the configuration near `start` at which the joints have given values, shape (n,).

        Args:
            angles: values of the joints from neutral [rad or m], shape (n,).
            start: configuration to start from, shape (n,).

        Raises:
            DermisError: there is no such configuration.
        """
        ...

    def pose(self, x: ArrayLike) -> PlatformPose:
        """Return the pose of the disc in the base's frame; values that x lacks after the third are zero."""
        ...

    def joints(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return the joints' values from neutral, shape (n,), and their derivatives with respect to x, shape (n, n).

        Raises:
            DermisError: the device cannot reach the configuration.
        """
        ...

    def constraints(self, x: ArrayLike, low: Array, high: Array) -> tuple[Array, Array]:
        """Return constraints c(x) >= 0 and their derivative for limits of the joints, see `ServoLimits`."""
        ...

    def holds(self, x: Array, low: Array, high: Array) -> bool:
        """Return whether the device reaches x within limits of its joints, away from singular poses."""
        ...

    def feasible(self, x: ArrayLike) -> bool:
        """Return `holds` for the whole range of the joints."""
        ...


def seated(device: DiscDevice, pitch: float, roll: float, distance: float) -> Array:
    """Return the configuration of a tilt [rad] and a distance [m], with all other values zero, shape (n,)."""
    x = np.zeros(device.freedoms)
    x[:3] = pitch, roll, distance
    return x


def scale_of(device: DiscDevice) -> Array:
    """Return the scale of each value of a configuration, shape (n,): the platform's radius for lengths, else 1."""
    scale = np.ones(device.freedoms)
    scale[2:5] = device.platform_radius
    return scale

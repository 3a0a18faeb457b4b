"""DiscDevice: interface of devices with a rigid disc under the finger pad.

A configuration begins with pitch, roll [rad] and distance [m]. Devices with six joints add two shifts of the disc along
the pad, in x and y of the finger's frame [m], and its yaw [rad].
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from .linkage import PlatformPose


class DiscDevice(Protocol):
    """Interface of devices whose poses are searched.

    A device has n joints. Their values are angles of servos or lengths of legs.
    """

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
        """Lowest and highest value of every joint [rad or m], shape (n,) each.

        Values of joints are zero at neutral.
        """
        ...

    @property
    def servo_speed(self) -> float:
        """Speed of the slowest joint [rad/s, or m/s for legs]."""
        ...

    def forward(self, angles: ArrayLike, start: ArrayLike) -> Array:
        """Return the configuration for given values of the joints, shape (n,).

        Args:
            angles: values of the joints from neutral [rad or m], shape (n,).
            start: configuration near the result, from which the search starts, shape (n,).

        Raises:
            DermisError: there is no such configuration.
        """
        ...

    def pose(self, x: ArrayLike) -> PlatformPose:
        """Return the pose of the disc in the base's frame.

        Args:
            x: configuration, shape (n,). Missing values after the third are zero.
        """
        ...

    def joints(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return the values of the joints and their derivatives.

        The values are counted from neutral [rad or m]. The derivatives are with respect to x. The shapes are (n,) and
        (n, n).

        Raises:
            DermisError: the device cannot reach the configuration.
        """
        ...

    def constraints(self, x: ArrayLike, low: Array, high: Array) -> Array:
        """Return constraints c(x) >= 0, see `ServoLimits`.

        Args:
            x: configuration, shape (n,).
            low, high: lowest and highest values of the joints from neutral [rad or m], shape (n,) each.
        """
        ...

    def holds(self, x: Array, low: Array, high: Array) -> bool:
        """Return whether the device reaches x within given limits of its joints.

        Singular poses and poses near to them count as not reached.

        Args:
            x: configuration, shape (n,).
            low, high: lowest and highest values of the joints from neutral [rad or m], shape (n,) each.
        """
        ...

    def feasible(self, x: ArrayLike) -> bool:
        """Return the result of `holds` for the whole range of the joints."""
        ...


def seated(device: DiscDevice, pitch: float, roll: float, distance: float) -> Array:
    """Return the configuration of a tilt [rad] and a distance [m], shape (n,).

    All other values are zero.
    """
    x = np.zeros(device.freedoms)
    x[:3] = pitch, roll, distance
    return x


def scale_of(device: DiscDevice) -> Array:
    """Return the scale of each value of a configuration, shape (n,).

    It is the radius of the platform for lengths, and 1 for angles.
    """
    scale = np.ones(device.freedoms)
    scale[2:5] = device.platform_radius
    return scale

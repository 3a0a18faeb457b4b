"""DiscDevice: whatever carries a rigid disc under the finger pad, by however many joints.

A configuration begins with pitch, roll [rad] and distance [m]; devices with more freedom add shifts of the disc along
the pad, x and y in the finger's frame [m], and its yaw [rad].
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from .linkage import PlatformPose

LATERAL = ("shift x", "shift y", "yaw")  # what more than three values of a configuration say


class DiscDevice(Protocol):
    """What a search for a pose of the disc must know of a device: joints stand for servos' angles or legs' lengths."""

    @property
    def freedoms(self) -> int:
        """Number of values in a configuration, n: as many as there are joints."""
        ...

    @property
    def disc_radius(self) -> float:
        """Of the surface that touches the skin [m]."""
        ...

    @property
    def platform_radius(self) -> float:
        """Length that makes shifts comparable with turns [m]."""
        ...

    @property
    def mount(self) -> Array:
        """Base frame in the finger's frame, shape (4, 4)."""
        ...

    @property
    def servo_limits(self) -> tuple[Array, Array]:
        """Lowest and highest value of every joint, from neutral, shape (n,) each."""
        ...

    @property
    def servo_speed(self) -> float:
        """Of the slowest joint [rad/s, or m/s of legs]."""
        ...

    def forward(self, angles: ArrayLike, start: ArrayLike) -> Array:
        """Return the configuration near `start` in which the joints have these values from neutral.

        Raises:
            DermisError: there is none.
        """
        ...

    def pose(self, x: ArrayLike) -> PlatformPose:
        """Return where the disc is, in the base's frame; three values of x are level in all others."""
        ...

    def joints(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return the joints' values from neutral, shape (n,), and their derivative by x, shape (n, n).

        Raises:
            DermisError: the device cannot reach.
        """
        ...

    def constraints(self, x: ArrayLike, low: Array, high: Array) -> tuple[Array, Array]:
        """Return c(x) >= 0 and dc/dx within limits of the joints; see `gauss_newton.ServoLimits`."""
        ...

    def holds(self, x: Array, low: Array, high: Array) -> bool:
        """Return whether the device reaches x within limits of its joints and holds the disc firmly there."""
        ...

    def feasible(self, x: ArrayLike) -> bool:
        """Return the same for the whole range of the joints."""
        ...


def seated(device: DiscDevice, pitch: float, roll: float, distance: float) -> Array:
    """Return the configuration of a tilt and a distance in the middle of all other freedom, shape (n,)."""
    x = np.zeros(device.freedoms)
    x[:3] = pitch, roll, distance
    return x


def scale_of(device: DiscDevice) -> Array:
    """Return what configurations are divided by to be angles, shape (n,): lengths by the platform's radius."""
    scale = np.ones(device.freedoms)
    scale[2:5] = device.platform_radius
    return scale

"""LateralStage: a thimble on a stage that moves it along the pad and turns it, to see the benefit of such axes.

No such device is built: it has the thimble's servos and their limits, and three more joints with limits of their own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import DermisError
from .linkage import PlatformPose
from .thimble import Thimble

REACH = 5e-3  # [m] to either side: a pulp's width is three times that
TURN = np.radians(30.0)  # to either side


@dataclass(frozen=True, eq=False)
class LateralStage:
    """The thimble, and how far the stage goes: `reach` [m] along both axes, `turn` [rad], to either side."""

    thimble: Thimble
    reach: float = REACH
    turn: float = TURN

    @property
    def freedoms(self) -> int:
        """Number of values in a configuration."""
        return 6

    @property
    def disc_radius(self) -> float:
        """Of the surface that touches the skin [m]."""
        return self.thimble.disc_radius

    @property
    def platform_radius(self) -> float:
        """Of the joints' circle on the platform [m]."""
        return self.thimble.platform_radius

    @property
    def mount(self) -> Array:
        """Base frame in the finger's frame, shape (4, 4)."""
        return self.thimble.mount

    @property
    def servo_limits(self) -> tuple[Array, Array]:
        """Ends of the servos [rad] and of the stage [m, m, rad], shape (6,) each."""
        (low, high), ends = self.thimble.servo_limits, np.array([self.reach, self.reach, self.turn])
        return np.concatenate([low, -ends]), np.concatenate([high, ends])

    @property
    def servo_speed(self) -> float:
        """None is known of a stage that is not built."""
        return math.inf

    def forward(self, angles: ArrayLike, start: ArrayLike) -> Array:
        """Return the configuration of servo angles [rad] and a stage's place, shape (6,).

        Raises:
            DermisError: none has these angles.
        """
        values = np.asarray(angles, np.float64)
        return np.concatenate([self.thimble.forward(values[:3], np.asarray(start, np.float64)[:3]), values[3:]])

    def pose(self, x: ArrayLike) -> PlatformPose:
        """Return the disc's pose in the base frame at x = (pitch, roll, distance, shift x, shift y, yaw)."""
        at = np.zeros(6)
        at[: np.size(x)] = x
        pitch, roll, distance, east, north, yaw = at.tolist()
        own, c, s = self.thimble.pose((pitch, roll, distance)), math.cos(yaw), math.sin(yaw)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        centre = turn @ own.centre
        spin, shift = np.zeros((6, 3)), np.zeros((3, 6))
        spin[:3], spin[5, 2] = own.spin @ turn.T, 1.0
        shift[:, :3], shift[0, 3], shift[1, 4] = turn @ own.d_centre, -1.0, 1.0  # the base's X is the finger's -X
        shift[:2, 5] = -centre[1], centre[0]
        return PlatformPose(turn @ own.rotation, centre + [-east, north, 0.0], spin, shift, at)

    def joints(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return the servos' angles and the stage's place, shape (6,), and their derivative by x, shape (6, 6).

        Raises:
            DermisError: a leg cannot reach.
        """
        at = np.asarray(x, np.float64)
        angles, by_x = self.thimble.joints(at[:3])
        slopes = np.eye(6)
        slopes[:3, :3] = by_x
        return np.concatenate([angles, at[3:]]), slopes

    def constraints(self, x: ArrayLike, low: Array, high: Array) -> tuple[Array, Array]:
        """Return c(x) >= 0, shape (13,), and dc/dx: room upwards, the singularity margin's, room downwards.

        Raises:
            DermisError: a leg cannot reach.
        """
        at = np.asarray(x, np.float64)
        values, slopes = self.joints(at)
        margin, softer = self.thimble.constraints(at[:3], low[:3], high[:3])
        slope = np.concatenate([softer[6], np.zeros(3)])
        return np.concatenate([high - values, margin[6:], values - low]), np.vstack([-slopes, slope, slopes])

    def holds(self, x: Array, low: Array, high: Array) -> bool:
        """Return whether thimble and stage reach x within limits, and the thimble holds its platform firmly."""
        stage = (x[3:] >= low[3:]).all() and (x[3:] <= high[3:]).all()
        return bool(stage) and self.thimble.holds(x[:3], low[:3], high[:3])

    def feasible(self, x: ArrayLike) -> bool:
        """Return the same for the whole range of thimble and stage."""
        try:
            return self.holds(np.asarray(x, np.float64), *self.servo_limits)
        except DermisError:
            return False

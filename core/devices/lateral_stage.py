"""LateralStage: a thimble on a stage that shifts and turns it.

It serves to study the benefit of such axes. No such device has been built. It has the thimble's servos with their
limits, and three more joints with their own limits.
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

REACH = 5e-3  # [m] default reach of the stage to either side; the width of a pulp is three times that
TURN = np.radians(30.0)  # [rad] default turn of the stage to either side


@dataclass(frozen=True, eq=False)
class LateralStage:
    """Thimble on a stage.

    A configuration is x = (pitch, roll, distance, shift x, shift y, yaw).

    Attributes:
        thimble: the thimble.
        reach: largest shift along each axis, to either side [m].
        turn: largest yaw to either side [rad].
    """

    thimble: Thimble
    reach: float = REACH
    turn: float = TURN

    @property
    def freedoms(self) -> int:
        """Number of values in a configuration."""
        return 6

    @property
    def disc_radius(self) -> float:
        """Radius of the surface that touches the skin [m]."""
        return self.thimble.disc_radius

    @property
    def platform_radius(self) -> float:
        """Radius of the circle of joints on the platform [m]."""
        return self.thimble.platform_radius

    @property
    def mount(self) -> Array:
        """Base frame in the finger's frame, shape (4, 4)."""
        return self.thimble.mount

    @property
    def servo_limits(self) -> tuple[Array, Array]:
        """Lower and upper limits of servos [rad] and stage [m, m, rad], (6,) each."""
        (low, high), ends = self.thimble.servo_limits, np.array([self.reach, self.reach, self.turn])
        return np.concatenate([low, -ends]), np.concatenate([high, ends])

    @property
    def servo_speed(self) -> float:
        """Largest speed: inf, since that of a stage that is not built is unknown."""
        return math.inf

    def forward(self, angles: ArrayLike, start: ArrayLike) -> Array:
        """Return the configuration of servo angles and stage's place, (6,).

        Args:
            angles: three servo angles [rad], two shifts [m] and the yaw [rad] of the stage, shape (6,).
            start: configuration nearby, from which that of the thimble is searched.

        Raises:
            DermisError: no configuration has these angles.
        """
        values = np.asarray(angles, np.float64)
        return np.concatenate([self.thimble.forward(values[:3], np.asarray(start, np.float64)[:3]), values[3:]])

    def pose(self, x: ArrayLike) -> PlatformPose:
        """Return the disc's pose in the base frame; values that x lacks are 0."""
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
        """Return servo angles and stage's place, (6,), and derivative, (6, 6).

        Raises:
            DermisError: a leg cannot reach.
        """
        at = np.asarray(x, np.float64)
        angles, by_x = self.thimble.joints(at[:3])
        slopes = np.eye(6)
        slopes[:3, :3] = by_x
        return np.concatenate([angles, at[3:]]), slopes

    def constraints(self, x: ArrayLike, low: Array, high: Array) -> Array:
        """Return the constraints c(x) >= 0, shape (13,).

        They are the room to the six upper limits, the margin to the singularity, and the room to the six lower limits.

        Raises:
            DermisError: a leg cannot reach.
        """
        at = np.asarray(x, np.float64)
        values, margin = self.joints(at)[0], self.thimble.constraints(at[:3], low[:3], high[:3])[6:]
        return np.concatenate([high - values, margin, values - low])

    def holds(self, x: Array, low: Array, high: Array) -> bool:
        """Return whether x is within limits and the platform is held firmly.

        Args:
            x: configuration, shape (6,).
            low, high: limits of servos and stage, shape (6,) each.
        """
        stage = (x[3:] >= low[3:]).all() and (x[3:] <= high[3:]).all()
        return bool(stage) and self.thimble.holds(x[:3], low[:3], high[:3])

    def feasible(self, x: ArrayLike) -> bool:
        """Return whether `holds` for the whole range of thimble and stage."""
        try:
            return self.holds(np.asarray(x, np.float64), *self.servo_limits)
        except DermisError:
            return False

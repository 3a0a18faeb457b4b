"""SixLegs: a six-leg platform with strokes, for a search of poses.

A configuration is x = (pitch, roll, distance, shift x, shift y, yaw). The disc turns by pitch about X, then by roll
about the turned Y, then by yaw about its own axis. As for the thimble, +Z of the base frame points from the nail to the
pad.

Source: [S2] II and Fig. 2 for the mechanism; [S0] 3.1 for the search's constraints
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import DermisError
from .hexapod import Hexapod
from .linkage import PlatformPose
from .poses import Poses
from .spec import DeviceSpec

FIRM = 0.25  # least conditioning of a pose, as a share of that of the reference configuration
_NEXT, _AFTER = [1, 2, 0], [2, 0, 1]
_DOWN = np.diag([-1.0, 1.0, -1.0])  # axes of the base frame in the finger's frame


@dataclass(frozen=True, eq=False)
class SixLegs:
    """Six-leg platform with the strokes of its legs.

    Attributes:
        hexapod: joints and disc.
        low, high: smallest and largest leg lengths [m], shape (6,) each.
        servo_speed: speed of the slowest leg [m/s]; inf if no leg has a limit.
        hold: least conditioning of a pose, see `Hexapod.conditioning`.
        mount: base frame in the finger's frame, shape (4, 4).
    """

    hexapod: Hexapod
    low: Array
    high: Array
    servo_speed: float
    hold: float
    mount: Array = field(default_factory=lambda: np.diag([-1.0, 1.0, -1.0, 1.0]))

    @classmethod
    def of(cls, hexapod: Hexapod, spec: DeviceSpec) -> SixLegs:
        """Return a preset's platform.

        Raises:
            DermisError: a leg has no range.
        """
        ends = []
        for channel in spec.channels:
            if channel.low is None or channel.high is None:
                raise DermisError("a leg needs a range", where=f"device preset '{spec.key}', {channel.name}")
            ends.append((channel.low, channel.high))
        low, high = np.array(ends).T
        speed = min((c.slew for c in spec.channels if c.slew is not None), default=math.inf)
        hold = FIRM * float(hexapod.conditioning(hexapod.rest_poses(1))[0])
        return cls(hexapod, low, high, speed, hold)

    @property
    def freedoms(self) -> int:
        """Number of values in a configuration."""
        return 6

    @property
    def disc_radius(self) -> float:
        """Radius of the surface that touches the skin [m]."""
        return self.hexapod.disc_radius

    @cached_property
    def platform_radius(self) -> float:
        """Radius of the circle of the legs' joints on the platform [m]."""
        return float(np.linalg.norm(self.hexapod.joints[0]))

    @property
    def servo_limits(self) -> tuple[Array, Array]:
        """Smallest and largest length of each leg [m], shape (6,) each."""
        return self.low, self.high

    def pose(self, x: ArrayLike) -> PlatformPose:
        """Return the disc's pose in the base frame; values that x lacks are 0."""
        at = np.zeros(6)
        at[: np.size(x)] = x
        pitch, roll, distance, east, north, yaw = at.tolist()
        cp, sp, cr, sr, c, s = (f(a) for a in (pitch, roll, yaw) for f in (math.cos, math.sin))
        u, v = (cr, sp * sr, -cp * sr), (0.0, cp, sp)
        axis = (sr, -sp * cr, cp * cr)
        rotation = np.array([[c * a + s * b, c * b - s * a, n] for a, b, n in zip(u, v, axis, strict=True)])
        none = (0.0, 0.0, 0.0)
        spin = np.array([(1.0, 0.0, 0.0), v, none, none, none, axis])
        shift = np.zeros((3, 6))
        shift[2, 2], shift[0, 3], shift[1, 4] = 1.0, -1.0, 1.0
        return PlatformPose(rotation, np.array([-east, north, distance]), spin, shift, at)

    def joints(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return leg lengths [m], shape (6,), and their derivative, shape (6, 6)."""
        pose = self.pose(x)
        length, along, moment = self._legs(pose)
        slopes: Array = along @ (_DOWN @ pose.d_centre) + moment @ (pose.spin @ _DOWN).T
        return length, slopes

    def constraints(self, x: ArrayLike, low: Array, high: Array) -> Array:
        """Return the constraints c(x) >= 0, shape (13,).

        They are the room to the six largest lengths [m], the conditioning minus `hold`, and the room to the six
        smallest lengths [m].
        """
        length, *way = self._legs(self.pose(x))
        return np.concatenate([high - length, [self._hold(*way) - self.hold], length - low])

    def holds(self, x: Array, low: Array, high: Array) -> bool:
        """Return whether all legs are within limits and hold the platform firmly.

        Args:
            x: configuration, shape (6,).
            low, high: smallest and largest leg lengths [m], shape (6,) each.
        """
        length, along, moment = self._legs(self.pose(x))
        return bool((length >= low).all() and (length <= high).all() and self._hold(along, moment) >= self.hold)

    def feasible(self, x: ArrayLike) -> bool:
        """Return whether `holds` for the strokes of the legs."""
        return self.holds(np.asarray(x, np.float64), self.low, self.high)

    def forward(self, angles: ArrayLike, start: ArrayLike) -> Array:
        """Return the configuration near `start` with given leg lengths, (6,).

        Args:
            angles: leg lengths [m], shape (6,); they are absolute, and not relative to a neutral length.
            start: configuration from which the search starts.

        Raises:
            DermisError: no pose with these lengths was found near `start`.
        """
        wanted = np.asarray(angles, np.float64)
        found = self.hexapod.carry(wanted[None], self._poses(start))
        turn, centre = _DOWN @ found.rotation[0] @ _DOWN, _DOWN @ found.centre[0]
        roll = math.asin(min(max(float(turn[0, 2]), -1.0), 1.0))
        pitch = math.atan2(-float(turn[1, 2]), float(turn[2, 2]))
        yaw = math.atan2(-float(turn[0, 1]), float(turn[0, 0]))
        return np.array([pitch, roll, centre[2], -centre[0], centre[1], yaw])

    def _poses(self, x: ArrayLike) -> Poses:
        pose = self.pose(x)
        return Poses((_DOWN @ pose.rotation @ _DOWN)[None], (_DOWN @ pose.centre)[None])

    def _legs(self, pose: PlatformPose) -> tuple[Array, Array, Array]:
        """Return the legs' lengths, directions and moments in the finger's frame.

        Returns:
            Lengths [m], shape (6,); unit vectors along the legs, shape (6, 3); and their moments about the disc's
            centre [m], shape (6, 3).
        """
        arm = self.hexapod.joints @ (_DOWN @ pose.rotation @ _DOWN).T
        leg = arm + _DOWN @ pose.centre - self.hexapod.base
        length = np.sqrt((leg * leg).sum(axis=1))
        along = leg / length[:, None]
        # This is arm x along. `np.cross` would take longer than the rest of the kinematics.
        moment = arm[:, _NEXT] * along[:, _AFTER] - arm[:, _AFTER] * along[:, _NEXT]
        return length, along, moment

    def _hold(self, along: Array, moment: Array) -> float:
        """Return `Hexapod.conditioning` of the legs' directions and moments."""
        rows = np.concatenate([along, moment / self.platform_radius], axis=1)
        values = np.linalg.svd(rows, compute_uv=False)
        return float(values[-1] / values[0])

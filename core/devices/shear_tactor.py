"""Shear tactor: two coaxial pulleys and a rhombus of links move a cap.

The cap moves in the pad's plane. The four links are equally long.

Source: [S3] section 3; the kinematics p = l (u(q1) + u(q2)) are derived from it
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from ..following import follow
from .spec import DeviceSpec


@dataclass(frozen=True)
class ShearTactor:
    """Rhombus with the pulleys' axis and the cap at opposite corners.

    Positions are those of the cap in the pad's plane [m], relative to the centre of the workspace. Pulley angles are
    relative to the reference pose, in which the cap is in the centre and the two driven links are orthogonal.

    Attributes:
        link: length of every link, l [m].
        radius: radius A of the round workspace [m].
        speed: largest speed of the cap [m/s].
        torque: largest torque of each motor, at its pulley [N m].
        heading: direction from the pulleys' axis to the workspace's centre, from the pad's +X [rad].
        tap_axis: unit vector in the pad's plane along which the normal part of a tap is shown, shape (2,).
    """

    link: float
    radius: float
    speed: float
    torque: float
    heading: float
    tap_axis: tuple[float, float]

    @classmethod
    def from_spec(cls, spec: DeviceSpec) -> ShearTactor:
        """Read the mechanism from a device preset.

        Raises:
            DermisError: a parameter is missing or impossible, or the workspace reaches a singular pose.
        """
        where = f"device preset '{spec.key}'"
        names = ("link_length", "range", "max_speed", "torque_limit", "axis_direction", "tap_axis")
        link, radius, speed, torque, heading, tap = map(spec.value, names)
        if not any(tap):
            raise DermisError("the tap axis must be a direction in the pad's plane", where=where, value=tap)
        axis = np.asarray(tap, dtype=np.float64) / math.hypot(*tap)
        reach = math.sqrt(2.0) * link
        if not (radius < reach and reach + radius < 2.0 * link):
            raise DermisError(
                "the links cannot reach the whole workspace",
                where=where,
                value=radius,
                limit=f"less than {min(reach, 2.0 * link - reach):.6g} m",
            )
        return cls(link, radius, speed, torque, heading, (float(axis[0]), float(axis[1])))

    @property
    def axis(self) -> Array:
        """Position of the pulleys' common axis [m], shape (2,)."""
        return -math.sqrt(2.0) * self.link * np.array([math.cos(self.heading), math.sin(self.heading)])

    def inverse(self, position: Array) -> Array:
        """Return the pulley angles [rad] for cap positions [m], shapes (..., 2).

        Raises:
            DermisError: the links cannot reach a position.
        """
        offset = np.asarray(position, dtype=np.float64) - self.axis
        x, y = offset[..., 0], offset[..., 1]
        cosine = np.hypot(x, y) / (2.0 * self.link)
        if not (cosine < 1.0).all():
            raise DermisError(
                "the links cannot reach this position",
                value=float(np.max(2.0 * self.link * cosine)),
                limit=f"less than {2.0 * self.link:.6g} m from the pulleys' axis",
            )
        half = np.arccos(cosine) - math.pi / 4.0
        # The angle is relative to the heading, so that it never jumps at the +-180 degrees of arctan2.
        c, s = math.cos(self.heading), math.sin(self.heading)
        turn = np.arctan2(c * y - s * x, c * x + s * y)
        out = np.empty((*turn.shape, 2))
        out[..., 0], out[..., 1] = turn - half, turn + half
        return out

    def forward(self, angles: Array) -> Array:
        """Return the cap positions [m] for pulley angles [rad], shapes (..., 2)."""
        q = self._absolute(angles)
        return self.link * np.stack([np.cos(q).sum(axis=-1), np.sin(q).sum(axis=-1)], axis=-1) + self.axis

    def _absolute(self, angles: Array) -> Array:
        """Return the angles of the two driven links from the pad's +X [rad]."""
        return np.asarray(angles) + np.array([self.heading - math.pi / 4.0, self.heading + math.pi / 4.0])


def within_speed(target: Array, step: float, start: Array | None = None) -> tuple[Array, int]:
    """Return a path of limited speed, and the number of samples it changes.

    If the target is too fast, the cap moves straight towards the target at the largest speed, until it reaches the
    target. The speed of the cap is limited, and not that of each pulley, so that cap and pulleys stay consistent.

    Args:
        target: wanted positions, shape (n, 2).
        step: largest distance between two samples, in the same unit.
        start: position at the first sample, shape (2,); None for the first target.
    """
    asked = target
    if start is not None:
        target = target.copy()
        target[0] = start
    (dx, dy), far = (target[1:] - target[:-1]).T, step * (1.0 + 1e-9)
    leaps = np.flatnonzero(dx * dx + dy * dy > far**2) + 1

    def advance(_row: int, place: list[float], goal: list[float]) -> list[float] | None:
        dx, dy = goal[0] - place[0], goal[1] - place[1]
        distance = math.sqrt(dx * dx + dy * dy)
        return None if distance <= far else [place[0] + dx * step / distance, place[1] + dy * step / distance]

    path = follow(target, leaps, advance)
    return path, int(np.count_nonzero((path[:, 0] != asked[:, 0]) | (path[:, 1] != asked[:, 1])))

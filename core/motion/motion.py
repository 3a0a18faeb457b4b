"""Motion: a pose that moves, and its rates."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..arrays import Array
from .rotation import continuous, matrices, quaternions, rotations
from .spline import Spline
from .vectors import cross, dot, scaled


class Motion:
    """A smooth motion through sampled poses.

    Args:
        times: [s], strictly rising, shape (n,). One sample means at rest, two mean uniform speed.
        poses: object-to-world matrices of any invertible scale, shape (n, 4, 4).

    Raises:
        DermisError: see `Spline` and `rotations`.
    """

    def __init__(self, times: Array, poses: Array) -> None:
        self.times = np.asarray(times, dtype=np.float64)
        self.positions = Spline(self.times, poses[:, :3, 3])
        self._linear = poses[:, :3, :3]

    @cached_property
    def rotations(self) -> Spline:
        """The spline through the unit quaternions (w, x, y, z)."""
        if (self._linear == self._linear[0]).all():
            one = quaternions(rotations(self._linear[:1]))
            return Spline(self.times, np.repeat(one, len(self.times), axis=0))
        return Spline(self.times, continuous(quaternions(rotations(self._linear))))

    def at(self, t: Array) -> MotionSamples:
        """Return the motion at times [s], shape (m,); each quantity is computed when it is first read."""
        return MotionSamples(self, np.asarray(t, dtype=np.float64))


class MotionSamples:
    """A motion at given times: position, rotation and their rates, each computed when first read.

    Attributes:
        times: [s], shape (m,).
    """

    def __init__(self, motion: Motion, times: Array) -> None:
        self.times = times
        self._motion = motion
        self._piece = motion.positions.piece(times)

    @cached_property
    def position(self) -> Array:
        """[m], shape (m, 3)."""
        return self._motion.positions.at(self.times, 0, self._piece)

    @cached_property
    def velocity(self) -> Array:
        """[m/s], shape (m, 3)."""
        return self._motion.positions.at(self.times, 1, self._piece)

    @cached_property
    def acceleration(self) -> Array:
        """[m/s^2], shape (m, 3)."""
        return self._motion.positions.at(self.times, 2, self._piece)

    @cached_property
    def turns(self) -> bool:
        """Whether the rotation changes at all."""
        return not self._motion.rotations.still

    @cached_property
    def rotation(self) -> Array:
        """Object-to-world rotation matrices, shape (m, 3, 3)."""
        if not self.turns:
            return np.broadcast_to(matrices(self._motion.rotations.values[:1])[0], (len(self.times), 3, 3))
        return matrices(self._quaternion)

    @cached_property
    def angular_velocity(self) -> Array:
        """In world axes [rad/s], shape (m, 3)."""
        if not self.turns:
            return np.zeros((len(self.times), 3))
        # For q not of unit length the vector part of q' q* / |q|^2 is that of its normalised form.
        q = self._quaternion
        p = self._motion.rotations.at(self.times, 1, self._piece)
        w, v = q[:, 0], q[:, 1:]
        rate = scaled(p[:, 1:], w) - scaled(v, p[:, 0]) - cross(p[:, 1:], v)
        return scaled(rate, 2.0 / dot(q, q))

    @cached_property
    def _quaternion(self) -> Array:
        return self._motion.rotations.at(self.times, 0, self._piece)

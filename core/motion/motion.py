"""Motion: a smooth motion through sampled poses, with its derivatives."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..arrays import Array
from .rotation import continuous, matrices, quaternions, rotations, turns_of
from .spline import Knots, Spline
from .vectors import cross, dot, scaled


class Motion:
    """A smooth motion through sampled poses.

    Args:
        times: times of the samples [s], strictly rising, shape (n,), or the knots of other motions. One sample means
            rest. Two samples mean uniform velocity, but the rotation is only nearly uniform.
        poses: object-to-world matrices of any invertible scale, shape (n, 4, 4).
        positions: spline through the origins of the poses [m], if it is known already; None to make it.

    Raises:
        DermisError: see `Spline`. A pose without an inverse is refused only when `rotations` is first read.
    """

    def __init__(self, times: Array | Knots, poses: Array, positions: Spline | None = None) -> None:
        self.positions = Spline(times, poses[:, :3, 3]) if positions is None else positions
        self.knots = self.positions.knots
        self._linear = poses[:, :3, :3]
        self._rotations: Spline | None = None  # set only by `several`

    @property
    def times(self) -> Array:
        """Times of the samples [s], shape (n,)."""
        return self.knots.times

    @classmethod
    def several(cls, times: Array | Knots, poses: Array) -> list[Motion | None]:
        """Return several motions, which are solved together.

        For short motions, this is much faster than one motion after the other. A motion is None if a pose of it has no
        inverse; the other motions are not affected.

        Args:
            times: times of the samples [s], strictly rising, shape (n,), or the knots of other motions.
            poses: object-to-world matrices, shape (m, n, 4, 4).

        Raises:
            DermisError: see `Spline`.
        """
        count, n = poses.shape[:2]
        turned, flat = turns_of(poses[:, :, :3, :3].reshape(-1, 3, 3))
        made: list[Motion | None] = [None] * count
        usable = np.flatnonzero(~flat.reshape(count, n).any(axis=1)).tolist()
        if not usable:
            return made
        columns = np.empty((n, len(usable), 7))
        if np.count_nonzero(flat):
            poses, turned = poses[usable], turned.reshape(count, n, 3, 3)[usable].reshape(-1, 3, 3)
        columns[:, :, :3] = poses[:, :, :3, 3].swapaxes(0, 1)
        columns[:, :, 3:] = continuous(quaternions(turned).reshape(len(usable), n, 4)).swapaxes(0, 1)
        whole, firsts = Spline(times, columns.reshape(n, -1)), matrices(columns[0, :, 3:])
        for k, i in enumerate(usable):
            made[i] = motion = cls(whole.knots, poses[k], whole.part(slice(7 * k, 7 * k + 3)))
            motion._rotations = whole.part(slice(7 * k + 3, 7 * k + 7))
            motion.at_first = np.ascontiguousarray(firsts[k])
        return made

    @cached_property
    def rotations(self) -> Spline:
        """Spline through the unit quaternions (w, x, y, z)."""
        if self._rotations is not None:
            return self._rotations
        if (self._linear == self._linear[0]).all():
            one = quaternions(rotations(self._linear[:1]))
            return Spline(self.knots, np.repeat(one, len(self.times), axis=0))
        return Spline(self.knots, continuous(quaternions(rotations(self._linear))))

    @cached_property
    def at_first(self) -> Array:
        """Object-to-world rotation matrix at the first sample, shape (3, 3)."""
        first: Array = matrices(self.rotations.values[:1])[0]
        return first

    def at(self, t: Array) -> MotionSamples:
        """Return the motion at given times.

        Args:
            t: the times [s], shape (m,).
        """
        return MotionSamples(self, np.asarray(t, dtype=np.float64))


class MotionSamples:
    """A motion at given times: position, rotation and their derivatives.

    Each quantity is computed when it is first read.

    Attributes:
        times: the given times [s], shape (m,).
    """

    def __init__(self, motion: Motion, times: Array) -> None:
        self.times = times
        self._motion = motion
        self._piece = motion.positions.piece(times)

    @cached_property
    def position(self) -> Array:
        """Position [m], shape (m, 3)."""
        return self._motion.positions.at(self.times, 0, self._piece)

    @cached_property
    def velocity(self) -> Array:
        """Velocity [m/s], shape (m, 3)."""
        return self._motion.positions.at(self.times, 1, self._piece)

    @cached_property
    def acceleration(self) -> Array:
        """Acceleration [m/s^2], shape (m, 3)."""
        return self._motion.positions.at(self.times, 2, self._piece)

    @cached_property
    def turns(self) -> bool:
        """Whether the rotation changes at all."""
        return not self._motion.rotations.still

    @property
    def at_first(self) -> Array:
        """Object-to-world rotation matrix at the motion's first sample, shape (3, 3)."""
        return self._motion.at_first

    @cached_property
    def rotation(self) -> Array:
        """Object-to-world rotation matrices, shape (m, 3, 3)."""
        if not self.turns:
            return np.broadcast_to(self.at_first, (len(self.times), 3, 3))
        return matrices(self._quaternion)

    @cached_property
    def angular_velocity(self) -> Array:
        """Angular velocity in world axes [rad/s], shape (m, 3)."""
        if not self.turns:
            return np.zeros((len(self.times), 3))
        # Between samples, q is not of unit length. The vector part of q' q* / |q|^2 is nevertheless the same as for the
        # unit quaternion q / |q|: half the angular velocity.
        q = self._quaternion
        p = self._motion.rotations.at(self.times, 1, self._piece)
        w, v = q[:, 0], q[:, 1:]
        rate = scaled(p[:, 1:], w) - scaled(v, p[:, 0]) - cross(p[:, 1:], v)
        return scaled(rate, 2.0 / dot(q, q))

    @cached_property
    def _quaternion(self) -> Array:
        return self._motion.rotations.at(self.times, 0, self._piece)

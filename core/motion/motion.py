"""Motion: a pose that moves, and its rates."""

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
        times: [s], strictly rising, shape (n,), or those of other motions. One sample means at rest, two mean uniform
            speed.
        poses: object-to-world matrices of any invertible scale, shape (n, 4, 4).
        positions: the spline through their origins [m], where it is known.

    Raises:
        DermisError: see `Spline` and `rotations`.
    """

    def __init__(self, times: Array | Knots, poses: Array, positions: Spline | None = None) -> None:
        self.positions = Spline(times, poses[:, :3, 3]) if positions is None else positions
        self.knots = self.positions.knots
        self._linear = poses[:, :3, :3]
        self._rotations: Spline | None = None  # where they are known

    @property
    def times(self) -> Array:
        """Of the samples [s], shape (n,)."""
        return self.knots.times

    @classmethod
    def several(cls, times: Array | Knots, poses: Array) -> list[Motion | None]:
        """Return several motions, shape (m, n, 4, 4), that are solved together: of short ones that is much faster.

        One that is without an inverse at some sample is None, so that it does not take the others with it.

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
        if flat.any():
            poses, turned = poses[usable], turned.reshape(count, n, 3, 3)[usable].reshape(-1, 3, 3)
        columns[:, :, :3] = poses[:, :, :3, 3].swapaxes(0, 1)
        columns[:, :, 3:] = continuous(quaternions(turned).reshape(len(usable), n, 4)).swapaxes(0, 1)
        whole = Spline(times, columns.reshape(n, -1))
        for k, i in enumerate(usable):
            made[i] = motion = cls(whole.knots, poses[k], whole.part(slice(7 * k, 7 * k + 3)))
            motion._rotations = whole.part(slice(7 * k + 3, 7 * k + 7))
        return made

    @cached_property
    def rotations(self) -> Spline:
        """The spline through the unit quaternions (w, x, y, z)."""
        if self._rotations is not None:
            return self._rotations
        if (self._linear == self._linear[0]).all():
            one = quaternions(rotations(self._linear[:1]))
            return Spline(self.knots, np.repeat(one, len(self.times), axis=0))
        return Spline(self.knots, continuous(quaternions(rotations(self._linear))))

    @cached_property
    def at_first(self) -> Array:
        """The object-to-world rotation matrix at the first sample, shape (3, 3)."""
        first: Array = matrices(self.rotations.values[:1])[0]
        return first

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
            return np.broadcast_to(self._motion.at_first, (len(self.times), 3, 3))
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

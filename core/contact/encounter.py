"""Encounter: contact of one pad with one body at a device's rate.

Between samples of the sweep, the gap is a cubic Hermite curve. Its slopes are the pad's velocity along the normal
relative to the body. The curve is exact for a plane and motion that is cubic between samples. The instant of contact is
computed from it and not rounded to the device's times.

Positions and velocities are in the body's *carried* space, which turns with the body and has metric lengths.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..motion import MotionSamples
from ..motion.vectors import cross, dot, scaled, turn, turn_back
from .pad_contact import PadContact, PairContact

Which = slice | NDArray[np.intp]

# Largest number of iterations of the root finder, and the error of the gap at which it stops [m].
ROOT_STEPS = 60
ROOT_TOLERANCE = 1e-13
# A pair whose gap exceeds the touch distance by more than this at all samples is not evaluated between them [m].
DIP = 0.01


class Encounter:
    """Times of contact between a pad and a body, with contact points and velocities.

    Args:
        pad_contact: contact of the pads over the whole range.
        finger, body: indices of a pair that came within reach.
        times: the device's times [s], shape (m,).
        distance: touch distance: the pad touches at or below this gap [m], one number or shape (m,).
    """

    def __init__(self, pad_contact: PadContact, finger: int, body: int, times: Array, distance: float | Array) -> None:
        self.times = times
        self.finger, self.body, self.distance = finger, body, distance
        self._pad_contact = pad_contact
        self._pair: PairContact = pad_contact.pairs[finger, body]
        self._known = np.isfinite(self._pair.gap)
        self._whole = bool(self._known.all())  # whether the gap is known at all samples

    @cached_property
    def gap(self) -> Array:
        """Signed gap at the device's times [m], shape (m,); inf if it is not known."""
        return self._gap_at(self.times)

    @cached_property
    def touching(self) -> NDArray[np.bool_]:
        """Whether the pad touches, shape (m,)."""
        return self.gap <= self.distance

    @cached_property
    def which(self) -> Which:
        """Indices of the touching samples, as a slice if they are consecutive."""
        return indices_of(self.touching)

    @cached_property
    def any(self) -> bool:
        """Whether the pad ever touches."""
        near = self._pair.gap if self._whole else self._pair.gap[self._known]
        farthest = self.distance.max() if isinstance(self.distance, np.ndarray) else self.distance
        return bool(near.size and near.min() <= farthest + DIP and self.touching.any())

    @cached_property
    def onsets(self) -> Array:
        """Instants at which contact begins [s], shape (e,); contact at the first sample has none."""
        began = (self.touching[1:] & ~self.touching[:-1]).nonzero()[0] + 1
        if began.size == 0:
            return np.zeros(0)
        known = np.isfinite(self.gap[began - 1])
        instants = self.times[began].copy()  # without a known gap before, the time of the sample
        instants[known] = self._roots(began[known])
        return instants

    @cached_property
    def onset_velocities(self) -> Array:
        """Velocity of the pad relative to the body at each onset in world axes [m/s], shape (e, 3)."""
        if self.onsets.size == 0:
            return np.zeros((0, 3))
        finger = self._pad_contact.finger_motion(self.finger).at(self.onsets)
        body = self._pad_contact.body_motion(self.body).at(self.onsets)
        relative = _relative_velocity(finger, body)
        moving = self._pair.surface_velocity
        if moving is not None:
            local = moving[self._nearest(self.onsets)]
            relative = relative - turn(body.rotation, local)
        return relative

    @cached_property
    def velocity(self) -> Array:
        """Velocity of the pad over the body at the touching samples, in carried space [m/s], shape (k, 3)."""
        finger = self._pad_contact.finger_at(self.finger, self.times)
        body = self._pad_contact.body_at(self.body, self.times)
        # In Fortran order, as from `between`: adding arrays of different orders is much slower.
        local = np.asfortranarray(turned_back(body, self.which, _relative_velocity(finger, body, self.which)))
        moving = self._pair.surface_velocity
        return local if moving is None else local - self.between(moving)

    @cached_property
    def normal(self) -> Array:
        """Outward normal of the body at the touching samples, in carried space, shape (k, 3)."""
        n = self.between(self._carried_normal)
        return scaled(n, 1.0 / np.maximum(np.sqrt(dot(n, n)), 1e-300))

    @cached_property
    def point(self) -> Array:
        """Closest point of the body at the touching samples, in carried space [m], shape (k, 3).

        The pad's path is evaluated at the device's times. Only the vector from the pad to the surface is interpolated.
        """
        finger = self._pad_contact.finger_at(self.finger, self.times)
        body = self._pad_contact.body_at(self.body, self.times)
        offset = finger.position[self.which] - body.position[self.which]
        return np.asfortranarray(turned_back(body, self.which, offset)) + self.between(self._to_surface)

    # -- between the samples -------------------------------------------------------------------------------------

    @cached_property
    def _at_samples(self) -> tuple[MotionSamples, MotionSamples]:
        pad_contact = self._pad_contact
        return pad_contact.finger_at(self.finger, pad_contact.times), pad_contact.body_at(self.body, pad_contact.times)

    @cached_property
    def _carried_normal(self) -> Array:
        return turned_back(self._at_samples[1], slice(None), self._pair.normal)

    @cached_property
    def _to_surface(self) -> Array:
        finger, body = self._at_samples
        return self._pair.point - turned_back(body, slice(None), finger.position - body.position)

    @cached_property
    def _slope(self) -> Array:
        """Rate of the gap at the samples [m/s], shape (n,)."""
        rate = dot(self._pair.normal, _relative_velocity(*self._at_samples))
        moving = self._pair.surface_velocity
        return rate if moving is None else rate - dot(self._carried_normal, moving)

    def _gap_at(self, t: Array) -> Array:
        times, gap = self._pad_contact.times, self._pair.gap
        if len(times) == 1:
            return np.full(len(t), gap[0])
        index, since = self._pad_contact.knots.piece(t)
        if self._whole:
            return self._hermite(index, since)
        start, end = gap[index], gap[index + 1]
        known = self._known[index] & self._known[index + 1]
        # Between a known and an unknown sample, the gap is known only at the former.
        out = np.where(since == 0.0, start, np.where(t == times[index + 1], end, np.inf))
        out[known] = self._hermite(index[known], since[known])
        return out

    @cached_property
    def _pieces(self) -> Array:
        """Duration of each piece between samples, and coefficients of the gap over its course, shape (5, n - 1)."""
        gap = self._pair.gap if self._whole else np.where(self._known, self._pair.gap, 0.0)
        slope, step = self._slope, self._pad_contact.knots.steps
        rise, first, last = gap[1:] - gap[:-1], slope[:-1] * step, slope[1:] * step
        return np.array([step, gap[:-1], first, 3.0 * rise - 2.0 * first - last, first + last - 2.0 * rise])

    def _hermite(self, index: NDArray[np.intp], since: Array) -> Array:
        step, start, first, second, third = self._pieces.take(index, axis=1)
        u = since / step
        return np.asarray(start + u * (first + u * (second + u * third)))

    def _roots(self, began: NDArray[np.intp]) -> Array:
        """Return the time before each sample at which the gap equals the touch distance, by the Illinois method."""
        distance = np.broadcast_to(self.distance, self.times.shape)[began]
        low, high = self.times[began - 1], self.times[began]
        f_low, f_high = np.maximum(self.gap[began - 1] - distance, 0.0), self.gap[began] - distance
        root = high.copy()
        for _ in range(ROOT_STEPS):
            span = f_low - f_high
            root = np.where(span > 0.0, high - f_high * (low - high) / np.where(span > 0.0, span, 1.0), high)
            value = self._gap_at(root) - distance
            if (np.abs(value) <= ROOT_TOLERANCE).all():
                break
            left = value > 0.0
            # The value at an end that does not move is halved, so that both ends converge.
            f_high = np.where(left, f_high * 0.5, value)
            f_low = np.where(left, value, f_low * 0.5)
            low, high = np.where(left, root, low), np.where(left, high, root)
        return root

    def _nearest(self, t: Array) -> NDArray[np.intp]:
        """Return the index of the nearest sample with a known gap for each time, shape (e,)."""
        known = np.flatnonzero(self._known)
        after = np.clip(np.searchsorted(self._pad_contact.times[known], t), 1, max(len(known) - 1, 1))
        if len(known) == 1:
            return np.full(len(t), known[0])
        earlier, later = known[after - 1], known[after]
        nearer = t - self._pad_contact.times[earlier] <= self._pad_contact.times[later] - t
        return np.where(nearer, earlier, later)

    @cached_property
    def _weights(self) -> tuple[NDArray[np.intp], Array]:
        index, since = self._pad_contact.knots.piece(self.times)
        index, since = index[self.which], since[self.which]
        if len(self._pad_contact.times) == 1:
            return index, np.zeros(len(index))
        u = since / self._pad_contact.knots.steps[index]
        if not self._whole:  # if only one of the two samples is known, its value is used
            u = np.where(self._known[index + 1], np.where(self._known[index], u, 1.0), 0.0)
        return index, u

    def between(self, samples: Array) -> Array:
        """Interpolate a series of samples, shape (n, 3), linearly at the touching times, shape (k, 3)."""
        index, u = self._weights
        if len(samples) == 1:
            return samples[index]
        by_component = np.ascontiguousarray(samples.T)
        start = by_component.take(index, axis=1)
        rise = by_component.take(index + 1, axis=1)
        rise -= start
        rise *= u
        rise += start
        return rise.T


def encounter(
    pad_contact: PadContact, finger: int, body: int, times: Array, distance: float | Array
) -> Encounter | None:
    """Return the encounter of a pair, kept for the same times; None if they never touch."""
    if (finger, body) not in pad_contact.pairs:
        return None
    made: Encounter = pad_contact.keep(
        ("encounter", finger, body, len(times)), lambda: Encounter(pad_contact, finger, body, times, distance), times
    )
    return made if made.any else None


def indices_of(mask: NDArray[np.bool_]) -> Which:
    """Return the indices at which a mask is true, as a slice if they are consecutive, which avoids copies."""
    index = mask.nonzero()[0]
    if index.size and index[-1] - index[0] + 1 == index.size:
        return slice(int(index[0]), int(index[-1]) + 1)
    return index


def turned_back(samples: MotionSamples, which: Which, vectors: Array) -> Array:
    """Turn vectors, shape (k, 3), from world axes to the axes of a moving frame at given samples."""
    if samples.turns:
        return turn_back(samples.rotation[which], vectors)
    return vectors @ samples.at_first


def turned(samples: MotionSamples, which: Which, vectors: Array) -> Array:
    """Turn vectors, shape (k, 3), from the axes of a moving frame at given samples to world axes."""
    if samples.turns:
        return turn(samples.rotation[which], vectors)
    return vectors @ samples.at_first.T


def _relative_velocity(finger: MotionSamples, body: MotionSamples, which: Which = slice(None)) -> Array:
    """Return the velocity of the pad relative to the body's material at the pad, in world axes [m/s]."""
    relative = finger.velocity[which] - body.velocity[which]
    if not body.turns:
        return relative
    return relative - cross(body.angular_velocity[which], finger.position[which] - body.position[which])

"""RoundedPath: acceleration of a path whose kinks are rounded.

A kink is a jump of the velocity. Straight lines between keys, steps and baked captures have kinks. A jump needs an
infinite acceleration, but a body with inertia needs a finite time for it. A sample is a kink if its change of velocity
is an outlier among the samples around it. A smooth path has no kinks, and its acceleration is unchanged to the last
digit.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..arrays import Array, Indices
from .spline import Spline

# A change of velocity is a kink if its distance from the local median is more than OUTLIER times the median distance of
# the changes at the BESIDE samples to either side, plus `least`.
OUTLIER, BESIDE = 5.0, 3


class RoundedPath:
    """The acceleration of a sampled path whose kinks are rounded.

    The acceleration of the smooth part of the path is that of its spline. Each jump of velocity adds an acceleration
    around its kink. It is a raised cosine of duration `over`, and the integral of this cosine is the whole jump.

    Args:
        times: times of the samples [s], strictly rising, shape (n,).
        values: positions at the samples, shape (n, k).
        over: time that a change of velocity takes [s]. It is lengthened to two steps of the samples if it is shorter; 0
            leaves the kinks as they are.
        least: least change of velocity that counts as a kink, in units of the values per second.

    Attributes:
        samples: indices of the kinks.
        changes: jumps of the velocity at the kinks, shape (len(samples), k).
    """

    def __init__(self, times: Array, values: Array, over: float, least: float) -> None:
        self._times, self._values, self._over = times, values, over
        self.samples, self.changes = _kinks(times, values, least)

    @cached_property
    def acceleration(self) -> Array:
        """Acceleration at the samples, shape (n, k)."""
        times = self._times
        if not (self._over > 0.0 and len(self.samples)):
            return Spline(times, self._values).at(times, 2)
        change = np.zeros_like(self._values)
        change[self.samples] = self.changes
        velocity = np.cumsum(change, axis=0)[:-1]
        ramps = np.concatenate(
            [np.zeros((1, velocity.shape[1])), np.cumsum(velocity * np.diff(times)[:, None], axis=0)]
        )
        out = np.array(Spline(times, self._values - ramps).at(times, 2))
        for k, change_k in zip(self.samples, self.changes, strict=True):
            over = max(self._over, times[k + 1] - times[k - 1])
            first, end = np.searchsorted(times, (times[k] - over / 2.0, times[k] + over / 2.0))
            share = (1.0 + np.cos(2.0 * np.pi * (times[first:end] - times[k]) / over)) / over
            out[first:end] += share[:, None] * change_k
        return out


def _kinks(times: Array, values: Array, least: float) -> tuple[Indices, Array]:
    """Return the indices of kinks, and the jumps of velocity at them.

    A jump is the change of velocity minus the change that is interpolated from the smooth samples around it.
    """
    change = np.diff(np.diff(values, axis=0) / np.diff(times)[:, None], axis=0)
    none: Indices = np.zeros(0, dtype=np.intp)
    if len(change) <= BESIDE:
        return none, np.zeros((0, values.shape[1]))
    around = np.lib.stride_tricks.sliding_window_view(
        np.pad(change, ((BESIDE, BESIDE), (0, 0)), mode="reflect"), 2 * BESIDE + 1, axis=0
    )
    middle = np.median(around, axis=2)
    usual = np.median(np.linalg.norm(around - middle[:, :, None], axis=1), axis=1)
    kinked = np.linalg.norm(change - middle, axis=1) > OUTLIER * usual + least
    which = np.flatnonzero(kinked)
    smooth = np.flatnonzero(~kinked)
    if not (which.size and smooth.size):
        return none, np.zeros((0, values.shape[1]))
    expected = np.stack([np.interp(which, smooth, column[smooth]) for column in change.T], axis=1)
    return which + 1, change[which] - expected

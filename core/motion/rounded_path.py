"""Kinks: samples at which a path changes its velocity at once, and the path's acceleration with them rounded.

Keys joined by straight lines, steps and baked captures have kinks. Between two samples no finite acceleration takes a
body round them, so a body with inertia takes its time. A kink is a change of velocity that stands out from those
at the samples about it; a smooth path has none, and keeps its acceleration to the last digit.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..arrays import Array, Indices
from .spline import Spline

# A kink is this many times as far from the median of its neighbourhood as these samples to either side mostly are.
OUTLIER, BESIDE = 5.0, 3


class RoundedPath:
    """The acceleration of a sampled path whose kinks are rounded.

    The path is taken apart into a smooth one and a change of velocity at each kink; the smooth one's acceleration is
    its spline's, and each change is spread over `over` by a raised cosine about the kink, so that all of it is made.

    Args:
        times: [s], strictly rising, shape (n,). values: shape (n, k).
        over: time that a change of velocity takes [s], at least two samples; 0 leaves the kinks as they are.
        least: change of velocity below which there is no kink, in units of the values per second.

    Attributes:
        samples: where the kinks are. changes: of the velocity there, shape (len(samples), k).
    """

    def __init__(self, times: Array, values: Array, over: float, least: float) -> None:
        self._times, self._values, self._over = times, values, over
        self.samples, self.changes = _kinks(times, values, least)

    @cached_property
    def acceleration(self) -> Array:
        """At the samples, shape (n, k)."""
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
    """Return the samples of kinks, and by how much the velocity changes there more than about them."""
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

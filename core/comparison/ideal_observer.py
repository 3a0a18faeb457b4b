"""Ideal observer: discrimination of two touches from all afferents.

The observer uses the whole response, without loss. A pair of rendered touches is judged in two respects. *Told apart*:
any difference between the two responses counts. *Taken for*: the observer knows the real touches, and only the part of
the difference along the difference of the real responses counts. If a device renders two touches differently, but not
in the direction in which the real touches differ, its score is high in the first respect and low in the second.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..arrays import Array


@dataclass(frozen=True)
class Answer:
    """Discriminability of two touches.

    Attributes:
        apart: d' of any difference.
        as_real: d' along the difference of the real touches. It is negative if the device renders each touch more like
            the other real touch.
    """

    apart: float
    as_real: float

    @property
    def right(self) -> float:
        """Share of right answers of an observer who knows the real touches.

        The observer is unbiased; the share is 0.5 for guessing.
        """
        return 0.5 * (1.0 + math.erf(self.as_real / math.sqrt(8.0)))


def told(first: Array, second: Array, noise: float, real: tuple[Array, Array] | None = None) -> Answer:
    """Return the discriminability of two touches from the responses to them.

    Args:
        first, second: responses to the two touches, one for each repetition, shape (r, ...). Repetitions may differ, as
            those of a person do.
        noise: standard deviation of each number of a response.
        real: responses to the two real touches, like `first` and `second`; None if `first` and `second` are the real
            touches.
    """
    one, other = (np.asarray(x, np.float64).reshape(len(x), -1) for x in (first, second))
    apart = other.mean(axis=0) - one.mean(axis=0)
    known = apart
    if real is not None:
        known = np.mean(real[1], axis=0).ravel() - np.mean(real[0], axis=0).ravel()
    return Answer(_along(apart, one, other, noise), _along(known, one, other, noise))


def _along(direction: Array, first: Array, second: Array, noise: float) -> float:
    """Return d' along a direction.

    It is the distance of the means, divided by the standard deviation. The variance is that of the noise plus that
    of the repetitions.
    """
    size = float(np.linalg.norm(direction))
    if size <= 0.0:
        return 0.0
    unit = direction / size
    one, other = first @ unit, second @ unit
    spread = 0.5 * (np.var(one, ddof=1) + np.var(other, ddof=1)) if len(one) > 1 and len(other) > 1 else 0.0
    return float((other.mean() - one.mean()) / np.sqrt(noise**2 + spread))

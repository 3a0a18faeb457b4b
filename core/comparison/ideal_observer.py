"""Ideal observer: how well one who reads all afferents, and wastes nothing, could tell two touches apart.

Two questions are asked of a rendered pair of touches. *Told apart* counts any difference between the two, whatever it
feels like. *Taken for* counts only what tells the real touches apart: one who knows those from life, and has no other
clue, weighs the response as the real ones teach. A device that renders two touches as different, but not as they
differ, scores in the first and not in the second.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..arrays import Array


@dataclass(frozen=True)
class Answer:
    """How well two touches are told apart.

    Attributes:
        apart: d' of any difference. as_real: d' along the difference of the real touches; below zero where the device
            makes each feel more like the other.
    """

    apart: float
    as_real: float

    @property
    def right(self) -> float:
        """Share of right answers of one who knows the real touches, without bias: 0.5 is guessing."""
        return 0.5 * (1.0 + math.erf(self.as_real / math.sqrt(8.0)))


def told(first: Array, second: Array, noise: float, real: tuple[Array, Array] | None = None) -> Answer:
    """Return how well two touches are told apart from the responses to them.

    Args:
        first, second: responses to the two touches, one for each repetition, shape (r, ...). Repetitions differ a
            little, as people's do.
        noise: standard deviation of each number read.
        real: the same of the real touches; the two themselves where None.
    """
    one, other = (np.asarray(x, np.float64).reshape(len(x), -1) for x in (first, second))
    apart = other.mean(axis=0) - one.mean(axis=0)
    known = apart
    if real is not None:
        known = np.mean(real[1], axis=0).ravel() - np.mean(real[0], axis=0).ravel()
    return Answer(_along(apart, one, other, noise), _along(known, one, other, noise))


def _along(direction: Array, first: Array, second: Array, noise: float) -> float:
    """Return d' of responses along a direction: noise and the repetitions' own spread stand against it."""
    size = float(np.linalg.norm(direction))
    if size <= 0.0:
        return 0.0
    unit = direction / size
    one, other = first @ unit, second @ unit
    spread = 0.5 * (np.var(one, ddof=1) + np.var(other, ddof=1)) if len(one) > 1 and len(other) > 1 else 0.0
    return float((other.mean() - one.mean()) / np.sqrt(noise**2 + spread))

"""Memory: state that is carried on where a scene is computed window by window, as in a preview.

A bake begins at rest and sees its whole range. A preview sees the last moments only. A bake carries state over from
before them: a direction held, taps that still ring, the swing of a content. It stands here under names, as it was where
the window's device times begin; the same is noted for where those of the next window will begin.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import numpy as np

from .arrays import Array

ROUNDING = 1e-9  # of a step between two device times


@dataclass
class Carry:
    """A state to begin with, and the state that is wanted.

    Attributes:
        start: the state at the first time; None for rest.
        index: sample at which the state is wanted. found: that state, filled in by who computes; None if it never was.
    """

    start: Any = None
    index: int = 0
    found: Any = None


class Memory:
    """State at one instant, and at a later one.

    Args:
        start: where the device times begin [s]. until: where those of the next window will begin [s], later or equal.
        now: where they end [s]. before: the state at `start`; None for rest.
        lasting: objects that hold for every window.
    """

    def __init__(
        self,
        start: float,
        until: float,
        now: float,
        before: Mapping[Hashable, Any] | None = None,
        lasting: dict[Hashable, Any] | None = None,
    ) -> None:
        self._start, self._until, self._now = start, until, now
        self._before = before or {}
        self.noted = dict(self._before)  # entries that nothing renews still hold
        self._lasting = {} if lasting is None else lasting

    def times(self, rate: float) -> Array:
        """Return the device times of the window at a rate [Hz], on the grid of the scene's range [s], shape (n,)."""
        return np.arange(_step(self._start, rate), np.ceil(self._now * rate - ROUNDING) + 1.0) / rate

    def carry(self, key: Hashable, times: Array) -> AbstractContextManager[Carry]:
        """Give the state noted under a name at the first device time, and note the state found for the next window."""
        slack = ROUNDING * float(times[1] - times[0]) if len(times) > 1 else 0.0
        index = max(int(times.searchsorted(self._until + slack, "right")) - 1, 0)
        return _Noting(self.noted, key, Carry(self._before.get(key), index))

    def lasting(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return an object that is made once and holds for every window."""
        if key not in self._lasting:
            self._lasting[key] = make()
        return self._lasting[key]


class _Noting:
    """Notes the state that a `Carry` has found when its block ends."""

    def __init__(self, noted: dict[Hashable, Any], key: Hashable, carry: Carry) -> None:
        self._noted, self._key, self._carry = noted, key, carry

    def __enter__(self) -> Carry:
        return self._carry

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        if error is None:
            self._noted[self._key] = self._carry.found


def _step(time: float, rate: float) -> int:
    return int(np.floor(time * rate + ROUNDING))

"""Memory: state that a preview carries from one time window to the next.

A bake begins at rest and computes its whole range. A preview computes only a window of the last moments. State from
before the window still affects the window: a direction that is held, taps that still ring, the swing of contents. A
`Memory` holds each such state under a key, as it was at the start of the window's device times. It also stores each
state at the time at which the device times of the next window will start.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import numpy as np

from .arrays import Array

ROUNDING = 1e-9  # times that differ by less than this share of a step between device times count as equal


@dataclass
class Carry:
    """State of an effect at the first sample, and at a later one.

    Attributes:
        start: state at the first sample; None for rest.
        index: index of the sample at which the next window will start.
        found: state at sample `index`. The code that computes the effect sets it; None stands for rest.
    """

    start: Any = None
    index: int = 0
    found: Any = None


class Memory:
    """States at the start of a window, and at the start of the next one.

    Args:
        start: start of the device times of the window [s].
        until: start of the device times of the next window [s], not before `start`.
        now: end of the device times of the window [s].
        before: states at `start`, by key; None if all are at rest.
        lasting: objects that are valid for all windows, by key; None for none yet.

    Attributes:
        noted: states at `until`, by key.
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
        self.noted = dict(self._before)  # a state stays valid until it is replaced
        self._lasting = {} if lasting is None else lasting
        self._last: tuple[Array | None, int] = (None, 0)  # device times, and the index at which the next window starts

    def times(self, rate: float) -> Array:
        """Return the device times of the window [s], shape (n,).

        They are multiples of 1 / rate, from the last one at or before `start` to the first one at or after `now`.

        Args:
            rate: rate of the device [Hz].
        """
        return np.arange(_step(self._start, rate), np.ceil(self._now * rate - ROUNDING) + 1.0) / rate

    def carry(self, key: Hashable, times: Array) -> AbstractContextManager[Carry]:
        """Return a context manager that gives the `Carry` of a key.

        At the end of the block, the `found` of the `Carry` is stored for the next window. Nothing is stored if the
        block raises an exception.

        Args:
            key: key of the state.
            times: device times of the window [s], shape (n,).
        """
        if self._last[0] is not times:
            slack = ROUNDING * float(times[1] - times[0]) if len(times) > 1 else 0.0
            self._last = times, max(int(times.searchsorted(self._until + slack, "right")) - 1, 0)
        return _Noting(self.noted, key, Carry(self._before.get(key), self._last[1]))

    def lasting(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return the object of a key, made once by `make` for all windows."""
        if key not in self._lasting:
            self._lasting[key] = make()
        return self._lasting[key]


class _Noting:
    """Context manager of `Memory.carry`."""

    def __init__(self, noted: dict[Hashable, Any], key: Hashable, carry: Carry) -> None:
        self._noted, self._key, self._carry = noted, key, carry

    def __enter__(self) -> Carry:
        return self._carry

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        if error is None:
            self._noted[self._key] = self._carry.found


def _step(time: float, rate: float) -> int:
    return int(np.floor(time * rate + ROUNDING))

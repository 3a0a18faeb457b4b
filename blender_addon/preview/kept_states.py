"""States on the way through the frames, kept so that a jump back need not begin at rest."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from ..scene_time import Clock
from .rows import goes_on

S = TypeVar("S")

SPACING = 3.0  # frames from one kept state to the next; `goes_on` bridges more at any usual rate
STATES = 32  # so many: four seconds of a play


class KeptStates(Generic[S]):
    """States by the frame that they were reached at, until their inputs change and somebody clears them."""

    def __init__(self) -> None:
        self._states: dict[float, S] = {}

    def keep(self, frame: float, state: Callable[[], S], most: int = STATES) -> None:
        """Keep the state at a frame, unless one is kept that was reached just before; the oldest makes room."""
        if [other for other in self._states if 0.0 < frame - other < SPACING]:
            return
        self._states.pop(frame, None)
        self._states[frame] = state()
        while len(self._states) > most:
            del self._states[next(iter(self._states))]

    def nearest(self, frame: float, clock: Clock) -> tuple[float, S] | None:
        """Return the nearest kept state from which a frame can be stepped to, and its own frame; None without one."""
        near = [other for other in self._states if goes_on(clock.duration(frame - other))]
        return (max(near), self._states[max(near)]) if near else None

    def clear(self) -> None:
        """Forget them all."""
        self._states.clear()

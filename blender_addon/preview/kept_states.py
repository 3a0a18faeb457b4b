"""States at visited frames, kept so that a jump need not begin at rest."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from ..scene_time import Clock
from .rows import goes_on

S = TypeVar("S")

SPACING = 3.0  # frames between two kept states; at any usual frame rate, `goes_on` accepts longer steps
STATES = 32  # largest number of kept states: four seconds of playback


class KeptStates(Generic[S]):
    """States by frame; the owner clears them when their inputs change."""

    def __init__(self) -> None:
        self._states: dict[float, S] = {}

    def keep(self, frame: float, state: Callable[[], S], most: int = STATES) -> None:
        """Keep the state at a frame, unless one shortly before is kept.

        Shortly before is less than `SPACING` frames before.
        Args:
            frame: the frame. state: function that returns its state.
            most: largest number of states; beyond it, the oldest one is dropped.
        """
        if [other for other in self._states if 0.0 < frame - other < SPACING]:
            return
        self._states.pop(frame, None)
        self._states[frame] = state()
        while len(self._states) > most:
            del self._states[next(iter(self._states))]

    def nearest(self, frame: float, clock: Clock) -> tuple[float, S] | None:
        """Return the kept frame and state from which a step reaches `frame`.

        Of several, they are the nearest before `frame`. None without one.
        """
        near = [other for other in self._states if goes_on(clock.duration(frame - other))]
        return (max(near), self._states[max(near)]) if near else None

    def clear(self) -> None:
        """Forget them all."""
        self._states.clear()

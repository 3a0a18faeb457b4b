"""This computer beside a check: how long it kept this program from running, so that a board is not blamed for it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

ATTEMPTS = 3  # a check that this computer may have spoilt is tried so often
DISTURBS = 0.02  # a program that stood still for this long may have let a board's watchdog of 50 ms act [s] ...
SHARE = (
    0.02  # ... and where it waited for a processor this part of the time, whatever else a check needs did so too [1]
)
NOTED = 1e-4  # shorter delays are not kept [s]


class Host:
    """Times at which this program could not run.

    Lateness is the part of an interval in which the program neither slept as it meant to nor used the processor.

    Args:
        clock, sleep: clock and sleep function of this computer.
        used: processor time used by this thread [s].
    """

    def __init__(
        self, clock: Callable[[], float], sleep: Callable[[float], None], used: Callable[[], float] = time.thread_time
    ) -> None:
        self._clock, self._sleep, self._used = clock, sleep, used
        self._late: deque[tuple[float, float]] = deque(maxlen=100_000)  # when it was noticed, how long it was [s]
        self._seen, self._seen_used = clock(), used()

    def sleep(self, seconds: float) -> None:
        """Sleep, and note the excess delay [s]."""
        self.look()
        self._sleep(seconds)
        self._note(self._clock() - self._seen - seconds)
        self._seen, self._seen_used = self._clock(), self._used()

    def look(self) -> None:
        """Note how long this program was kept from running since the last look."""
        now, used = self._clock(), self._used()
        self._note(now - self._seen - (used - self._seen_used))
        self._seen, self._seen_used = now, used

    def worst(self, since: float) -> float:
        """Return the longest single delay since a moment [s]."""
        self.look()
        return max((late for at, late in self._since(since)), default=0.0)

    def lost(self, since: float) -> float:
        """Return all delays since a moment together [s]."""
        self.look()
        return sum(late for at, late in self._since(since))

    def disturbed(self, since: float) -> bool:
        """Return whether this computer may have spoilt the attempts since a moment."""
        return self.worst(since) >= DISTURBS or self.lost(since) > SHARE * max(self._clock() - since, 0.0)

    def words(self, since: float) -> str:
        """Say how busy this computer was since a moment."""
        worst, lost, passed = self.worst(since), self.lost(since), self._clock() - since
        return (
            f"this computer was busy: it kept this program from running for up to {1e3 * worst:.0f} ms at a time, "
            f"{lost:.2g} s of {passed:.2g} s"
        )

    def _note(self, late: float) -> None:
        if late > NOTED:
            self._late.append((self._clock(), late))

    def _since(self, since: float) -> list[tuple[float, float]]:
        found = []
        for at, late in reversed(self._late):
            if at < since:
                break
            found.append((at, late))
        return found

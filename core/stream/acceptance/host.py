"""Delays of this computer during a check.

Times in which it kept this program from running are measured, so that they are not counted as faults of a board.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

ATTEMPTS = 3  # number of attempts at a check that this computer may have disturbed
DISTURBS = 0.02  # [s] a single delay of this length may have let a board's watchdog of 50 ms act
# [1] if this program waited for a processor for this part of the time, other programs that a check needs did so, too.
SHARE = 0.02
NOTED = 1e-4  # [s] shorter delays are not recorded


class Host:
    """Times at which this program could not run.

    A delay is the part of an interval in which the program neither slept as requested nor used the processor.

    Args:
        clock, sleep: clock and sleep function of this computer.
        used: returns the processor time used by this thread [s].
    """

    def __init__(
        self, clock: Callable[[], float], sleep: Callable[[float], None], used: Callable[[], float] = time.thread_time
    ) -> None:
        self._clock, self._sleep, self._used = clock, sleep, used
        self._late: deque[tuple[float, float]] = deque(maxlen=100_000)  # [s] time and length of each delay
        self._seen, self._seen_used = clock(), used()

    def sleep(self, seconds: float) -> None:
        """Sleep for a time [s], and record the delay beyond it."""
        self.look()
        self._sleep(seconds)
        self._note(self._clock() - self._seen - seconds)
        self._seen, self._seen_used = self._clock(), self._used()

    def look(self) -> None:
        """Record the delay since the last call, or since the last sleep."""
        now, used = self._clock(), self._used()
        self._note(now - self._seen - (used - self._seen_used))
        self._seen, self._seen_used = now, used

    def worst(self, since: float) -> float:
        """Return the longest single delay [s] since a time [s]."""
        self.look()
        return max((late for at, late in self._since(since)), default=0.0)

    def lost(self, since: float) -> float:
        """Return the sum of all delays [s] since a time [s]."""
        self.look()
        return sum(late for at, late in self._since(since))

    def disturbed(self, since: float) -> bool:
        """Return whether delays since a time [s] may have caused a failure."""
        return self.worst(since) >= DISTURBS or self.lost(since) > SHARE * max(self._clock() - since, 0.0)

    def words(self, since: float) -> str:
        """Return a phrase for people about the delays since a time [s]."""
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

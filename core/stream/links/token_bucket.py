"""How many bytes may leave now: a bucket that fills at a pace."""

from __future__ import annotations

import math

BURST = 0.005  # of the pace that may leave at once, so that a sender that woke up late can catch up [s]


class TokenBucket:
    """Holds the right to send, in bytes; without a pace there is always enough.

    Args:
        pace: rate at which the bucket fills [bytes/s].
        most: the rate while nothing is queued [bytes/s].
        burst: time of filling whose bytes may leave at once [s].
    """

    def __init__(self, pace: float = math.inf, most: float = math.inf, burst: float = BURST) -> None:
        self._pace, self._most, self._burst = pace, most, burst
        self._tokens, self._when = 0.0, -math.inf

    def open(self, now: float, *, prompt: bool) -> bool:
        """Return whether something may leave; `prompt`: nothing waits on the way."""
        if self._pace == math.inf:
            return True
        pace = self._most if prompt else self._pace
        self._tokens = min(self._tokens + (now - self._when) * pace, self._burst * self._pace)
        self._when = now
        return self._tokens > 0

    def take(self, size: int) -> None:
        """Take out the bytes that have left, allowed or not."""
        self._tokens -= size

"""A token bucket, which limits the rate of bytes that are sent."""

from __future__ import annotations

import math

BURST = 0.005  # [s] filling time of the bytes that may be sent at once, so that a late sender can catch up


class TokenBucket:
    """A bucket of bytes that may be sent.

    With an infinite pace every message may be sent.

    Args:
        pace: rate at which the bucket fills [bytes/s].
        most: rate at which it fills while nothing queues on the link [bytes/s].
        burst: time of filling whose bytes may leave at once [s].
    """

    def __init__(self, pace: float = math.inf, most: float = math.inf, burst: float = BURST) -> None:
        self._pace, self._most, self._burst = pace, most, burst
        self._tokens, self._when = 0.0, -math.inf

    def open(self, now: float, *, prompt: bool) -> bool:
        """Return whether a message may be sent; `prompt`: nothing queues on the link."""
        if self._pace == math.inf:
            return True
        pace = self._most if prompt else self._pace
        self._tokens = min(self._tokens + (now - self._when) * pace, self._burst * self._pace)
        self._when = now
        return self._tokens > 0

    def take(self, size: int) -> None:
        """Take out the bytes of a message that was sent, allowed or not."""
        self._tokens -= size

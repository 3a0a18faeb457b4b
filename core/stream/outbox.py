"""The order of messages on one link: the protocol's own first, then commands; and the messages without room."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable
from enum import Enum

from ..arrays import Array
from .links.token_bucket import TokenBucket
from .links.transport import Transport
from .protocols.adapter import Adapter

MEMORY = 0.5  # a link that was congested without a word is not hurried for this long [s]
MAX_WAITING = 16  # messages of the protocol's own that wait for room in the link


class SendResult(Enum):
    """The outcome of a command."""

    SENT = "it left"
    UNSENT = "the link is full or busy, but there is time: it waits, and others behind it"
    DROPPED = "the link is full, and its time has come"


class Outbox:
    """Messages of an adapter on their way into a link that never waits; the outcomes are counted.

    Commands leave no faster than the link carries them, even one that takes more: bytes in a driver arrive when their
    sender is dead, and keep the device's watchdog quiet until then.

    Args:
        bucket: how fast commands may leave.
        clock: read again just before a command leaves; None: the time handed in is the time that it leaves.

    Attributes:
        left_at: when something left last, a message or a part of the bytes that wait in the link [s].
        silence: the longest time since `begin` in which nothing left, if the board counts that as silence; else 0 [s].
        unsent: values and play-out time of a command that waits for room or for an answer; None: there is none.
    """

    def __init__(
        self,
        link: Transport,
        adapter: Adapter,
        counters: Counter[str],
        bucket: TokenBucket,
        clock: Callable[[], float] | None = None,
    ) -> None:
        self._link, self._adapter, self._counters, self._bucket, self._clock = link, adapter, counters, bucket, clock
        self.left_at, self.silence = -math.inf, 0.0
        self._in_link = 0  # bytes that waited in the link when it had no room last
        self._waiting: deque[bytes] = deque()
        self._refused = self._crowded = -math.inf  # when the link had no room last; when it said so too late [s]
        self.unsent: tuple[Array, float | None] | None = None

    @property
    def blocked(self) -> bool:
        """Return whether something waits for room."""
        return self.unsent is not None or bool(self._waiting)

    @property
    def waiting(self) -> int:
        """Number of bytes of the protocol's own messages that wait for room."""
        return sum(map(len, self._waiting))

    def stale(self, now: float) -> int:
        """Return how many bytes wait in a link that has stood still for as long as the board calls silence."""
        return self._link.pending() if self._link.stands_still(now) > self._adapter.silence.after else 0

    def begin(self, now: float) -> None:
        """Count silence from now on: the device begins to be driven."""
        self.left_at, self.silence = now, 0.0

    def was_silent(self, now: float) -> bool:
        """Return whether nothing left for longer than the board's declared silence, at any time since `begin`."""
        quiet = max(now - self.left_at, self._link.stands_still(now))
        if quiet > self._adapter.silence.after:
            self.silence = max(self.silence, quiet)
        return self.silence > 0

    def poll(self, now: float) -> None:
        """Send the protocol's own messages in order; those without room wait, the oldest not for ever."""
        self._waiting += self._adapter.poll(now)
        while len(self._waiting) > MAX_WAITING:
            self._waiting.popleft()
            self._counters["dropped"] += 1
        while self._waiting and self._link.send(self._waiting[0]):
            self._left(self._waiting.popleft(), now)
        if self._waiting:
            self._refused = now

    def send(self, messages: list[bytes], now: float, *, moves: bool = False, count: bool = True) -> bool:
        """Send messages of a moment; return whether all of them left.

        Args:
            moves: they move actuators. After a silence they are not sent, as in a process that was suspended between
                the moment and the write. count: messages that did not leave are counted as dropped.
        """
        whole = not (moves and self._adapter.broken)
        for message in messages:
            if not (moves and self.was_silent(self._time(now))) and self._link.send(message):
                self._left(message, now)
            else:
                self._counters["dropped"] += count
                whole = False
        if not whole and (waiting := self._link.pending()) != self._in_link:
            self._in_link, self.left_at = waiting, self._time(now)  # a full link that still moves is not silent
        return whole

    def command(self, values: Array, play: float | None, now: float, patience: float) -> SendResult:
        """Send one command; return the outcome.

        Args:
            play: when it counts [s], or None for at once. patience: a command this close to its time is dropped [s].
        """
        if self._adapter.busy:
            self.unsent = values, play
            return SendResult.UNSENT
        self.unsent = None
        free = not self._waiting and self._may_leave(now)
        if free and self.send(self._adapter.command(values, now, play), now, moves=True, count=False):
            self._counters["sent"] += 1
            return SendResult.SENT
        if free:
            self._adapter.forget()
            self._refused = now
        if play is not None and play - now > patience:
            self.unsent = values, play
            return SendResult.UNSENT
        self._counters["dropped"] += 1
        return SendResult.DROPPED

    def _may_leave(self, now: float) -> bool:
        """Return whether the link is through with the sent messages, as far as its pace and the answers tell."""
        if self._adapter.congested:
            if now - self._refused > MEMORY:
                self._crowded = now
            return False
        return self._bucket.open(now, prompt=self._adapter.prompt and now - self._crowded > MEMORY)

    def _time(self, now: float) -> float:
        """Return the time, which goes on between the moment that was handed in and a write [s]."""
        return now if self._clock is None else self._clock()

    def _left(self, message: bytes, now: float) -> None:
        moment = self._time(now)
        self.was_silent(moment)
        self.left_at = moment
        self._counters["bytes"] += len(message)
        self._bucket.take(len(message))

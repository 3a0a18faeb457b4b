"""The order of messages on one link, and the messages that wait for room.

The protocol's own messages leave first, then commands.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable
from enum import Enum

from ..arrays import Array
from .links.token_bucket import TokenBucket
from .links.transport import Transport
from .protocols.adapter import Adapter

MEMORY = 0.5  # [s] how long commands may not catch up after a link was congested although it refused nothing
MAX_WAITING = 16  # [1] of the protocol's own messages that may wait for room in the link


class SendResult(Enum):
    """The outcome of a command."""

    SENT = "it left"
    UNSENT = "the link is full or busy, but there is time: it waits, and others behind it"
    DROPPED = "the link is full, and its time has come"


class Outbox:
    """Sends an adapter's messages into a link that never waits.

    The outcomes are counted. Commands leave no faster than the link carries them, even if the link accepts more. Bytes
    that wait in a driver still arrive after their sender has died, and keep the device's watchdog quiet until then.

    Args:
        bucket: limits how fast commands may leave.
        clock: read again just before a command leaves; None: a command leaves at the time that the caller passes.

    Attributes:
        left_at: when something left last [s]: a message, or a part of the bytes that wait in the link.
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
        # _refused: when the link last had no room [s].
        # _crowded: when it was last congested although it had refused nothing for `MEMORY` [s].
        self._refused = self._crowded = -math.inf
        self.unsent: tuple[Array, float | None] | None = None

    @property
    def blocked(self) -> bool:
        """Return whether a message or a command waits to be sent."""
        return self.unsent is not None or bool(self._waiting)

    @property
    def waiting(self) -> int:
        """Number of bytes of the protocol's own messages that wait for room."""
        return sum(map(len, self._waiting))

    def stale(self, now: float) -> int:
        """Return how many bytes wait in a link that stands still.

        The link must have stood still for longer than the board's declared silence; otherwise the number is 0.
        """
        return self._link.pending() if self._link.stands_still(now) > self._adapter.silence.after else 0

    def begin(self, now: float) -> None:
        """Measure silence from now on: the device begins to be driven."""
        self.left_at, self.silence = now, 0.0

    def was_silent(self, now: float) -> bool:
        """Return whether the sender has been silent since `begin`.

        It was silent if nothing left for longer than the board's declared silence, at any time since then.
        """
        quiet = max(now - self.left_at, self._link.stands_still(now))
        if quiet > self._adapter.silence.after:
            self.silence = max(self.silence, quiet)
        return self.silence > 0

    def poll(self, now: float) -> None:
        """Send the protocol's own messages, in order.

        Messages without room wait. If more than `MAX_WAITING` wait, the oldest are dropped.
        """
        self._waiting += self._adapter.poll(now)
        while len(self._waiting) > MAX_WAITING:
            self._waiting.popleft()
            self._counters["dropped"] += 1
        while self._waiting and self._link.send(self._waiting[0]):
            self._left(self._waiting.popleft(), now)
        if self._waiting:
            self._refused = now

    def send(self, messages: list[bytes], now: float, *, moves: bool = False, count: bool = True) -> bool:
        """Send messages; return whether all of them left.

        A message that does not leave is not kept. Messages that move actuators are not sent after a silence: the
        process may have been suspended since they were made.

        Args:
            moves: the messages move actuators. Then False is also returned if the adapter could not make its last
                command. count: messages that did not leave are counted as dropped.
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
            play: time at which the device carries it out [s], or None for at once.
            patience: a command without room is dropped if it is due within this time or at once [s]; others wait.
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
        """Return whether the link seems to have carried the sent messages.

        It is judged by the link's pace and by the device's answers.
        """
        if self._adapter.congested:
            if now - self._refused > MEMORY:
                self._crowded = now
            return False
        return self._bucket.open(now, prompt=self._adapter.prompt and now - self._crowded > MEMORY)

    def _time(self, now: float) -> float:
        """Return the time at a write [s], which may be later than `now`."""
        return now if self._clock is None else self._clock()

    def _left(self, message: bytes, now: float) -> None:
        moment = self._time(now)
        self.was_silent(moment)
        self.left_at = moment
        self._counters["bytes"] += len(message)
        self._bucket.take(len(message))

"""The last moments of a link, before it is closed.

Waiting messages leave, and the device confirms its safe state if its protocol has a confirmation.
"""

from __future__ import annotations

from collections import Counter

from .links.transport import Transport
from .outbox import Outbox
from .protocols.adapter import Adapter

DRAIN = 1.0  # [s] Messages that have not left after this time are thrown away, and `Drain.message` says so.


class Drain:
    """Empties a link before it is closed, without ever waiting.

    Attributes:
        message: the failure in words, '' if there was none.
    """

    def __init__(self, link: Transport, adapter: Adapter, outbox: Outbox, counters: Counter[str], now: float) -> None:
        self._link, self._adapter, self._outbox, self._counters = link, adapter, outbox, counters
        self._until = now + DRAIN
        self.message = ""

    def done(self, now: float) -> bool:
        """Send on the waiting messages; return whether the link may be closed.

        Raises:
            Gone: the link is closed already.
        """
        if not self._adapter.settled:
            self._outbox.poll(now)  # the adapter repeats the safe state until it is confirmed
        waiting = self._link.pending() + (0 if self._adapter.settled else self._outbox.waiting)
        if self._adapter.settled and not waiting:
            return True
        if now < self._until:
            return False
        if waiting:
            self._counters["bytes thrown away at the end"] += waiting
            self.message = f"{waiting} bytes did not leave within {DRAIN:g} s and were thrown away"
        else:
            self.message = f"the device did not confirm its safe state within {DRAIN:g} s"
        self._counters["safe states not confirmed"] += 1
        self.message = f"{self.message.capitalize()}. Switch its supply off"
        return True

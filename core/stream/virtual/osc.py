"""A simulated receiver of OSC bundles."""

from __future__ import annotations

import struct
import time
from heapq import heappop, heappush

from ...arrays import Array
from ...errors import DermisError
from ..protocols import osc
from ..protocols.wire import Wire


class OscDevice:
    """A receiver of OSC bundles that honours time tags.

    The specification of OSC requires that.

    Attributes:
        waiting: bundles for a later time, each with its time [s], number and messages.
    """

    datagrams = True

    def __init__(self, wire: Wire, *, stuck: int = -1) -> None:
        self.wire = wire
        self.latest: Array = wire.rest.copy()
        self.received = self.errors = 0
        self.tags: list[int] = []
        self.waiting: list[tuple[float, int, list[tuple[str, list[float]]]]] = []
        self._stuck = stuck

    def feed(self, data: bytes, now: float) -> list[bytes]:
        """Process one bundle.

        A bundle for a later time changes nothing yet, and cannot be cancelled.
        """
        try:
            tag, messages = osc.read_bundle(data)
        except (DermisError, struct.error):
            self.errors += 1
            return []
        self.received += 1
        self.tags = [tag]
        ahead = 0.0 if tag == osc.IMMEDIATELY else tag / 2**32 - osc.NTP - time.time()
        if ahead > 0:
            heappush(self.waiting, (now + ahead, self.received, messages))
        else:
            self._set(messages)
        return []

    def tick(self, now: float) -> list[bytes]:
        """Apply the bundles whose time has come by `now` [s]."""
        while self.waiting and self.waiting[0][0] <= now:
            self._set(heappop(self.waiting)[2])
        return []

    def _set(self, messages: list[tuple[str, list[float]]]) -> None:
        for address, arguments in messages:
            name = address.rpartition("/")[2]
            if name in self.wire.names and self.wire.names.index(name) != self._stuck:
                self.latest[self.wire.names.index(name)] = arguments[0]

    def report(self) -> dict[str, object]:
        """Return the values by channel, and counters."""
        return {"values": self.wire.named(self.latest), "received": self.received, "errors": self.errors}

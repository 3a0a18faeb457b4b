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
    """A receiver of OSC bundles that honours time tags, as the specification asks: a bundle for later waits till then.

    Attributes:
        waiting: bundles for later: when [s], number, messages.
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
        """Take one bundle; one for later changes nothing yet, and nothing takes it back."""
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
        """Let the bundles count whose time has come."""
        while self.waiting and self.waiting[0][0] <= now:
            self._set(heappop(self.waiting)[2])
        return []

    def _set(self, messages: list[tuple[str, list[float]]]) -> None:
        for address, arguments in messages:
            name = address.rpartition("/")[2]
            if name in self.wire.names and self.wire.names.index(name) != self._stuck:
                self.latest[self.wire.names.index(name)] = arguments[0]

    def report(self) -> dict[str, object]:
        """Return the values."""
        return {"values": self.wire.named(self.latest), "received": self.received, "errors": self.errors}

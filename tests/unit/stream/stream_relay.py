"""A line that swallows everything at once and passes it on at a pace of its own, over real ptys."""

from __future__ import annotations

import os
import threading
import time
import tty
from contextlib import suppress


class Relay:
    """Stands between a sender and a device; only the way to the device is slow, and nobody sees what waits.

    Args:
        device: the device's port. pace: [bytes/s].

    Attributes:
        url: for the sender.
    """

    def __init__(self, device: str, pace: float) -> None:
        self._mine, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.url = os.ttyname(self._theirs)
        self._device = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self._device)
        os.set_blocking(self._mine, False)
        self._pace, self._open = pace, True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End it."""
        self._open = False
        self._thread.join(1.0)
        for end in (self._mine, self._theirs, self._device):
            os.close(end)

    def _run(self) -> None:
        held, then, credit = b"", time.perf_counter(), 0.0
        while self._open:
            time.sleep(0.0005)
            now = time.perf_counter()
            credit, then = min(credit + (now - then) * self._pace, 0.02 * self._pace), now
            with suppress(BlockingIOError):
                held += os.read(self._mine, 65536)
            if held and credit >= 1:
                done = os.write(self._device, held[: int(credit)])
                held, credit = held[done:], credit - done
            with suppress(BlockingIOError):
                os.write(self._mine, os.read(self._device, 65536))

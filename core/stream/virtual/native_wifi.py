"""A simulated ESP32 with the native protocol in sealed datagrams.

Its key is public.
"""

from __future__ import annotations

from typing import Any

from ..protocols.packets import DeviceState
from ..protocols.pairs import VIRTUAL_KEY
from ..protocols.sealed import BoardSeals
from ..protocols.wire import Wire
from .native import NativeDevice


class NativeWifiDevice(NativeDevice):
    """`NativeDevice` over Wi-Fi; `key`: secret of the pairing."""

    datagrams = True
    watchdogs_allowed = range(10, 401)

    def __init__(self, wire: Wire, *, key: bytes = VIRTUAL_KEY, **more: Any) -> None:
        super().__init__(wire, **more)
        self._now = 0.0
        self.seals = BoardSeals(key, lambda: round(self._now * 1e3))

    def feed(self, data: bytes, now: float) -> list[bytes]:
        """Process one datagram; return the answers."""
        self._now = now
        payload, answers = self.seals.take(data, held=self.state == DeviceState.ARMED)
        return answers + self._sealed(super().feed(payload, now))

    def tick(self, now: float) -> list[bytes]:
        """Advance to the time `now` [s]; return messages without a question."""
        self._now = now
        return self._sealed(super().tick(now))

    def _sealed(self, messages: list[bytes]) -> list[bytes]:
        return [self.seals.seal(message) for message in messages]

"""The native protocol in sealed datagrams over Wi-Fi.

They go to an ESP32 that was paired with this computer over USB.
"""

from __future__ import annotations

from collections.abc import Mapping

from .native import HELLO_EVERY, SYNC_EVERY, Native
from .packets import Kind
from .pairs import VIRTUAL, key_of
from .sealed import OVERHEAD, HostSeals
from .wire import Wire

BUSY = 1.0  # [s] wait for a busy board: the session of a killed sender holds it until the board's watchdog acts


class NativeWifi(Native):
    """The native protocol of Dermis over Wi-Fi.

    Options beside those of `Native`: `board`: name of the board, as printed by pairing.
    Every datagram is sealed and numbered. The board refuses a datagram that is more than 200 ms old.
    """

    name, title = "native-wifi", "Dermis native over Wi-Fi"
    datagrams = True
    unanswered = (
        "Check the board's power, network and address, and that ?board=NAME is what 'stream pair' has printed: a board "
        "answers only the computer that paired it last"
    )
    OPTIONS = (*Native.OPTIONS, "board")
    WATCHDOGS = 200, 60, 400  # [ms] default, shortest, longest
    GONE, BEHIND = 0.2, 0.03  # [s] as `SILENCE_ARMED` and `BEHIND` in native.py, for a slower link

    def __init__(self, wire: Wire, options: Mapping[str, str]) -> None:
        super().__init__(wire, options)
        self.command_bytes += OVERHEAD
        self.other_bytes += OVERHEAD / SYNC_EVERY
        self.seals = HostSeals(key_of(options.get("board", VIRTUAL)))
        self._busy_since: float | None = None

    def receive(self, data: bytes, now: float) -> None:
        """Process one datagram; without the board's seal it is counted and dropped."""
        opened = self.seals.opened
        payload = self.seals.unseal(data)
        if self.seals.forged:
            self.counters["without the board's seal"] += self.seals.forged
            self.seals.forged = 0
        if self.seals.opened and not opened:
            self._heard = now
        super().receive(payload, now)

    def poll(self, now: float) -> list[bytes]:
        """Return datagrams of the handshake, then messages of the native protocol."""
        if self.seals.opened:
            return super().poll(now)
        if not self.seals.busy:
            self._busy_since = None
        elif self._busy_since is None:
            self._busy_since = now
        elif now - self._busy_since > BUSY:
            self.fault = "the device is in use by another sender"
        return [self.seals.ask()] if not self.fault and self._is_due("ask", HELLO_EVERY, now) else []

    def _pack(self, kind: Kind, body: bytes = b"") -> bytes:
        return self.seals.seal(super()._pack(kind, body))

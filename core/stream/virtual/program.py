"""A simulated device as a program of its own.

It serves a pseudo-terminal, a TCP port or a UDP port of this computer until its standard input ends.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import select
import socket
import threading
from collections.abc import Callable
from typing import Any

from ... import clock
from ...errors import DermisError
from ...work.child import follow_parent
from ..protocols.wire import Wire
from .device import Server, make


def serve(protocol: str, wire: Wire, at: str, options: dict[str, float], *, every: float = 0.0) -> int:
    """Run a simulated device until standard input ends; print its reports.

    The address of the device is printed first. Return the exit status.

    Args:
        protocol: name of the protocol. wire: description of the device. options: faults, see `device`.
        at: 'pty', 'tcp' or 'udp', each on this computer only.
        every: time between two reports [s]; 0: only the time of each safe state, and a report at the end.
    """
    device = make(protocol, wire, options)
    link = Endpoint(at)
    server = Server(device, lambda wait: link.read(wait, server.read_most), link.write, options)
    print(json.dumps({"url": link.url}), flush=True)  # printed only after all arguments have been accepted
    ended = threading.Event()
    follow_parent(ended.set)
    due, safe = clock.now() + every, None
    while not ended.is_set() and server.step():
        reached = getattr(device, "safe_at", None)
        if reached is not None and reached != safe:
            print(json.dumps({"safe_at": reached, "watchdogs": getattr(device, "watchdogs", 0)}), flush=True)
        safe = reached
        if every and clock.now() >= due:
            due += every
            print(json.dumps({**device.report(), "at": clock.now()}), flush=True)
            if hasattr(device, "early_most"):  # reset, so that each interval has its own values and a drift shows
                vars(device).update(early_least=math.inf, early_most=-math.inf)
    print(json.dumps({**device.report(), "ended": True}), flush=True)
    return 0


class Endpoint:
    """The device's end of a link that another process opens."""

    read: Callable[[float, int], list[bytes] | None]
    write: Callable[[bytes], None]

    def __init__(self, at: str) -> None:
        self._peer: Any = None
        if at == "pty":
            import pty
            import tty

            # The slave stays open. Otherwise a port that a sender closes would look like an unplugged one.
            self._fd, self._slave = pty.openpty()
            tty.setraw(self._slave)
            os.set_blocking(self._fd, False)
            self.url = os.ttyname(self._slave)
            self.read, self.write = self._read_pty, self._write_pty
            return
        kind = {"tcp": socket.SOCK_STREAM, "udp": socket.SOCK_DGRAM}.get(at)
        if kind is None:
            raise DermisError("no such place", value=at, limit="pty, tcp, udp")
        self._socket = socket.socket(socket.AF_INET, kind)
        self._socket.bind(("127.0.0.1", 0))
        scheme = "udp" if at == "udp" else "socket"
        self.url = f"{scheme}://127.0.0.1:{self._socket.getsockname()[1]}"
        if at == "udp":
            self.read, self.write = self._read_udp, self._write_udp
        else:
            self._socket.listen(1)
            self.read, self.write = self._read_tcp, self._write_tcp

    def _read_pty(self, wait: float, most: int) -> list[bytes] | None:
        if not select.select([self._fd], [], [], wait)[0]:
            return []
        try:
            return [os.read(self._fd, most)]
        except BlockingIOError:
            return []
        except OSError:
            return None

    def _write_pty(self, message: bytes) -> None:
        with contextlib.suppress(BlockingIOError):
            os.write(self._fd, message)

    def _read_udp(self, wait: float, most: int) -> list[bytes] | None:
        if not select.select([self._socket], [], [], wait)[0]:
            return []
        data, self._peer = self._socket.recvfrom(65536)
        return [data]

    def _write_udp(self, message: bytes) -> None:
        if self._peer is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(message, self._peer)

    def _read_tcp(self, wait: float, most: int) -> list[bytes] | None:
        if self._peer is None:
            if select.select([self._socket], [], [], wait)[0]:
                self._peer, _ = self._socket.accept()
                self._peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return []
        if not select.select([self._peer], [], [], wait)[0]:
            return []
        try:
            data = self._peer.recv(most)
        except OSError:
            data = b""
        if not data:  # the sender has closed, and the next one may connect
            self._peer.close()
            self._peer = None
        return [data] if data else []

    def _write_tcp(self, message: bytes) -> None:
        if self._peer is not None:
            with contextlib.suppress(OSError):
                self._peer.sendall(message)

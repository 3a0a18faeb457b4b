"""The link 'virtual:' to a simulated device, and the opening of any link."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
from typing import Any

from ...errors import DermisError
from ..links.open_link import open_link
from ..links.transport import Gone, Stream, Transport
from ..links.url import Url
from ..protocols.adapters import adapter_of
from ..protocols.wire import Wire
from .device import Server, make, options_of
from .faults import NAMES


class VirtualLink(Stream):
    """A link to a simulated device on a thread of this process."""

    def __init__(self, protocol: str, wire: Wire, url: Url) -> None:
        super().__init__(url.text.rstrip(":"))
        options = options_of(url)
        taken = adapter_of(protocol, url.options).OPTIONS
        if unknown := sorted(set(url.options) - {*taken, "adapter"}):
            raise DermisError(
                "unknown option",
                where=url.text,
                value=", ".join(unknown),
                limit=f"of the protocol {', '.join(taken) or 'none'}; of the simulated device {', '.join(NAMES)}",
            )
        device = make(protocol, wire, options)
        self.datagrams, self.carries = device.datagrams, options.get("slow") or None
        if device.datagrams:
            self._mine, self._theirs = _udp_pair()
        else:
            self._mine, self._theirs = socket.socketpair()
            self._mine.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 8192)
        self._mine.setblocking(False)
        self._server = Server(device, self._read, self._answer, options)
        self._open = True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _write(self, data: bytes) -> int:
        try:
            return self._mine.send(data)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise Gone("the virtual device is gone", where=self.name) from error

    def _queued(self) -> int:
        """Return a positive number while the device has messages left to take.

        It is not a number of bytes.
        """
        return len(select.select([self._theirs], [], [], 0)[0]) + self._server.delayed

    def receive(self) -> list[bytes]:
        """Return the data that have arrived."""
        out: list[bytes] = []
        try:
            while len(out) < 64:
                data = self._mine.recv(65536)
                if not data:
                    break
                out.append(data)
        except BlockingIOError:
            pass
        except OSError as error:
            raise Gone("the virtual device is gone", where=self.name) from error
        return out

    def close(self) -> None:
        """End the device's thread."""
        self._open = False
        self._thread.join(1.0)
        self._mine.close()
        self._theirs.close()

    def report(self) -> dict[str, Any]:
        """Return the device's report."""
        return dict(self._server.device.report())

    def _run(self) -> None:
        while self._open and self._server.step():
            pass

    def _read(self, wait: float) -> list[bytes] | None:
        if not select.select([self._theirs], [], [], wait)[0]:
            return []
        try:
            data = self._theirs.recv(self._server.read_most)
        except OSError:
            return []
        return [data] if data or self.datagrams else None

    def _answer(self, message: bytes) -> None:
        with contextlib.suppress(OSError):
            self._theirs.send(message)


def open_any_link(url: Url, wire: Wire, protocol: str = "native") -> Transport:
    """Open any link, 'virtual:' included.

    Raises:
        DermisError: the link cannot be opened.
    """
    return open_link(url, lambda inner: VirtualLink(protocol, wire, inner), adapter_of(protocol, url.options).baud)


def _udp_pair() -> tuple[socket.socket, socket.socket]:
    pair = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
    for one in pair:
        one.bind(("127.0.0.1", 0))
    pair[0].connect(pair[1].getsockname())
    pair[1].connect(pair[0].getsockname())
    return pair[0], pair[1]

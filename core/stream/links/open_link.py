"""Opening a link of any kind by its URL.

The module also defines a link that returns every message, and one that records the messages of another link.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ...errors import DermisError
from .record import Record
from .serial_port import Serial
from .sockets import Tcp, Udp
from .transport import Transport
from .url import Url

BAUD = 115_200  # baud rate of a serial port if neither the protocol nor the URL states one


class Loop(Transport):
    """A loop that returns every message sent."""

    name = "loop://"

    def __init__(self) -> None:
        self._messages: list[bytes] = []

    def send(self, message: bytes) -> bool:
        if len(self._messages) >= 1000:
            return False
        self._messages.append(message)
        return True

    def receive(self) -> list[bytes]:
        out, self._messages = self._messages, []
        return out


class Spy(Transport):
    """A link that records all messages of an inner link."""

    def __init__(self, inner: Transport, path: str) -> None:
        self._inner, self.name = inner, f"spy://{inner.name}"
        self.datagrams, self.baud = inner.datagrams, inner.baud
        self.carries, self.keeps = inner.carries, inner.keeps
        self._record = Record(path)

    def send(self, message: bytes) -> bool:
        done = self._inner.send(message)
        self._record.note("TX" if done else "--", message)
        return done

    def receive(self) -> list[bytes]:
        out = self._inner.receive()
        for message in out:
            self._record.note("RX", message)
        return out

    def pending(self) -> int:
        return self._inner.pending()

    def close(self) -> None:
        self._inner.close()
        self._record.close()

    def report(self) -> dict[str, Any]:
        """Return the report of the inner link.

        If the record is incomplete, the reason and the number of missing messages are added.
        """
        record = self._record
        return {**self._inner.report(), **({"record": record.ended, "missing": record.missing} if record.ended else {})}


def open_link(url: Url, virtual: Callable[[Url], Transport], baud: int = BAUD) -> Transport:
    """Open a link.

    The options that belong to the link are removed from the URL.

    Args:
        url: address of the device. virtual: opens the simulated device.
        baud: baud rate of a serial port whose URL states none.

    Raises:
        DermisError: the link cannot be opened. The error states the cause, and the program that uses the port if the
            system tells.
    """
    if url.scheme == "spy":
        path = url.take("file")
        inner = Url(url.place)
        inner.options = url.options
        link = open_link(inner, virtual, baud)
        try:
            return Spy(link, path)
        except DermisError:
            link.close()
            raise
    if url.scheme == "serial":
        given = url.take("baud", str(baud))
        if not given.isdecimal() or int(given) < 300:
            raise DermisError("not a baud rate", where=url.text, value=given, limit="a whole number from 300 on")
        return Serial(url.place, int(given))
    if url.scheme == "socket":
        return Tcp(url)
    if url.scheme == "udp":
        return Udp(url)
    return virtual(url) if url.scheme == "virtual" else Loop()

"""Messages from outside, which a thread reads.

They are OSC datagrams, or lines from a serial port, a socket or standard input.
"""

from __future__ import annotations

import math
import os
import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, TypeVar

from .. import clock
from ..errors import DermisError
from .links.open_link import open_link
from .links.transport import Transport
from .links.url import Url

MAX_LINE = 4096  # [bytes] A longer line is cut off. 200 numbers of 20 digits fit.
POLL = 0.0005  # [s] between two attempts to read a serial port or a socket
Input = TypeVar("Input")


class _Lines:
    """Cuts bytes into lines.

    The end of a line whose beginning is missing is left out, because its first number may be cut.

    Args:
        begun: the first line may have begun before anybody listened.
    """

    def __init__(self, begun: bool = False) -> None:
        self._rest, self._cut = b"", begun

    def of(self, data: bytes) -> list[bytes]:
        *whole, self._rest = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        if whole and self._cut:
            whole, self._cut = whole[1:], False
        if len(self._rest) > MAX_LINE:
            whole, self._rest, self._cut = [*whole, *([] if self._cut else [self._rest])], b"", True
        return [line[: MAX_LINE + 1] for line in whole if line.strip()]


class _Datagram(bytes):
    """A datagram with the address of its sender."""

    sender: Any

    def __new__(cls, data: bytes, sender: Any) -> _Datagram:
        made = super().__new__(cls, data)
        made.sender = sender
        return made


@dataclass(frozen=True)
class Messages:
    """The origin of messages, and their parsers.

    Attributes:
        text: osc://:PORT, osc://HOST:PORT, serial:PORT?baud=, socket://HOST:PORT, or '-' for standard input.
        option: option of the command line that named `text`. told: description of a line, for people.
        alone: for this long after a datagram with messages those of other senders are refused [s]; 0: they never are.
        of_line, of_osc: parse a line and a datagram; raise DermisError or ValueError.
    """

    text: str
    option: str
    told: str
    of_line: Callable[[bytes], Iterator[Any]]
    of_osc: Callable[[bytes], Iterator[Any]]
    alone: float = 0.0

    def read_by(self, kind: Callable[..., Input]) -> Input:
        """Open the origin of the messages, and let a thread read it.

        Args:
            kind: `Reading`, or a class derived from it: takes name, read, parse and shut.

        Raises:
            DermisError: the origin cannot be opened.
        """
        if self.text.startswith("osc://"):
            return self._osc(kind)
        if self.text == "-":
            return self._standard_input(kind)
        return self._link(kind)

    def _standard_input(self, kind: Callable[..., Input]) -> Input:
        cut = _Lines()

        def received() -> list[bytes] | None:
            data = os.read(0, 65536)
            return cut.of(data) if data else None

        return kind(f"standard input, {self.told}", received, self.of_line, lambda: None)

    def _link(self, kind: Callable[..., Input]) -> Input:
        url = Url(self.text)
        cut = _Lines(begun=self.text.startswith("serial:"))
        if set(url.options) - {"baud"}:
            unknown = ", ".join(sorted(url.options))
            raise DermisError("unknown option", where=self.text, value=unknown, limit="baud")
        link = open_link(url, lambda inner: Transport())  # neither a serial port nor a socket calls this function

        def received() -> list[bytes]:
            data = b"".join(link.receive())
            if not data:
                time.sleep(POLL)
            return cut.of(data) if data else []

        return kind(f"{link.name}, {self.told}", received, self.of_line, link.close)

    def _osc(self, kind: Callable[..., Input]) -> Input:
        host, colon, port = self.text.removeprefix("osc://").rstrip("/").rpartition(":")
        if not colon or not port.isdigit() or not 0 < int(port) < 65536:
            raise DermisError("not osc://:PORT or osc://HOST:PORT", where=self.option, value=self.text)
        host = host.strip("[]") or "127.0.0.1"  # without a host, other computers are not listened to
        try:
            family, sort, protocol, _, address = socket.getaddrinfo(host, int(port), type=socket.SOCK_DGRAM)[0]
            listening = socket.socket(family, sort, protocol)
            try:
                listening.bind(address)
            except OSError:
                listening.close()
                raise
        except OSError as error:
            raise DermisError(
                f"what {self.option} names cannot be listened for",
                where=f"osc://{host}:{port}",
                value=error.strerror,
                remedy="Choose another port, or end the program that has it",
            ) from error
        listening.settimeout(0.1)
        alone: tuple[Any, float] = None, -math.inf  # sender of the last datagram with messages, and when it came [s]

        def received() -> list[bytes]:
            try:
                data, sender = listening.recvfrom(65536)
            except TimeoutError:
                return []
            return [_Datagram(data, sender)]

        def parsed(data: bytes) -> Iterator[Any]:
            nonlocal alone
            assert isinstance(data, _Datagram)
            found, now = list(self.of_osc(data)), clock.now()
            if not found:
                return
            if data.sender != alone[0] and now - alone[1] < self.alone:
                raise ValueError("a second program sends here, and only the first is heard")
            alone = data.sender, now
            yield from found

        return kind(f"osc://{host}:{port}", received, parsed, listening.close)

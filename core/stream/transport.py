"""Links to devices, by URL. Nothing here ever waits: what cannot be sent at once is refused and counted by the sender.

    /dev/ttyACM0, COM3, serial:/dev/ttyACM0?baud=115200     a serial port
    socket://host:port                                      a TCP connection
    udp://host:port                                         datagrams
    loop://                                                 what is sent comes back
    spy://URL?file=PATH                                     any of them, with a record of the bytes
    virtual:?loss=0.01&delay=0.02                           the device in the box (see virtual_device.py)

Options after the question mark that no transport knows belong to the protocol.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

from ..errors import DermisError

BAUD = 115200
QUEUED_MOST = 0.02  # bytes may wait in a serial driver for this long [s]; then a newer value is better than an older
CONNECT_SECONDS = 2.0


class Gone(DermisError):
    """The other side has closed, or the device was unplugged."""


class Url:
    """A link's address, taken apart.

    Attributes:
        scheme: 'serial', 'socket', 'udp', 'loop', 'spy' or 'virtual'. place: port, host:port or inner URL.
        options: what stands after the question mark.
    """

    def __init__(self, text: str) -> None:
        self.text = text.strip()
        if not self.text:
            raise DermisError("no port is given", remedy="Enter one, or 'virtual:' for the device in the box")
        head, _, query = self.text.partition("?")
        try:
            self.options = dict(parse_qsl(query, strict_parsing=bool(query)))
        except ValueError as error:
            raise DermisError("the options are no NAME=VALUE pairs", where=self.text, value=query) from error
        scheme, colon, place = head.partition(":")
        known = ("serial", "socket", "udp", "loop", "spy", "virtual")
        if colon and scheme in known:
            self.scheme, self.place = scheme, place.removeprefix("//")
        elif "://" in head:
            raise DermisError("unknown kind of link", where=self.text, value=scheme, limit=", ".join(known))
        else:
            self.scheme, self.place = "serial", head
        if self.scheme == "spy" and not self.place:
            raise DermisError("spy:// needs the URL that it shall watch", where=self.text)

    def take(self, name: str, default: str = "") -> str:
        """Remove and return an option."""
        return self.options.pop(name, default)

    def host_port(self) -> tuple[str, int]:
        """Read the place as host and port.

        Raises:
            DermisError: it is none.
        """
        host, _, port = self.place.rstrip("/").rpartition(":")
        if not host or not port.isdigit() or not 0 < int(port) < 65536:
            raise DermisError("not HOST:PORT", where=self.text, value=self.place)
        return host.strip("[]"), int(port)


class Transport:
    """An open link.

    Attributes:
        name: for people. datagrams: messages keep their borders.
    """

    name = ""
    datagrams = False

    def send(self, message: bytes) -> bool:
        """Send a message whole or not at all; False: there is no room now.

        Raises:
            Gone: the link is closed.
        """
        raise NotImplementedError

    def receive(self) -> list[bytes]:
        """Return what has arrived.

        Raises:
            Gone: the link is closed.
        """
        raise NotImplementedError

    def close(self) -> None:
        """Close the link; safe to call twice."""

    def report(self) -> dict[str, Any]:
        """Return what the transport itself knows of the other side."""
        return {}


class _Stream(Transport):
    """A file descriptor or socket that takes bytes without waiting."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._rest = b""

    def send(self, message: bytes) -> bool:
        if self._rest:  # the end of a message that was cut: it must come first
            self._rest = self._rest[self._write(self._rest) :]
            if self._rest:
                return False
        if not self._has_room(len(message)):
            return False
        done = self._write(message)
        if not done:
            return False
        self._rest = message[done:]
        return True

    def _has_room(self, size: int) -> bool:
        return True

    def _write(self, data: bytes) -> int:
        raise NotImplementedError


class Serial(_Stream):
    """A serial port, opened for this process alone."""

    def __init__(self, place: str, baud: int) -> None:
        try:
            import serial
        except ImportError as error:
            raise DermisError("serial ports need pyserial", where=place, remedy="Install pyserial") from error
        super().__init__(place)
        try:
            self._port = serial.Serial(None, baud, timeout=0, write_timeout=0, exclusive=True)
            self._port.port = place
            self._port.open()
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise _cannot_open(place, error) from error
        self._budget = max(int(baud / 10 * QUEUED_MOST), 64)
        self._fd = self._port.fileno() if hasattr(select, "poll") else -1
        self._poll: Any = None
        if self._fd >= 0:
            self._poll = select.poll()
            self._poll.register(self._fd, select.POLLIN)

    def _has_room(self, size: int) -> bool:
        with contextlib.suppress(OSError, AttributeError):
            return bool(self._port.out_waiting <= self._budget)
        return True

    def _write(self, data: bytes) -> int:
        try:
            if self._fd >= 0:  # pyserial spins where a port without time-out is full
                return os.write(self._fd, data)
            return int(self._port.write(data) or 0)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise Gone("the device is gone", where=self.name, value=error.strerror or str(error)) from error

    def receive(self) -> list[bytes]:
        try:
            if self._fd < 0:
                waiting = self._port.in_waiting
                return [self._port.read(waiting)] if waiting else []
            events = self._poll.poll(0)
            if not events:
                return []
            data = os.read(self._fd, 65536)
        except BlockingIOError:
            return []
        except OSError as error:
            raise Gone("the device is gone", where=self.name, value=error.strerror or str(error)) from error
        if not data:  # readable, and nothing to read: unplugged
            raise Gone("the device is gone", where=self.name)
        return [data]

    def close(self) -> None:
        """Close the port without waiting for what was not sent."""
        with contextlib.suppress(Exception):
            self._port.reset_output_buffer()
        with contextlib.suppress(Exception):
            self._port.close()


class Tcp(_Stream):
    """A TCP connection."""

    def __init__(self, url: Url) -> None:
        super().__init__(url.text)
        try:
            self._socket = socket.create_connection(url.host_port(), timeout=CONNECT_SECONDS)
        except OSError as error:
            raise _cannot_open(url.text, error) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 16384)
        self._socket.setblocking(False)

    def _write(self, data: bytes) -> int:
        try:
            return self._socket.send(data)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise Gone("the connection is closed", where=self.name, value=error.strerror or str(error)) from error

    def receive(self) -> list[bytes]:
        try:
            data = self._socket.recv(65536)
        except BlockingIOError:
            return []
        except OSError as error:
            raise Gone("the connection is closed", where=self.name, value=error.strerror or str(error)) from error
        if not data:
            raise Gone("the other side has closed the connection", where=self.name)
        return [data]

    def close(self) -> None:
        self._socket.close()


class Udp(Transport):
    """Datagrams to one address, and those that come back from it."""

    datagrams = True

    def __init__(self, url: Url) -> None:
        self.name = url.text
        host, port = url.host_port()
        try:
            family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, kind, protocol)
            self._socket.setblocking(False)
            self._socket.connect(address)
        except OSError as error:
            raise _cannot_open(url.text, error) from error

    def send(self, message: bytes) -> bool:
        try:
            return self._socket.send(message) == len(message)
        except BlockingIOError:
            return False
        except ConnectionRefusedError as error:
            raise Gone("nobody listens there", where=self.name) from error
        except OSError as error:
            raise Gone("the network does not take it", where=self.name, value=error.strerror) from error

    def receive(self) -> list[bytes]:
        out: list[bytes] = []
        try:
            while len(out) < 64:
                out.append(self._socket.recv(65536))
        except BlockingIOError:
            pass
        except ConnectionRefusedError as error:
            raise Gone("nobody listens there", where=self.name) from error
        except OSError as error:
            raise Gone("the network is gone", where=self.name, value=error.strerror) from error
        return out

    def close(self) -> None:
        self._socket.close()


class Loop(Transport):
    """What is sent comes back."""

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
    """Another link, with every byte written down: time, direction, hexadecimal."""

    def __init__(self, inner: Transport, path: str) -> None:
        self._inner, self.name, self.datagrams = inner, f"spy://{inner.name}", inner.datagrams
        try:
            self._file = Path(path).open("w", encoding="ascii") if path else sys.stderr
        except OSError as error:
            raise DermisError("the record cannot be written", where=path, value=error.strerror) from error
        self._start = time.perf_counter()

    def send(self, message: bytes) -> bool:
        done = self._inner.send(message)
        self._note("TX" if done else "--", message)
        return done

    def receive(self) -> list[bytes]:
        out = self._inner.receive()
        for message in out:
            self._note("RX", message)
        return out

    def close(self) -> None:
        self._inner.close()
        if self._file is not sys.stderr:
            self._file.close()

    def report(self) -> dict[str, Any]:
        """Return what the inner link knows."""
        return self._inner.report()

    def _note(self, way: str, data: bytes) -> None:
        self._file.write(f"{time.perf_counter() - self._start:012.6f} {way} {data.hex(' ')}\n")


def open_link(url: Url, virtual: Callable[[Url], Transport]) -> Transport:
    """Open a link; the URL loses the options that the link takes.

    Args:
        virtual: opens the device in the box.

    Raises:
        DermisError: it cannot be opened; says why, and who has it where that can be known.
    """
    if url.scheme == "spy":
        path = url.take("file")
        inner = Url(url.place)
        inner.options = url.options
        return Spy(open_link(inner, virtual), path)
    if url.scheme == "serial":
        baud = url.take("baud", str(BAUD))
        if not baud.isdigit() or int(baud) < 300:
            raise DermisError("not a baud rate", where=url.text, value=baud)
        return Serial(url.place, int(baud))
    if url.scheme == "socket":
        return Tcp(url)
    if url.scheme == "udp":
        return Udp(url)
    return virtual(url) if url.scheme == "virtual" else Loop()


def ports() -> list[tuple[str, str]]:
    """Return the serial ports of this computer: name and description. Takes milliseconds to seconds."""
    from serial.tools import list_ports

    return sorted((port.device, port.description) for port in list_ports.comports())


def _cannot_open(place: str, error: Exception) -> DermisError:
    number = getattr(error, "errno", None)
    text = str(getattr(error, "strerror", None) or error)
    busy = "exclusively lock" in str(error) or number in (11, 16) or "PermissionError" in str(error)
    if busy:
        holder = holder_of(place)
        return DermisError("the port is in use", where=place, value=holder or None,
                           remedy=f"Close {holder or 'the program that has it'}, then connect again")  # fmt: skip
    if number == 13:
        return DermisError("you may not open the port", where=place, value=text,
                           remedy="On Linux add yourself to the group 'dialout', then log in again")  # fmt: skip
    if number == 2 or "FileNotFoundError" in str(error):
        return DermisError("there is no such port", where=place, remedy="Plug the device in, then rescan")
    return DermisError("the link cannot be opened", where=place, value=text)


def holder_of(place: str) -> str:
    """Return name and id of the processes that have a port open, where the system tells; otherwise ''."""
    found = []
    try:
        wanted = os.path.realpath(place)
        for process in sorted(Path("/proc").glob("[0-9]*"), key=lambda p: int(p.name)):
            if int(process.name) == os.getpid():
                continue
            with contextlib.suppress(OSError):
                if any(os.path.realpath(link) == wanted for link in (process / "fd").iterdir()):
                    found.append(f"{(process / 'comm').read_text().strip()} (process {process.name})")
    except OSError:
        pass
    return ", ".join(found)

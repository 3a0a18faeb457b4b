"""Links over a network: TCP connections and UDP datagrams."""

from __future__ import annotations

import contextlib
import errno
import socket
import struct
import sys

from ... import clock
from ...errors import DermisError
from .transport import Gone, Stream, Transport
from .url import Url

CONNECT_SECONDS = 2.0  # [s] time-out of a TCP connection
STILL = 0.05  # [s] a connection is stalled after this time: the receiver's system may delay confirmations by 40 ms
_SIOCOUTQ = 0x5411  # Linux request for the number of bytes that the other side's system has not confirmed


class Tcp(Stream):
    """A TCP connection."""

    def __init__(self, url: Url) -> None:
        super().__init__(url.text)
        try:
            self._socket = socket.create_connection(url.host_port(), timeout=CONNECT_SECONDS)
        except OSError as error:
            raise cannot_connect(url.text, error) from error
        self._given = self._confirmed = 0  # [bytes] taken by this system, and confirmed by the other side
        self._moved = clock.now()
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 16384)
        self._socket.setblocking(False)

    def _write(self, data: bytes) -> int:
        try:
            done = self._socket.send(data)
            self._given += done
            return done
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

    def stands_still(self, now: float) -> float:
        """Return the time since the last confirmation [s]; 0 if no bytes wait."""
        confirmed = self._given - self._queued()
        if confirmed != self._confirmed or confirmed == self._given:
            self._confirmed, self._moved = confirmed, now
        return now - self._moved

    def _queued(self) -> int:
        if sys.platform != "linux":
            return 0  # not known on this system, which sends the rest after close()
        import fcntl

        with contextlib.suppress(OSError):
            (count,) = struct.unpack("i", fcntl.ioctl(self._socket, _SIOCOUTQ, bytes(4)))
            return int(count)
        return 0

    def close(self) -> None:
        """Close the connection; the system still sends the bytes that it holds.

        A stalled connection is reset instead, because its bytes would arrive too late.
        """
        if self.stands_still(clock.now()) > STILL:
            with contextlib.suppress(OSError):
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)
        self._socket.close()


class Udp(Transport):
    """UDP datagrams to and from one address."""

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
            raise cannot_connect(url.text, error) from error

    def send(self, message: bytes) -> bool:
        try:
            return self._socket.send(message) == len(message)
        except BlockingIOError:
            return False
        except ConnectionRefusedError as error:
            raise Gone("nobody listens there", where=self.name) from error
        except OSError as error:
            raise Gone("the network refused the datagram", where=self.name, value=error.strerror) from error

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


# (error number of POSIX, that of Windows) -> cause and remedy.
_REFUSED = {
    (errno.EACCES, 10013): (
        "the address is a broadcast address, or a firewall blocks it",
        "Use the device's own address. If it is correct, allow the connection in the firewall",
    ),
    (errno.ECONNREFUSED, 10061): ("nobody listens there", "Start the device, and check its address and port"),
    (errno.ENETUNREACH, 10051): (
        "there is no network route to the device",
        "Connect this computer to the device's network",
    ),
    (errno.EHOSTUNREACH, 10065): ("the network does not reach the device", "Check its address, and that it is on"),
    (errno.ETIMEDOUT, 10060): ("the device does not answer", "Check its address and port, and that it is on"),
}


def cannot_connect(place: str, error: OSError) -> DermisError:
    """Return the error of a socket that could not be connected, with its remedy."""
    said = error.strerror or str(error)
    if isinstance(error, socket.gaierror):
        return DermisError("unknown name of a computer", where=place, value=said, remedy="Check the address")
    number = errno.ETIMEDOUT if isinstance(error, TimeoutError) else error.errno
    for numbers, (what, remedy) in _REFUSED.items():
        if number in numbers:
            return DermisError(f"the link cannot be opened: {what}", where=place, value=said, remedy=remedy)
    return DermisError("the link cannot be opened", where=place, value=said)

"""The device in the box: any protocol, with faults, in this process ('virtual:') or as a program of its own.

Options of the URL: `loss`, `delay`, `jitter`, `corrupt`, `slow` (see faults.py), `stuck` (number of an actuator that
does not move), `skew` (of its clock), `finger` (1: a finger draws circles on its touch panel), `seed`.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import select
import socket
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, Protocol

from ..errors import DermisError
from . import faults as faults_module
from .faults import Faults
from .transport import Gone, Transport, Url
from .transport import open_link as open_real
from .wire import Wire

PROTOCOLS = ("native", "maestro", "servo-animation", "torque", "osc")
IDLE = 0.001  # between two looks at the clock where nothing arrives [s]
FINGER_HZ = 100.0


class Device(Protocol):
    """What all virtual devices have."""

    datagrams: bool

    def feed(self, data: bytes, now: float) -> list[bytes]: ...  # noqa: D102
    def tick(self, now: float) -> list[bytes]: ...  # noqa: D102
    def report(self) -> dict[str, object]: ...  # noqa: D102


def make(protocol: str, wire: Wire, options: dict[str, float]) -> Device:
    """Return a virtual device for a protocol.

    Raises:
        DermisError: no such protocol.
    """
    from . import virtual_others as others
    from .virtual_native import NativeDevice

    stuck = int(options.get("stuck", -1))
    if not -1 <= stuck < wire.count:
        raise DermisError("no such actuator", where="stuck", value=stuck, limit=f"0 to {wire.count - 1}")
    if protocol == "native":
        return NativeDevice(wire, stuck=stuck, skew=options.get("skew", 0.0))
    if protocol == "maestro":
        return others.MaestroDevice(wire, stuck=stuck)
    if protocol == "servo-animation":
        return others.ServoAnimationDevice(wire, stuck=stuck)
    if protocol == "torque":
        return others.TorqueDevice(wire, stuck=stuck)
    if protocol == "osc":
        return others.OscDevice(wire, stuck=stuck)
    raise DermisError("no such protocol", value=protocol, limit=", ".join(PROTOCOLS))


def options_of(url: Url) -> dict[str, float]:
    """Take the options that belong to the virtual device out of a URL.

    Raises:
        DermisError: one is no number.
    """
    out = {}
    for name in faults_module.NAMES:
        if name in url.options:
            text = url.take(name)
            try:
                out[name] = float(text)
            except ValueError as error:
                raise DermisError("a fault is no number", where=name, value=text) from error
    return out


class Server:
    """Runs a virtual device on the other end of a link.

    Args:
        read: returns what has arrived within a time [s]; b'' or [] for nothing, None when the link is closed.
        write: sends one message.
    """

    def __init__(
        self, device: Device, read: Callable[[float], list[bytes] | None], write: Callable[[bytes], None],
        options: dict[str, float],
    ) -> None:  # fmt: skip
        self.device = device
        self._read, self._write = read, write
        loss, delay, jitter, corrupt = (options.get(name, 0.0) for name in ("loss", "delay", "jitter", "corrupt"))
        seed = int(options.get("seed", 1))
        self._in, self._out = (Faults(loss, delay, jitter, corrupt, seed=seed + k) for k in (0, 1))
        self._slow = options.get("slow", 0.0)
        self._finger = bool(options.get("finger", 0.0))
        self._touch_at = 0.0
        self._credit, self._credited = 0.0, time.perf_counter()

    def step(self) -> bool:
        """Do what is due; False when the link is closed."""
        wait = IDLE
        now = time.perf_counter()
        if self._slow:
            self._credit = min(self._credit + (now - self._credited) * self._slow, max(self._slow * 0.02, 1.0))
            self._credited = now
            if self._credit < 1:
                time.sleep(IDLE)
                self._serve(time.perf_counter(), [])
                return True
        messages = self._read(wait)
        if messages is None:
            return False
        self._credit -= sum(map(len, messages))
        self._serve(time.perf_counter(), messages)
        return True

    def _serve(self, now: float, messages: list[bytes]) -> None:
        for message in messages:
            self._in.put(message, now)
        for message in self._in.get(now):
            for answer in self.device.feed(message, now):
                self._out.put(answer, now)
        for answer in self.device.tick(now):
            self._out.put(answer, now)
        if self._finger and now >= self._touch_at:
            self._touch_at = now + 1.0 / FINGER_HZ
            x, y = 0.03 * math.cos(2 * now), 0.03 * math.sin(2 * now)
            touched = getattr(self.device, "touched", None)
            if touched is not None:
                self._out.put(touched(True, x, y, now), now)
        for answer in self._out.get(now):
            self._write(answer)

    @property
    def read_most(self) -> int:
        """Most bytes to read at once: few where the reader is slow."""
        return max(int(self._credit), 1) if self._slow else 65536


class VirtualLink(Transport):
    """A link to a virtual device on a thread of this process."""

    def __init__(self, protocol: str, wire: Wire, url: Url) -> None:
        self.name = url.text
        options = options_of(url)
        device = make(protocol, wire, options)
        self.datagrams = device.datagrams
        if device.datagrams:
            self._mine, self._theirs = _udp_pair()
        else:
            self._mine, self._theirs = socket.socketpair()
            self._mine.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 8192)
        self._mine.setblocking(False)
        self._server = Server(device, self._read, self._write, options)
        self._rest = b""
        self._open = True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def send(self, message: bytes) -> bool:
        """Send a message whole or not at all."""
        try:
            if self._rest:
                self._rest = self._rest[self._mine.send(self._rest) :]
                if self._rest:
                    return False
            done = self._mine.send(message)
        except BlockingIOError:
            return False
        except OSError as error:
            raise Gone("the virtual device is gone", where=self.name) from error
        self._rest = message[done:]
        return True

    def receive(self) -> list[bytes]:
        """Return what has arrived."""
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
        """Return what the device does."""
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

    def _write(self, message: bytes) -> None:
        with contextlib.suppress(OSError):
            self._theirs.send(message)


def open_link(url: Url, wire: Wire, protocol: str = "native") -> Transport:
    """Open any link, 'virtual:' included.

    Raises:
        DermisError: it cannot be opened.
    """
    return open_real(url, lambda inner: VirtualLink(protocol, wire, inner))


def _udp_pair() -> tuple[socket.socket, socket.socket]:
    pair = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
    for one in pair:
        one.bind(("127.0.0.1", 0))
    pair[0].connect(pair[1].getsockname())
    pair[1].connect(pair[0].getsockname())
    return pair[0], pair[1]


def serve(protocol: str, wire: Wire, at: str, options: dict[str, float], *, every: float = 0.0) -> int:
    """Run a virtual device as a program until its standard input ends; print its address, then what happens.

    Args:
        at: 'pty', 'tcp' or 'udp', each on this computer only.
        every: print the report this often [s]; 0: only when the safe state is reached and at the end.
    """
    device = make(protocol, wire, options)
    link = _Endpoint(at)
    print(json.dumps({"url": link.url}), flush=True)
    server = Server(device, lambda wait: link.read(wait, server.read_most), link.write, options)
    ended = threading.Event()
    threading.Thread(target=_watch_input, args=(ended,), daemon=True).start()
    due, safe = time.perf_counter() + every, None
    while not ended.is_set() and server.step():
        reached = getattr(device, "safe_at", None)
        if reached is not None and reached != safe:
            print(json.dumps({"safe_at": reached, "watchdogs": getattr(device, "watchdogs", 0)}), flush=True)
        safe = reached
        if every and time.perf_counter() >= due:
            due += every
            print(json.dumps({**device.report(), "at": time.perf_counter()}), flush=True)
            if hasattr(device, "early_most"):  # of each interval by itself, so that a drift shows
                vars(device).update(early_least=math.inf, early_most=-math.inf)
    print(json.dumps({**device.report(), "ended": True}), flush=True)
    return 0


class _Endpoint:
    """The device's end of a link that another process opens."""

    read: Callable[[float, int], list[bytes] | None]
    write: Callable[[bytes], None]

    def __init__(self, at: str) -> None:
        self._peer: Any = None
        if at == "pty":
            import pty
            import tty

            # The slave stays open, or a port that a sender closes would look like an unplugged one.
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
        if not data:  # the next one may connect
            self._peer.close()
            self._peer = None
        return [data] if data else []

    def _write_tcp(self, message: bytes) -> None:
        if self._peer is not None:
            with contextlib.suppress(OSError):
                self._peer.sendall(message)


def _watch_input(ended: threading.Event) -> None:
    while sys.stdin.buffer.read(4096):
        pass
    ended.set()

"""A sender over Wi-Fi, and what may be in the air once it was killed; the board is the sketch on this computer."""

from __future__ import annotations

import itertools
import socket
from collections.abc import Callable, Iterator

import numpy as np

from core.stream.protocols import adapters, pairs
from core.stream.protocols.native_wifi import NativeWifi
from core.stream.protocols.sealed import HostSeals, Sealed
from core.stream.protocols.wire import Wire
from tests.unit.stream.firmware_board import Board, servos
from tests.unit.stream.firmware_floods import FAR, SECONDS, Flooded, far_and_safe, judged
from tests.unit.stream.firmware_host import WifiBoard

WIRE = servos(2, slew=4.0)
NAME = "DERMISU1"
SILENCES = NativeWifi.WATCHDOGS[1], NativeWifi.WATCHDOGS[0]  # the shortest that can be set, and that of a new link [ms]
A_MILLISECOND = 2  # datagrams of a flood: 250 bytes each are 4 Mbit/s


class Host:
    """A sender that speaks `native-wifi` to the board's socket, behind a network that loses and holds back."""

    def __init__(
        self, board: WifiBoard, loss: float = 0.0, key: bytes = b"", wire: Wire = WIRE, **options: str
    ) -> None:
        self.board, self.loss, self.rng = board, loss, np.random.default_rng(1)
        adapter = adapters.make("native-wifi", wire, {"board": pairs.VIRTUAL, **options})
        assert isinstance(adapter, NativeWifi)
        self.adapter = adapter
        self.adapter.seals.key = key or board.key
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.silent, self.sent = False, [b""]
        self.adapter.opened(board.now)

    def send(self, message: bytes) -> None:
        self.sent.append(message)
        if not self.silent and self.rng.random() >= self.loss:
            self.socket.sendto(message, ("127.0.0.1", self.board.port))

    def run(self, seconds: float, goal: float | None = None) -> None:
        for _ in range(round(seconds / 0.005)):
            now = self.board.now
            for message in self.adapter.poll(now):
                self.send(message)
            if goal is not None:
                for message in self.adapter.command(np.full(self.adapter.wire.count, goal), now, None):
                    self.send(message)
            Board.run(self.board, 0.005)
            self.board.now = now + 0.005
            for data in self.board.datagrams(self.socket):
                if not self.silent and self.rng.random() >= self.loss:
                    self.adapter.receive(data, self.board.now)

    def arm(self) -> None:
        self.run(0.6)
        assert self.adapter.ready, self.adapter.fault
        self.adapter.arm()
        self.run(0.4)
        assert self.adapter.armed, self.adapter.counters

    def __enter__(self) -> Host:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()


# Datagrams of a flood. They come from the dead sender's own address, as the board answers no other; what the host had
# sent is in `host.sent`.
_Flood = Callable[[Host], Iterator[bytes]]


def _random(head: bytes) -> _Flood:
    def datagrams(host: Host) -> Iterator[bytes]:
        rng = np.random.default_rng(7)
        while True:
            yield head + rng.bytes(int(rng.integers(0, 300 - len(head))))

    return datagrams


def _last(count: int) -> _Flood:
    return lambda host: itertools.cycle(host.sent[-count:])


def _damaged(host: Host) -> Iterator[bytes]:
    """The next datagrams of this very session, each with one bit turned."""
    for k in itertools.count():
        data = bytearray(host.adapter.seals.seal(b"\1" * 40))
        data[k % len(data)] ^= 64
        yield bytes(data)


def _strangers(host: Host) -> Iterator[bytes]:
    """Handshakes of somebody who has another key."""
    seals = HostSeals(bytes(32))
    while True:
        yield seals.ask()


def _another(host: Host) -> Iterator[bytes]:
    """Another program of the paired computer: it has the key, asks for the session, and tries to open one."""
    seals = HostSeals(host.board.key)
    while True:
        for answer in host.board.datagrams(host.socket):
            seals.unseal(answer)
        yield seals.ask()


def _rubbish_within(host: Host) -> Iterator[bytes]:
    """What a broken sender might say: rightly sealed and numbered, with rubbish for the protocol in it."""
    rng = np.random.default_rng(8)
    while True:
        for answer in host.board.datagrams(host.socket):
            host.adapter.seals.unseal(answer)  # the board's clock, so that nothing is stale
        yield host.adapter.seals.seal(rng.bytes(200))


WIFI_FLOODS: dict[str, _Flood] = {
    "random bytes": _random(b""),
    "random bytes behind each kind of head": lambda host: (
        b"DU" + bytes([1 + k % 6]) + data for k, data in enumerate(_random(b"")(host))
    ),
    "empty datagrams": lambda host: itertools.repeat(b""),
    "the last datagram again": _last(1),
    "the whole session again": lambda host: itertools.cycle(host.sent[1:]),
    "its handshake again": lambda host: itertools.cycle(
        [m for m in host.sent if m[2:3] in (bytes([Sealed.ASK]), bytes([Sealed.OPEN]))]
    ),
    "damaged datagrams of this session": _damaged,
    "handshakes without the key": _strangers,
    "handshakes with the key": _another,
    "rubbish, sealed in this session": _rubbish_within,
    "silence": lambda host: iter(()),
}


def wifi_flood(board: WifiBoard, name: str, silence_ms: int, seconds: float = SECONDS) -> Flooded:
    """Arm a board over Wi-Fi, drive it far from its safe pose, kill its sender, and flood its socket.

    Args:
        silence_ms: the board's own silence. seconds: of the flood, beyond that silence.
    """
    with Host(board, wire=far_and_safe(), watchdog_ms=str(silence_ms)) as host:
        host.arm()
        host.run(0.5, FAR)
        for message in host.adapter.command(np.full(8, FAR), board.now, None):
            host.send(message)
        last = board.now
        board.pulses.clear()
        datagrams = WIFI_FLOODS[name](host)
        for _ in range(round((seconds + silence_ms / 1e3) / 1e-3)):
            for data in itertools.islice(datagrams, A_MILLISECOND):
                host.socket.sendto(data, ("127.0.0.1", board.port))
            Board.run(board, 1e-3)
    return judged(board, name, last)

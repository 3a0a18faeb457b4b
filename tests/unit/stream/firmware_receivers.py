"""What receives packets, the sketch on a board or the virtual device, behind one face, so that both can be compared."""

from __future__ import annotations

from typing import Any

import numpy as np

from core.stream.protocols import packets
from core.stream.protocols.packets import Kind, Packet, Reach
from core.stream.virtual.native import NativeDevice
from tests.unit.stream.firmware_board import Board, servos

OWN, OTHER = 7, 9
WIRE = servos(2)
SAFE = np.array([10_000, 20_000], np.uint16)
SLEW = np.array([250, 250], np.uint16)
HELLO = packets.hello(2, bytes(8))
QUEUE = 125


def configuration(watchdog: int = 80, reach: int = Reach.RAMP, slew: Any = SLEW, safe: Any = SAFE) -> bytes:
    return packets.configure(watchdog, reach, np.asarray(safe, np.uint16), np.asarray(slew, np.uint16))


class Receiver:
    """What all have: a line, and a clock that the test turns a millisecond at a time."""

    def __init__(self) -> None:
        self.now, self.sequence, self.clock = 0.0, 0, (0, 0.0)
        self.decoder = packets.Decoder()

    def feed(self, data: bytes) -> bytes:
        raise NotImplementedError

    def pass_time(self, seconds: float) -> bytes:
        raise NotImplementedError

    def say(self, kind: int, body: bytes = b"", *, session: int = OWN, ahead: int = 1) -> list[tuple[Any, ...]]:
        """Send one packet, so many numbers after the last; return the answers."""
        if session == OWN and 0 < ahead <= 1024:
            self.sequence = (self.sequence + ahead) & 0xFFFF
            number = self.sequence
        else:
            number = self.sequence + ahead
        return self.hear(packets.pack(kind, session, number, body))

    def hear(self, data: bytes, seconds: float = 0.012) -> list[tuple[Any, ...]]:
        """Send bytes, let time pass; return the answers without what two devices cannot have in common."""
        answers = self.feed(data)
        for _ in range(round(seconds * 1000)):
            answers += self.pass_time(0.001)
        return [self.plain(packet) for packet in self.decoder.feed(answers)]

    def plain(self, packet: Packet) -> tuple[Any, ...]:
        kind = Kind(packet.kind).name
        if packet.kind == Kind.WELCOME:
            w = packets.Welcome.read(packet.body)
            self.clock = w.device_us, self.now
            pose = None if w.pose is None else w.pose.tolist()
            return kind, packet.session, packet.sequence, w.version, w.channels, w.state, w.queue, w.output_hz, pose
        if packet.kind == Kind.SYNCED:
            s = packets.Synced.read(packet.body)
            self.clock = s.device_us, self.now
            counters = (s.received, s.lost, s.damaged, s.late, s.watchdogs)
            return kind, packet.session, packet.sequence, s.host_us, s.state, s.queued, *counters
        return kind, packet.session, packet.sequence, packet.body.hex(" ")

    def soon(self, seconds: float) -> int:
        """Return the device's clock so much later than now [us]."""
        return self.clock[0] + round((self.now - self.clock[1] + seconds) * 1e6)

    def command(self, *counts: int, soon: float | None = None, **more: Any) -> list[tuple[Any, ...]]:
        play = 0 if soon is None else self.soon(soon)
        return self.say(
            Kind.COMMAND, packets.command(play, np.array(counts, np.uint16), timed=soon is not None), **more
        )


class Sketch(Receiver):
    """The sketch."""

    def __init__(self, board: Board) -> None:
        super().__init__()
        self.board = board

    def feed(self, data: bytes) -> bytes:
        self.board.send(data)
        return b""

    def pass_time(self, seconds: float) -> bytes:
        self.now += seconds
        return self.board.run(seconds)


class Virtual(Receiver):
    """The virtual device, with what the sketch says of itself."""

    def __init__(self) -> None:
        super().__init__()
        self.device = NativeDevice(WIRE, queue=QUEUE, output_hz=50)
        self.device.pose_known = False

    def feed(self, data: bytes) -> bytes:
        return b"".join(self.device.feed(data, self.now))

    def pass_time(self, seconds: float) -> bytes:
        self.now += seconds
        return b"".join(self.device.tick(self.now))


class Near:
    """A pose on the way: both clocks tick once a millisecond, and neither knows when the other's does."""

    LATE = 4  # ms: one of the tick, one of the line, and the same again for what was sent before

    def __init__(self, pose: list[int], slew: int, late: int = LATE) -> None:
        self.pose, self.most = pose, late * slew

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Near) and bool(np.abs(np.subtract(self.pose, other.pose)).max() <= self.most)

    def __repr__(self) -> str:
        return f"{self.pose} +- {self.most}"

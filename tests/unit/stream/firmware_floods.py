"""What may be on a line whose sender was killed, at the line's full pace, and how a board gets safe meanwhile."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from core.stream.protocols import packets
from core.stream.protocols.packets import Kind, Reach
from core.stream.protocols.wire import Wire
from tests.unit.stream.firmware_board import Board, Sender, servos

SLEW = 7.5  # [rad/s]: 3.75 us of pulse a millisecond, 75 us in a frame of 20 ms
FRAME_US = 75.0
ROUNDING_US = 1.0  # a tick of the board's is 0.5 us, and both pulses are rounded
FAR, SAFE = 0.8, -0.8  # [rad]
ARRIVES = 0.1 + (FAR - SAFE) / SLEW  # [s]
SECONDS = 0.6
_EIGHT = packets.command(0, np.full(8, 60_000, np.uint16), timed=False)


class Heard(NamedTuple):
    """What the sender had said before it was killed."""

    session: int
    sequence: int
    bytes: bytes


class Flooded(NamedTuple):
    """What a flood did.

    Attributes:
        begins: from the last valid packet to the first pulse that has moved towards safe, the slowest channel's [s].
        arrives: the same until the safe pose [s]. steepest: largest change between two pulses of a channel [us]; where
            others say SAFE, up to the safe pose, since the next SAFE begins a way of their own.
        overruns: bytes that the chip lost.
    """

    begins: float
    arrives: float
    steepest: float
    overruns: int


Flood = Callable[[Heard], Iterator[bytes]]


def _random(zeros: float) -> Flood:
    def blocks(heard: Heard) -> Iterator[bytes]:
        rng = np.random.default_rng(7)
        while True:
            data = rng.integers(1, 256, 512).astype(np.uint8)
            data[rng.random(512) < zeros] = 0
            yield data.tobytes()

    return blocks


def _same(block: bytes) -> Flood:
    return lambda heard: itertools.repeat(block)


def _others(kind: Kind, body: bytes) -> Flood:
    """Valid frames of all other sessions, in rising order."""

    def blocks(heard: Heard) -> Iterator[bytes]:
        for sequence in itertools.count():
            session = 1 + (heard.session + sequence % 254) % 255
            yield packets.pack(kind, session, sequence, body)

    return blocks


def _replay(heard: Heard) -> Iterator[bytes]:
    return itertools.repeat(heard.bytes)


def _again(ago: int) -> Flood:
    """Commands of this very session, from the one so many packets ago to the last."""

    def blocks(heard: Heard) -> Iterator[bytes]:
        for k in itertools.count():
            yield packets.pack(Kind.COMMAND, heard.session, heard.sequence - ago + k % (ago + 1), _EIGHT)

    return blocks


def _damaged(heard: Heard) -> Iterator[bytes]:
    """The next frames of this very session, each with one bit turned."""
    for sequence in itertools.count(heard.sequence + 1):
        frame = bytearray(packets.pack(Kind.COMMAND, heard.session, sequence, _EIGHT))
        frame[5 + sequence % 10] ^= 64
        yield bytes(frame)


def _taking_over(*kinds: Kind, slew: int = 1, safe: int = 60_000, reach: Reach = Reach.RAMP) -> Flood:
    """Other sessions that begin as soon as the board lets them, and configure it in their own way."""
    table = np.full(8, safe, np.uint16), np.full(8, slew, np.uint16)
    bodies = {Kind.HELLO: packets.hello(8, bytes(8)), Kind.CONFIGURE: packets.configure(80, reach, *table)}

    def blocks(heard: Heard) -> Iterator[bytes]:
        for turn in itertools.count():
            session = 1 + (heard.session + turn % 254) % 255
            for number, kind in enumerate(kinds):
                yield packets.pack(kind, session, turn * len(kinds) + number, bodies.get(kind, b""))

    return blocks


_LONG = bytes([255]) + bytes(range(1, 255)) + bytes(1)

FLOODS: dict[str, Flood] = {
    "00 01": _same(b"\0\1"),
    "84 00 00 2f": _same(b"\x84\0\0\x2f"),
    "01 00 7f 00": _same(b"\1\0\x7f\0"),
    "random bytes": _random(0.0),
    "random bytes, 30 % zeros": _random(0.3),
    "nothing but 00": _same(bytes(64)),
    "nothing but 01": _same(b"\1" * 64),
    "longest frames": _same(_LONG),
    "commands of other sessions": _others(Kind.COMMAND, _EIGHT),
    "HELLO of other sessions": _others(Kind.HELLO, packets.hello(8, bytes(8))),
    "SYNC of other sessions": _others(Kind.SYNC, bytes(4)),
    "commands of this session again": _again(200),
    "commands of a minute ago": _again(40_000),
    "the whole session again": _replay,
    "damaged commands of this session": _damaged,
    "HELLO and CONFIGURE of others, slew 1": _taking_over(Kind.HELLO, Kind.CONFIGURE),
    "HELLO and CONFIGURE of others, safe elsewhere": _taking_over(Kind.HELLO, Kind.CONFIGURE, slew=65_535),
    "HELLO and CONFIGURE of others, at once": _taking_over(Kind.HELLO, Kind.CONFIGURE, reach=Reach.AT_ONCE),
    "HELLO and CONFIGURE of others, release": _taking_over(Kind.HELLO, Kind.CONFIGURE, reach=Reach.RELEASE),
    "HELLO, CONFIGURE and SAFE of others, slew 1": _taking_over(Kind.HELLO, Kind.CONFIGURE, Kind.SAFE),
    "HELLO, CONFIGURE and SAFE of others, at once": _taking_over(
        Kind.HELLO, Kind.CONFIGURE, Kind.SAFE, reach=Reach.AT_ONCE
    ),
    "HELLO, CONFIGURE and SAFE of others, release": _taking_over(
        Kind.HELLO, Kind.CONFIGURE, Kind.SAFE, reach=Reach.RELEASE
    ),
    "silence": _same(b""),
}


def flood(board: Board, name: str, baud: float, seconds: float = SECONDS) -> Flooded:
    """Arm a board, drive it far from its safe pose, kill its sender, and flood the line."""
    said: list[bytes] = []
    sender = Sender(board, far_and_safe())
    plain = board.send
    board.send = lambda data: (said.append(data), plain(data))[1]  # type: ignore[method-assign]
    try:
        sender.arm()
        sender.command(np.full(8, FAR))
        sender.run(0.5)
        sender.command(np.full(8, FAR))
    finally:
        board.send = plain  # type: ignore[method-assign]
    adapter = sender.adapter
    last = board.now
    board.pulses.clear()
    heard = Heard(adapter._session, adapter._sequence, b"".join(said))
    blocks, most, data = FLOODS[name](heard), int(seconds * baud / 10), bytearray()
    while name != "silence" and len(data) < most:
        data += next(blocks)
    board.send(bytes(data[:most]))
    for _ in range(round(seconds / 0.02)):
        board.run(0.02)
    return judged(board, name, last)


def far_and_safe() -> Wire:
    """Return eight servos whose safe pose is `SAFE`."""
    values = {f"s{i}": {"value": SAFE, "unit": "rad"} for i in range(8)}
    return servos(slew=SLEW, safe={"reach": "ramp", "values": values})


def judged(board: Board, name: str, last: float) -> Flooded:
    """Judge the pulses of a board since its last valid packet, by a flood's name."""
    paths = [np.array(board.path(channel)) for channel in range(8)]
    arrives = max(_first(p, p[:, 1] < 1500 + 500 * SAFE + 1.0) for p in paths)
    within = [p[p[:, 0] <= arrives] if "SAFE" in name else p for p in paths]
    return Flooded(
        begins=max(_first(p, p[:, 1] < p[0, 1] - 0.5) for p in paths) - last,
        arrives=arrives - last,
        steepest=max(float(np.abs(np.diff(p[:, 1])).max()) for p in within),
        overruns=board.overruns,
    )


def _first(path: np.ndarray, those: np.ndarray) -> float:
    """Return when the first of some pulses ended [s]."""
    found = np.flatnonzero(those)
    return float(path[found[0], 0] + path[found[0], 1] * 1e-6) if found.size else float("inf")

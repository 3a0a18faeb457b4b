"""Random packets and random bytes: the sketch on the host against the virtual device, and against its sanitizers."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import pytest

from core.stream.protocols import packets
from core.stream.protocols.packets import Kind, Reach
from tests.unit.stream.firmware_board import ANIMATION_BAUD, Board, Sender, servos
from tests.unit.stream.firmware_host import HostBoard, hosted
from tests.unit.stream.firmware_receivers import HELLO, OTHER, OWN, SAFE, Near, Receiver, Sketch, Virtual, configuration

pytestmark = [hosted, pytest.mark.one_line("3.11", "the sketch is C++, compiled by the system's compilers")]

STEP = 0.012  # one packet, its answer and a NACK's pause have room in it [s]
WATCHDOGS = (18, 78)  # half a step from the nearest of them, so that both clocks agree on who was silent [ms]
SOON = (-0.054, 0.03, 0.306)  # the same for play-out times [s]
SLEWS = (1, 250, 2000)
LATE = 24  # ms: the sketch moves up to a pulse of 20 ms ahead of the line that the virtual device follows
SEEDS = [*range(12), *(pytest.param(seed, marks=pytest.mark.long) for seed in range(12, 400))]


class Episode:
    """Random steps, the same for each receiver that takes the same seed."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def pick(self, *of: Any) -> Any:
        return of[int(self.rng.integers(len(of)))]

    def counts(self) -> list[int]:
        return [int(n) for n in self.rng.integers(0, 65_536, 2)]

    def body(self, kind: int) -> bytes:
        """Return a body that mostly fits."""
        if self.rng.random() < 0.1:
            return self.rng.bytes(int(self.rng.integers(0, 36)))
        if kind == Kind.HELLO:
            return HELLO
        if kind == Kind.CONFIGURE:
            return configuration(self.pick(*WATCHDOGS), self.pick(*Reach), [self.pick(*SLEWS)] * 2, self.counts())
        return b"abcd" if kind == Kind.SYNC else b""

    def step(self, r: Receiver) -> list[Any]:
        kind = self.pick(0, 0, Kind.HELLO, Kind.CONFIGURE, Kind.ARM, Kind.SAFE, Kind.SYNC, Kind.COMMAND, 0x42)
        session = self.pick(OWN, OWN, OWN, OWN, OTHER, OTHER, 0)
        ahead = self.pick(1, 1, 1, 1, 1, 1, 0, 3, -5, 1024, 1025, 40_000)
        if kind == 0:
            rubbish = self.pick(b"", b"", self.rng.bytes(20) + b"\0")
            return r.hear(rubbish, STEP * self.pick(1, 3, 7, 20))
        if kind == Kind.COMMAND:
            soon = self.pick(None, *SOON)
            if soon is not None and not r.clock[0]:
                return []  # nobody has said what time it is
            return r.command(*self.counts(), soon=soon, session=session, ahead=ahead)
        return r.say(kind, self.body(kind), session=session, ahead=ahead)

    def play(self, r: Receiver) -> list[Any]:
        """Return all answers; the last two tell the poses where the device must stand whatever came before."""
        out = [self.step(r) for _ in range(60)]
        r.hear(b"", 0.2)
        begin = [(Kind.HELLO, HELLO), (Kind.CONFIGURE, configuration(slew=[2000, 2000])), (Kind.ARM, b"")]
        for kind, body in begin:
            r.sequence += 1
            out.append(r.hear(packets.pack(kind, 77, r.sequence, body)))
        for counts in ([30_000, 31_000], None):
            for _ in range(8):
                r.sequence += 1
                body = packets.command(0, np.array(counts or [0, 0], np.uint16), timed=False)
                kind = Kind.SYNC if counts is None else Kind.COMMAND
                out.append(r.hear(packets.pack(kind, 77, r.sequence, b"abcd" if counts is None else body)))
            r.sequence += 1
            out.append(r.hear(packets.pack(Kind.HELLO, 77, r.sequence, HELLO)))
            r.hear(b"", 0.2)
        r.sequence += 1
        return [*out, r.hear(packets.pack(Kind.HELLO, 77, r.sequence, HELLO))]


def near(answers: list[Any]) -> list[Any]:
    """Return answers whose poses may be of a device on its way."""
    out = []
    for answer in answers:
        pose = answer[-1] if answer[0] == "WELCOME" else None
        out.append((*answer[:-1], Near(pose, max(SLEWS), LATE)) if pose else answer)
    return out


@pytest.mark.parametrize("seed", SEEDS)
def test_random_packets_are_answered_as_by_the_virtual_device(seed: int) -> None:
    virtual = Episode(seed).play(Virtual())
    with HostBoard("-DDERMIS_CHANNELS=2", seed=seed) as board:
        sketch = Episode(seed).play(Sketch(board))
    for number, (ours, theirs) in enumerate(zip(sketch[:-1], virtual[:-1], strict=True)):
        assert near(ours) == near(theirs), f"step {number}: the sketch said {ours}, the virtual device {theirs}"
    assert sketch[-1] == virtual[-1] and sketch[-1][0][-1] == SAFE.tolist()


def noise(rng: np.random.Generator, sender: Sender) -> bytes:
    """Return some hundred bytes: random ones, valid packets of any kind, session and length, and damaged ones."""
    out = b""
    for _ in range(8):
        kind = int(rng.choice([1, 2, 3, 4, 5, 6, int(rng.integers(256))]))
        session = int(rng.choice([sender.adapter._session, int(rng.integers(256))]))
        sequence = sender.adapter._sequence + int(rng.choice([1, 2, int(rng.integers(65_536))]))
        body = rng.bytes(int(rng.choice([0, 4, 10, 21, 36, int(rng.integers(80))])))
        frame = bytearray(packets.pack(kind, session, sequence, body))
        if rng.random() < 0.3:
            frame[int(rng.integers(len(frame)))] ^= 1 << int(rng.integers(8))
        if rng.random() < 0.2:
            frame = frame[: int(rng.integers(len(frame)))]
        out += bytes(frame) + rng.bytes(int(rng.integers(0, 12))) * int(rng.random() < 0.2)
    return out


def armed(board: Board) -> Sender:
    """Return a sender that has armed the board; the first session that it draws may be one that the noise has used."""
    sender = Sender(board, servos(8))
    for _ in range(15):
        if not sender.adapter.ready:
            sender.run(0.1)
    sender.arm()
    return sender


@pytest.mark.parametrize("seed", SEEDS[:3] + SEEDS[12:100])
def test_random_bytes_do_no_harm_and_are_forgotten(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """No error of memory or arithmetic, no pulse out of range, and the next sender finds a board that works."""
    rng = np.random.default_rng(seed)
    monkeypatch.setattr(os, "urandom", rng.bytes)
    with HostBoard(seed=seed) as board:
        for _ in range(6):
            sender = armed(board)
            for _ in range(40):
                board.send(noise(rng, sender))
                sender.adapter._sequence += int(rng.integers(3))
                if rng.random() < 0.5:
                    sender.command(rng.uniform(-1, 1, 8), board.now + float(rng.uniform(-0.1, 0.2)))
                board.run(float(rng.uniform(0.0, 0.03)))
            board.run(0.3)
        assert board.pulses and all(999.9 <= width <= 2000.1 for _, _, width in board.pulses)
        assert not board.garbled
        armed(board)


@pytest.mark.parametrize("seed", SEEDS[:3])
def test_random_bytes_to_servo_animation_do_no_harm(seed: int) -> None:
    rng = np.random.default_rng(seed)
    with HostBoard("-DDERMIS_SERVO_ANIMATION", baud=ANIMATION_BAUD, seed=seed) as board:
        for _ in range(100):
            position = bytes([0x3C, int(rng.integers(12)), *divmod(int(rng.integers(900, 2100)), 256), 0x3E])
            board.send(position * int(rng.integers(2)) + rng.bytes(int(rng.integers(30))))
            board.run(0.01)
        board.run(1.0)
        assert board.pulses and all(999.9 <= width <= 2000.1 for _, _, width in board.pulses)
        assert board.now - board.pulses[-1][1] >= 0.45, "and it has let go"

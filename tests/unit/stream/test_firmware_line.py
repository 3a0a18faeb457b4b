"""The sketch's serial line: its pace, what the chip loses, answers without room, the queue."""

from __future__ import annotations

import numpy as np
import pytest

from core.stream.protocols import packets
from core.stream.protocols.packets import Kind
from tests.unit.stream.firmware_avr import AvrBoard, emulated
from tests.unit.stream.firmware_board import BAUD, Board, Chip, Sender, servos, wanted_us
from tests.unit.stream.firmware_host import every_chip, every_line

pytestmark = pytest.mark.one_line("3.11", "the sketch is C++, compiled by the system's compilers")


def saturate(board: Board, sender: Sender, channels: int, seconds: float, baud: float = BAUD) -> int:
    """Fill the line with commands, and with the signs of life that go with them; return how many commands."""
    room, count = 0.0, 0
    for _ in range(round(seconds / 0.01)):
        for message in sender.adapter.poll(board.now):
            board.send(message)
            room -= len(message)
        room += 0.01 * baud / 10
        while room > 0:
            message = sender.adapter.command(np.full(channels, 0.5 * np.sin(count / 100)), board.now, None)[0]
            board.send(message)
            room -= len(message)
            count += 1
        sender.adapter.receive(board.run(0.01), board.now)
    return count


@every_chip
@pytest.mark.parametrize("channels", [1, 2, 8])
def test_a_full_line_loses_nothing(chip: Chip, channels: int) -> None:
    with chip(f"-DDERMIS_CHANNELS={channels}") as board:
        sender = Sender(board, servos(channels))
        sender.arm()
        before = received(board, sender)
        sent = saturate(board, sender, channels, 0.5)
        sender.run(0.05)
        assert sent >= 700 and received(board, sender) - before == sent
        counters = sender.adapter.counters
        assert not counters["lost at the device"] and not counters["damaged at the device"] and not board.overruns
        if isinstance(board, AvrBoard):
            assert board.unused() >= 200, "bytes between variables and stack"


def received(board: Board, sender: Sender) -> int:
    """Ask the board how many commands it has taken."""
    return synced(board, sender).received


def synced(board: Board, sender: Sender) -> packets.Synced:
    board.run(0.01)
    board.send(sender.adapter._pack(Kind.SYNC, b"\1\2\3\4"))
    found = [p for p in packets.Decoder().feed(board.run(0.01)) if p.kind == Kind.SYNCED]
    return packets.Synced.read(found[-1].body)


@every_line
def test_a_loop_that_stood_still_loses_what_found_no_room_and_nothing_before_it(chip: Chip) -> None:
    with chip() as board:
        sender = Sender(board, servos())
        sender.arm()
        board.run(0.005)
        body = packets.configure(50, packets.Reach.RAMP, *np.ones((2, 8), np.uint16))
        size = len(sender.adapter._pack(Kind.CONFIGURE, body))
        fit = board.room // size
        frames = [sender.adapter._pack(Kind.CONFIGURE, body) for _ in range(fit + 2)]
        board.hang()
        board.send(b"".join(frames))
        board.run(0.01)
        board.go_on()
        found = packets.Decoder().feed(board.run(0.01))
        assert fit >= 2
        answers = [p.body for p in found if p.kind == Kind.STATE]
        assert answers == [packets.state(packets.DeviceState.ARMED, Kind.CONFIGURE)] * fit
        assert not board.overruns, "the program took each byte from the chip, and had no room for some"


@emulated
def test_at_a_million_baud_the_chip_loses_bytes() -> None:
    """So the emulator shows it, and 500,000 is what the sketch talks."""
    with AvrBoard("-DDERMIS_BAUD=1000000", baud=1e6) as board:
        sender = Sender(board, servos())
        sender.arm()
        saturate(board, sender, 8, 0.2, 1e6)
        assert board.overruns  # at 500,000 there are none; how many it is depends on the pace of this computer


@every_line
def test_another_baud_is_not_understood(chip: Chip) -> None:
    with chip(baud=115_200) as board:
        sender = Sender(board, servos())
        sender.run(0.3)
        assert not sender.adapter.ready and board.garbled


@every_line
def test_the_board_keeps_the_line_s_pace_in_its_answers(chip: Chip) -> None:
    """500 SYNCs at once: each answer has twice the bytes of its question, so the line has room for every second one."""
    with chip() as board:
        sender = Sender(board, servos(slew=7.5))
        sender.arm()
        sender.command(np.full(8, 0.8))
        asked = b"".join(sender.adapter._pack(Kind.SYNC, bytes([k % 251 + 1] * 4)) for k in range(500))
        board.send(asked)
        start, took = board.now, len(asked) * 10 / BAUD
        board.pulses.clear()
        answers = board.run(took)
        assert len(answers) <= took * BAUD / 10 + 3, "the emulated transmitter sends no faster than the line"
        answers += board.run(0.02)
        found = packets.Decoder().feed(answers)
        numbers = np.array([p.sequence for p in found])
        assert 150 <= len(found) < 450 and (np.diff(numbers) >= 1).all()
        assert numbers[-1] - numbers[0] >= len(found) + 50, "the number of an answer that was dropped stays used"
        path = np.array(board.path(0, start))
        assert np.abs(np.diff(path[:, 1])).max() >= 70, "and the servos keep moving meanwhile"


@every_chip
def test_a_hundred_commands_wait_for_their_time(chip: Chip) -> None:
    """Two channels at 1 kHz, a tenth of a second ahead, three times round the ring."""
    with chip("-DDERMIS_CHANNELS=2") as board:
        sender = Sender(board, servos(2))
        sender.arm()
        assert sender.adapter.queue >= 102
        sender.run(0.3)
        start, k = board.now + 0.11, 0
        board.pulses.clear()
        while k < 400:
            while k < 400 and start + k * 1e-3 <= board.now + 0.1:
                sender.command(np.array([1.0, -1.0]) * (k / 500), start + k * 1e-3)
                k += 1
            sender.run(0.005)
        sender.run(0.1)
        counters = sender.adapter.counters
        assert not counters["late at the device"] and not counters["refused: queue full"]
        for channel, sign in ((0, 1.0), (1, -1.0)):
            path = np.array(board.path(channel, start + 0.002))[:18]
            wanted = wanted_us(sign * (path[:, 0] - start) / 0.5)
            assert np.abs(path[:, 1] - wanted).max() <= 2.5, "2 us a millisecond"


@every_chip
def test_a_full_queue_refuses_and_what_it_took_is_counted(chip: Chip) -> None:
    with chip("-DDERMIS_CHANNELS=2") as board:
        sender = Sender(board, servos(2))
        sender.arm()
        sender.run(0.2)
        before = received(board, sender)
        for k in range(sender.adapter.queue + 5):
            sender.command([0.1, 0.1], board.now + 0.5 + k * 1e-3)
        sender.run(0.06)
        told = synced(board, sender)
        assert told.received - before == told.queued == sender.adapter.queue
        assert sender.adapter.counters["refused: queue full"] >= 1

"""The sketch when its sender is gone and the line is not silent, or when it stands still itself."""

from __future__ import annotations

import re

import numpy as np
import pytest

from core.stream.protocols.native import Native
from tests.unit.stream.firmware_avr import AvrBoard, emulated
from tests.unit.stream.firmware_board import ANIMATION_BAUD, BAUD, Board, Chip, Sender, servos
from tests.unit.stream.firmware_floods import ARRIVES, FAR, FLOODS, FRAME_US, ROUNDING_US, SLEW, flood
from tests.unit.stream.firmware_host import HostBoard, every_chip, every_line, hosted

pytestmark = pytest.mark.one_line("3.13", "the sketch is C++, compiled by the system's compilers")

OFTEN = ["00 01", "random bytes, 30 % zeros", "HELLO of other sessions", "the whole session again", "longest frames"]
OFTEN += [name for name in FLOODS if "CONFIGURE" in name]
SESSION = 43  # whose floods once met an interrupt that waited too long: one byte was lost, in one session of 255


@pytest.fixture(autouse=True)
def one_session(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every run hear the same bytes."""
    monkeypatch.setattr(Native, "_draw_session", lambda self: setattr(self, "_session", SESSION))


FLOODED = [pytest.param(HostBoard, name, id=f"host-{name}", marks=hosted) for name in FLOODS]
FLOODED += [
    pytest.param(AvrBoard, name, id=f"ATmega328P-{name}", marks=[emulated] + [pytest.mark.long] * (name not in OFTEN))
    for name in FLOODS
]


@pytest.mark.parametrize(("chip", "name"), FLOODED)
def test_safe_in_time_whatever_is_on_the_line(chip: Chip, name: str) -> None:
    with chip() as board:
        done = flood(board, name, BAUD)
    assert done.begins <= 0.1, f"begins after {done.begins * 1e3:.0f} ms"
    assert done.arrives <= ARRIVES, "and goes on to the safe pose"
    assert done.steepest <= FRAME_US + ROUNDING_US, f"{done.steepest} us from one pulse to the next"
    assert not done.overruns


@every_line
@pytest.mark.parametrize("name", ["random bytes, 30 % zeros", "00 01", "nothing but 3c"])
def test_servo_animation_lets_go_whatever_is_on_the_line(chip: Chip, name: str) -> None:
    with chip("-DDERMIS_SERVO_ANIMATION", baud=ANIMATION_BAUD) as board:
        board.send(bytes.fromhex("3c 00 05 dc 3e"))
        board.run(0.1)
        assert board.pulses
        rng = np.random.default_rng(1)
        noise = rng.integers(0, 256, 9000).astype(np.uint8)
        noise[rng.random(9000) < 0.3] = 0
        board.send({"00 01": b"\0\1" * 4500, "nothing but 3c": b"<" * 9000}.get(name, noise.tobytes()))
        board.run(0.7)
        assert 0.45 <= board.pulses[-1][1] <= 0.53


def moving(board: Board) -> Sender:
    """Arm a board and send it on a way of 0.2 s."""
    sender = Sender(board, servos(slew=SLEW))
    sender.arm()
    sender.command(np.full(8, FAR))
    sender.run(0.04)
    return sender


@every_chip
def test_a_loop_that_stood_still_makes_up_for_nothing(chip: Chip) -> None:
    with chip() as board:
        sender = moving(board)
        board.hang()
        board.run(0.1)
        board.go_on()
        sender.run(0.3)
        for channel in range(8):
            widths = np.array(board.path(channel))[:, 1]
            assert np.abs(np.diff(widths)).max() <= FRAME_US + ROUNDING_US


@every_chip
def test_the_way_to_safety_goes_on_where_a_loop_stood_still(chip: Chip) -> None:
    """All channels still arrive together, later by as long as it stood."""
    with chip() as board:
        sender = Sender(board, servos(slew=SLEW))
        sender.arm()
        far = np.linspace(0.1, FAR, 8)
        sender.command(far)
        sender.run(0.3)
        for message in sender.adapter.safe():
            board.send(message)
        board.run(0.03)
        board.hang()
        board.run(0.1)
        board.go_on()
        gone_on = board.now
        board.run(0.3)
        for channel, value in enumerate(far):
            path = board.path(channel, gone_on + 0.02)
            arrived = next(start for start, width in path if abs(width - 1500) <= 1.0)
            left = FAR / SLEW - 0.03
            assert left - 0.005 <= arrived - gone_on <= left + 0.025, channel
            shares = [(width - 1500) / (500 * value) * FAR for start, width in path if start < gone_on + left]
            wanted = [FAR - SLEW * (0.03 + start - gone_on) for start, _ in path if start < gone_on + left]
            assert np.abs(np.subtract(shares, wanted)).max() <= 0.006 * SLEW, "5 ms are made up for, and one is a tick"


@every_chip
def test_a_loop_that_hangs_is_reset_and_the_pulses_end(chip: Chip) -> None:
    with chip() as board:
        moving(board)
        hung = board.now
        board.hang()
        board.run(1.0)
        last = max(start for _, start, _ in board.pulses) - hung
        assert board.watchdog - 0.05 <= last <= board.watchdog + 0.03, "the chip's watchdog"
        board.go_on()
        board.run(0.3)
        board.meet_again()
        board.pulses.clear()
        sender = Sender(board, servos())
        sender.run(0.3)
        assert sender.adapter.ready and sender.adapter.pose is None and not board.pulses, "it has begun anew"
        sender.arm()
        sender.run(0.5)
        assert board.pulses and sender.adapter.armed, "and is not reset again"


@every_chip
def test_an_interrupt_of_the_pulses_that_dies_is_noticed(chip: Chip) -> None:
    with chip() as board:
        sender = moving(board)
        board.kill_pulses()
        sender.run(1.0)
        assert re.search("begun anew|not answered", sender.adapter.fault)
        board.pulses.clear()
        board.run(0.2)
        assert not board.pulses


@every_chip
def test_the_relay_is_on_while_armed_and_on_the_way_to_safety(chip: Chip) -> None:
    with chip("-DDERMIS_RELAY_PIN=12") as board:
        sender = Sender(board, servos(slew=SLEW))
        sender.run(0.1)
        assert [level for _, level, _ in board.levels] == [0]
        sender.arm()
        sender.command(np.full(8, FAR))
        sender.run(0.3)
        assert [level for _, level, _ in board.levels] == [0, 1]
        stopped = board.now
        for message in sender.adapter.safe():
            board.send(message)
        sender.run(0.5)
        pin, level, at = board.levels[-1]
        assert (pin, level) == (12, 0)
        assert FAR / SLEW + 0.1 <= at - stopped <= FAR / SLEW + 0.13, "a tenth of a second after each channel was there"
        for channel in range(8):  # supply that goes before the last pulses have come leaves servos short of it
            safe = [width for start, width in board.path(channel) if start <= at][-4:]
            assert np.abs(np.array(safe) - 1500).max() <= 1.0
        assert max(start for _, start, _ in board.pulses) <= at + 0.02, "no pulses into servos without supply"
        assert sender.adapter.ready
        sender.arm()
        assert board.levels[-1][1] == 1


@every_chip
def test_the_relay_opens_at_once_where_safe_means_to_let_go(chip: Chip) -> None:
    with chip("-DDERMIS_RELAY_PIN=12") as board:
        sender = Sender(board, servos(slew=SLEW, safe={"reach": "release"}))
        sender.arm()
        sender.command(np.full(8, FAR))
        sender.run(0.1)
        silent = board.now
        board.run(0.2)
        assert board.levels[-1][1] == 0 and board.levels[-1][2] - silent <= 0.09

"""The sketch with PCA9685 boards, on a model of their registers: pulses, OE as the safe state, boards that are gone."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.unit.stream.firmware_avr import AvrBoard, compile_sketch, emulated
from tests.unit.stream.firmware_board import SKETCH, Board, Chip, Sender, errors, servos, wanted_us
from tests.unit.stream.firmware_host import HostBoard, compile_for_host, hosted

pytestmark = [hosted, pytest.mark.one_line("3.11", "the sketch is C++, compiled by the system's compilers")]

OE = 12
COUNT_US = 122 / 25  # one of the 4096 of a cycle
SIXTEEN = ("-DDERMIS_PCA9685=1", "-DDERMIS_CHANNELS=16")
TWO = ("-DDERMIS_PCA9685=2", "-DDERMIS_CHANNELS=20", "-DHOST_LINE_BYTES=256")


def board_of(*defines: str, boards: int = 1, chip: Chip = HostBoard) -> Any:
    made = chip(*defines)
    made.boards(boards)
    made.run(0.1)
    return made


each = pytest.mark.parametrize(
    "chip", [pytest.param(AvrBoard, id="ATmega328P", marks=emulated), pytest.param(HostBoard, id="host", marks=hosted)]
)


def sender_of(board: Board, channels: int, **more: object) -> Sender:
    made = Sender(board, servos(channels, **more))  # type: ignore[arg-type]
    made.arm()
    return made


def test_the_registers_are_those_of_the_data_sheet() -> None:
    with board_of(*TWO, boards=2) as board:
        for k in (0, 1):
            found = {at: board.register(k, at) for at in (0x00, 0x01, 0xFE)}
            assert found == {0x00: 0x20, 0x01: 0x04, 0xFE: 121}, "awake, counting up, totem pole, 50 Hz"
            assert [board.register(k, 0x06 + 4 * c + 3) for c in range(16)] == [0x10] * 16, "no pulse before ARM"
        assert not board.pulses and board.levels[-1][:2] == (OE, 1)
        sender = sender_of(board, 20)
        sender.command(np.full(20, 0.5))
        sender.run(0.1)
        off = round(1750 / COUNT_US)
        assert [board.register(1, 0x06 + at) for at in range(4)] == [0, 0, off & 255, off >> 8]
        assert board.register(1, 0x06 + 4 * 4 + 3) == 0x10, "outputs that are no channel stay off"
        assert board.levels[-1][:2] == (OE, 0)


@pytest.mark.parametrize(("defines", "boards", "channels"), [(SIXTEEN, 1, 16), (TWO, 2, 20)])
def test_every_random_value_becomes_its_pulse(defines: tuple[str, ...], boards: int, channels: int) -> None:
    rng = np.random.default_rng(2)
    rounds = 10_000 // channels + 1
    worst = 0.0
    with board_of(*defines, boards=boards) as board:
        sender = sender_of(board, channels)
        sender.run(0.1)
        for values in rng.uniform(-1, 1, (rounds, channels)):
            sender.command(values)
            sender.run(0.025)
            board.pulses.clear()
            sender.run(0.045)
            widths = board.widths()
            assert len(widths) == channels
            worst = max(worst, max(abs(widths[c] - us) for c, us in enumerate(wanted_us(values))))
        assert not board.overruns and not sender.adapter.counters["lost at the device"]
    assert worst <= COUNT_US / 2 + 0.5, worst


def test_the_oscillator_of_a_board_can_be_told() -> None:
    with board_of(*SIXTEEN, "-DDERMIS_PCA9685_HZ=26400000") as board:
        board.oscillator(26.4e6)
        sender = sender_of(board, 16)
        sender.command(np.full(16, 0.25))
        sender.run(0.1)
        assert all(abs(width - 1625) <= COUNT_US / 2 + 0.5 for width in board.widths().values())


@pytest.mark.parametrize("hz", [23.5e6, 25e6, 26.5e6])
def test_no_pulse_is_further_from_the_one_before_than_the_speed_allows(hz: float) -> None:
    """Whatever comes down the line, and however fast the board's own oscillator runs."""
    with board_of(*SIXTEEN) as board:
        board.oscillator(hz)
        sender, rng = sender_of(board, 16, slew=4.0), np.random.default_rng(3)
        sender.run(0.1)
        board.pulses.clear()
        for _ in range(60):
            sender.command(np.sign(rng.uniform(-1, 1, 16)))
            sender.run(float(rng.uniform(0.005, 0.06)))
        board.run(0.5)  # and on the way to the safe pose
        scale = 25e6 / hz
        most = 500 * 4.0 * 0.022 * scale + COUNT_US * scale + 1
        for channel in range(16):
            path = np.array(board.path(channel))
            assert np.abs(np.diff(path[:, 1])).max() <= most
            assert abs(path[-1, 1] - 1500 * scale) <= COUNT_US, "the safe pose, by itself, and it is held"


@each
def test_silence_begins_the_way_to_the_safe_pose_within_100_ms(chip: Chip) -> None:
    with board_of(*SIXTEEN, chip=chip) as board:
        sender = sender_of(board, 16)
        sender.command(np.full(16, 0.8))
        sender.run(0.1)
        silent = board.now
        board.run(0.4)
        turned = [min(start for start, width in board.path(c, silent) if width < 1850) - silent for c in range(16)]
        assert all(0.03 <= at <= 0.1 for at in turned), turned
        assert board.levels[-1][:2] == (OE, 0), "the safe pose is held"


@each
@pytest.mark.parametrize("rubbish", ["noise", "zeros", "frames"])
def test_a_flood_after_the_sender_died_changes_nothing(rubbish: str, chip: Chip) -> None:
    rng = np.random.default_rng(4)
    flood = {"noise": rng.bytes(25_000), "zeros": bytes(25_000), "frames": bytes.fromhex("0001") * 12_500}[rubbish]
    with board_of(*SIXTEEN, chip=chip) as board:
        sender = sender_of(board, 16)
        sender.command(np.full(16, 0.8))
        sender.run(0.1)
        silent = board.now
        board.send(flood)
        board.run(0.5)
        turned = [min(start for start, width in board.path(c, silent) if width < 1850) - silent for c in range(16)]
        assert max(turned) <= 0.1, turned


@each
def test_letting_go_ends_every_pulse_at_once(chip: Chip) -> None:
    with board_of(*SIXTEEN, chip=chip) as board:
        sender = sender_of(board, 16, safe={"reach": "release"})
        sender.command(np.full(16, 0.8))
        sender.run(0.1)
        stopped = board.now
        for message in sender.adapter.retract() or []:
            board.send(message)
        board.run(0.3)
        assert board.levels[-1][:2] == (OE, 1) and board.levels[-1][2] - stopped < 0.005
        assert not [start for _, start, _ in board.pulses if start > stopped + 0.005]


@each
def test_a_hanging_loop_is_reset_and_its_resistor_ends_the_pulses(chip: Chip) -> None:
    with board_of(*SIXTEEN, chip=chip) as board:
        sender = sender_of(board, 16)
        sender.run(0.1)
        hung = board.now
        board.hang()
        board.run(0.6)
        assert max(start for _, start, _ in board.pulses) - hung <= 0.27


@pytest.mark.parametrize("present", [0, 1])
def test_a_board_that_is_not_there_is_never_armed(present: int) -> None:
    with board_of(*TWO, boards=present) as board:
        sender = Sender(board, servos(20))
        sender.run(0.1)
        assert sender.adapter.ready
        sender.adapter.arm()
        sender.run(0.3)
        assert not sender.adapter.armed and not board.pulses
        board.boards(2)
        sender.run(0.3)
        sender.adapter.arm()
        sender.run(0.2)
        assert sender.adapter.armed, "once it is there"


@pytest.mark.parametrize("how", ["unplugged", "stuck"])
def test_a_board_that_is_lost_under_way_ends_the_pulses_and_the_stream(how: str) -> None:
    with board_of(*TWO, boards=2) as board:
        sender = sender_of(board, 20)
        sender.command(np.full(20, 0.5))
        sender.run(0.1)
        lost = board.now
        if how == "unplugged":
            board.boards(1)
        else:
            board.hang_i2c(True)
        sender.run(0.3)
        assert board.levels[-1][:2] == (OE, 1) and board.levels[-1][2] - lost <= 0.06
        assert not sender.adapter.armed
        board.boards(2)
        board.hang_i2c(False)
        board.pulses.clear()
        sender.run(0.3)
        assert not board.pulses, "nothing moves before a person arms again"


@emulated
def test_random_values_become_their_pulses_on_the_emulated_uno() -> None:
    """Two boards; the line at its full pace meanwhile loses nothing to the bus's interrupts."""
    rng = np.random.default_rng(5)
    with board_of(*TWO[:2], boards=2, chip=AvrBoard) as board:
        sender = sender_of(board, 20)
        sender.run(0.1)
        for values in rng.uniform(-1, 1, (40, 20)):
            for _ in range(10):
                sender.command(values)
            sender.run(0.025)
            board.pulses.clear()
            sender.run(0.045)
            widths = board.widths()
            worst = max(abs(widths[c] - us) for c, us in enumerate(wanted_us(values)))
            assert len(widths) == 20 and worst <= COUNT_US / 2 + 0.5
        assert not board.overruns and not sender.adapter.counters["lost at the device"]
        board.boards(1)
        lost = board.now
        sender.run(0.2)
        assert board.levels[-1][:2] == (OE, 1) and board.levels[-1][2] - lost <= 0.06 and not sender.adapter.armed


def test_the_sketchs_own_example_of_a_relay_is_not_oe(tmp_path: Path) -> None:
    (pin,) = re.findall(r"^// #define DERMIS_RELAY_PIN (\w+)", SKETCH.read_text("utf-8"), re.M)
    done = compile_for_host(tmp_path / "sketch.so", *SIXTEEN, f"-DDERMIS_RELAY_PIN={pin}")
    assert not done.returncode and not done.stderr, done.stderr


@emulated
@pytest.mark.parametrize(
    "defines",
    [
        SIXTEEN,
        TWO[:2],
        ("-DDERMIS_PCA9685=2", "-DDERMIS_CHANNELS=32"),
        (*SIXTEEN, "-DDERMIS_RELAY_PIN=10"),
        (*SIXTEEN, "-DDERMIS_RELAY_PIN=A3"),
        (*SIXTEEN, "-DDERMIS_OE_PIN=11", "-DDERMIS_RELAY_PIN=12"),
    ],
)
def test_it_compiles_for_the_uno_without_a_warning(defines: tuple[str, ...]) -> None:
    done = compile_sketch(*defines)
    assert not done.returncode and not done.stderr, done.stderr


@pytest.mark.parametrize(
    ("defines", "said"),
    [
        (("DERMIS_PCA9685=1", "DERMIS_CHANNELS=17"), "so many PCA9685 boards have fewer channels"),
        (("DERMIS_PCA9685=63",), "the number of boards, 1 to 62"),
        (("DERMIS_PCA9685=1", "DERMIS_OE_PIN=3"), "this pin cannot be the boards' OE"),
        (("DERMIS_PCA9685=1", "DERMIS_RELAY_PIN=12"), "DERMIS_RELAY_PIN: this pin is the boards' OE"),
        (
            ("DERMIS_PCA9685=1", "DERMIS_OE_PIN=14", "DERMIS_RELAY_PIN=14"),
            "DERMIS_RELAY_PIN: this pin is the boards' OE",
        ),
    ],
)
def test_limits_are_named(defines: tuple[str, ...], said: str, tmp_path: object) -> None:
    done = compile_for_host(tmp_path / "sketch.so", *(f"-D{one}" for one in defines))  # type: ignore[operator]
    assert said in done.stderr


@emulated
@pytest.mark.parametrize(
    ("defines", "said"),
    [
        (("DERMIS_RELAY_PIN=12",), "DERMIS_RELAY_PIN: this pin is the boards' OE, choose another"),
        (("DERMIS_RELAY_PIN=A4",), "DERMIS_RELAY_PIN: this pin cannot be the relay's"),
        (("DERMIS_RELAY_PIN=A5",), "DERMIS_RELAY_PIN: this pin cannot be the relay's"),
        (("DERMIS_OE_PIN=A4",), "DERMIS_OE_PIN: this pin cannot be the boards' OE"),
        (("DERMIS_OE_PIN=A5",), "DERMIS_OE_PIN: this pin cannot be the boards' OE"),
        (("DERMIS_PCA9685=3", "DERMIS_CHANNELS=33"), "DERMIS_CHANNELS: this chip's memory is enough for 32"),
        (("DERMIS_PCA9685=3", "DERMIS_CHANNELS=40"), "DERMIS_CHANNELS: this chip's memory is enough for 32"),
        (("DERMIS_PCA9685=3", "DERMIS_CHANNELS=48"), "DERMIS_CHANNELS: this chip's memory is enough for 32"),
    ],
)
def test_the_uno_refuses_pins_that_have_another_use_and_more_servos_than_its_memory_holds(
    defines: tuple[str, ...], said: str
) -> None:
    given = defines if any("PCA9685" in one for one in defines) else ("DERMIS_PCA9685=1", *defines)
    found = errors(compile_sketch(*(f"-D{one}" for one in given)).stderr)
    assert found and said in found[0], found

"""The firmware on both boards, emulated and on the host: bytes in, pulse widths out, measured in clock cycles."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from core.stream.protocols import adapters
from tests.unit.stream.firmware_board import Board, Chip, Sender, servos, wanted_us
from tests.unit.stream.firmware_host import every_chip

pytestmark = [every_chip, pytest.mark.one_line("3.11", "the sketch is C++, compiled by the system's compilers")]

SERVOS = servos()
RESOLUTION = 5.0  # a hobby servo's dead band is about 5 us of pulse; the board's own step is 0.5 us


@pytest.fixture
def native(chip: Chip) -> Iterator[Board]:
    with chip() as board:
        yield board


def test_no_pulse_before_arming(native: Board) -> None:
    sender = Sender(native, SERVOS)
    sender.run(0.3)
    assert sender.adapter.ready and not native.pulses
    sender.command(np.full(8, 0.5))
    sender.run(0.1)
    assert not native.pulses and sender.adapter.counters["refused: not armed"] == 1
    sender.arm()
    widths = native.widths()
    assert sorted(widths) == list(range(8)) and all(abs(w - 1500) <= 1.0 for w in widths.values())


COUNTS = pytest.mark.parametrize(
    "frames", [pytest.param(60, id="480"), pytest.param(1250, id="10000", marks=pytest.mark.long)]
)


@COUNTS
def test_random_values_reach_the_servos(native: Board, frames: int) -> None:
    sender = Sender(native, SERVOS)
    sender.arm()
    worst, rng = 0.0, np.random.default_rng(1)
    for values in rng.uniform(-1, 1, (frames, 8)):
        sender.command(values)
        sender.run(0.005)
        native.pulses.clear()
        sender.run(0.025, 0.0125)
        widths = native.widths()
        assert sorted(widths) == list(range(8))
        worst = max(worst, max(abs(widths[i] - w) for i, w in enumerate(wanted_us(values))))
    assert worst <= 1.0 <= RESOLUTION, f"{worst} us"
    sender.run(0.1)
    counters = sender.adapter.counters
    assert not counters["lost at the device"] and not counters["damaged at the device"]


def test_silence_ends_in_the_safe_state_within_100_ms(native: Board) -> None:
    """A wire whose safe state is to let go: the pulses end."""
    sender = Sender(native, servos(safe={"reach": "release"}))
    sender.arm()
    sender.command(np.full(8, 0.5))
    sender.run(0.1)
    native.pulses.clear()
    silent = native.now
    native.run(0.5)
    last = max(start for _, start, _ in native.pulses)
    assert last - silent <= 0.1
    sender.adapter.receive(native.run(0.001), native.now)
    native.pulses.clear()
    sender.run(0.1)
    assert not native.pulses, "and it stays quiet until it is armed again"
    assert "by itself" in sender.adapter.fault


def test_ramp_to_the_safe_pose_at_the_allowed_speed(native: Board) -> None:
    preset = {"reach": "ramp", "values": {"s0": {"value": -0.5, "unit": "rad"}}}
    sender = Sender(native, servos(slew=2.0, safe=preset))
    sender.arm()
    assert abs(native.widths()[0] - 1250) <= 1.0, "before the first command the board stands where it is safe"
    sender.command(np.full(8, 0.5))
    sender.run(0.6)
    assert abs(native.widths()[0] - 1750) <= 1.0
    for message in sender.adapter.safe():
        native.send(message)
    start = native.now
    sender.run(0.8)
    path = [(t - start, w) for channel, t, w in native.pulses if channel == 0]
    assert abs(path[-1][1] - 1250) <= 1.0 and abs(native.pulses[-1][2] - 1500) <= 1.0
    # 2 rad/s of 2 rad in 65535 counts: 65 counts a millisecond once rounded down, 0.9918 us of pulse
    steepest = max((a[1] - b[1]) / (b[0] - a[0]) for a, b in zip(path, path[1:], strict=False))
    assert steepest <= 992 * 22 / 20, steepest  # from one pulse to the next millis() may count 22 of 20 ms
    moved = [t for t, w in path if 1260 < w < 1740]
    assert moved[-1] - moved[0] >= (480 - 2 * 20) / 992, "less the pulses at both ends"


def test_all_channels_begin_and_arrive_together_on_the_way_to_safety(native: Board) -> None:
    """A platform whose channels come home one by one tilts."""
    sender = Sender(native, servos(slew=4.0))
    sender.arm()
    far = np.array([0.9, -0.9, 0.45, 0.3, -0.2, 0.1, 0.02, 0.0])
    sender.command(far)
    sender.run(0.4)
    native.pulses.clear()
    for message in sender.adapter.safe():
        native.send(message)
    start = native.now
    sender.run(0.4)
    for channel, value in enumerate(far):
        for at, width in native.path(channel):
            part = min(max((at - start) * 4.0 / 0.9, 0.0), 1.0)
            assert abs(width - (1500 + 500 * value * (1 - part))) <= 5.0 * abs(value) + 1.0, (channel, at - start)


def test_timed_commands_wait_for_their_time(native: Board) -> None:
    sender = Sender(native, SERVOS)
    sender.arm()
    sender.run(0.5)
    play = native.now + 0.06
    sender.command(np.full(8, 0.8), play)
    native.pulses.clear()
    sender.run(0.2)
    turned = [start for channel, start, width in native.pulses if width > 1700]
    assert min(turned) >= play - 0.002 and min(turned) <= play + 0.0225, "from the channel's next pulse on"
    sender.command(np.full(8, -0.8), native.now - 0.01)
    sender.run(0.1)
    assert sender.adapter.counters["late at the device"] == 1 and abs(native.widths()[3] - 1100) <= 1.0


def test_damage_is_refused_and_does_not_spread(native: Board) -> None:
    sender, rng = Sender(native, SERVOS), np.random.default_rng(3)
    sender.arm()
    for k in range(200):
        frame = bytearray(sender.adapter.command(np.full(8, 0.9), native.now, None)[0])
        frame[1 + int(rng.integers(len(frame) - 2))] ^= 1 << int(rng.integers(8))
        native.send(bytes(frame))
        sender.command(np.full(8, -0.5 if k % 2 else 0.5))
        sender.run(0.025, 0.0125)
        assert all(width < 1751 for _, _, width in native.pulses), "a damaged packet was believed"
    native.pulses.clear()
    sender.run(0.03)
    assert all(abs(w - 1250) <= 1.0 for w in native.widths().values())
    assert sender.adapter.counters["damaged at the device"] >= 200


def test_another_sender_is_refused_while_one_is_armed(native: Board) -> None:
    one = Sender(native, SERVOS)
    one.arm()
    two = adapters.make("native", SERVOS, {})
    two.opened(native.now)
    two._session = (one.adapter._session % 255) + 1  # type: ignore[attr-defined]
    for message in two.poll(native.now):
        native.send(message)
    answers = native.run(0.01)
    two.receive(answers, native.now)
    assert not two.ready and "in use by another sender" in two.fault


def test_a_board_with_another_number_of_channels_is_named(native: Board) -> None:
    sender = Sender(native, servos(3))
    sender.run(0.1)
    assert "it has 8 channels" in sender.adapter.fault


@pytest.mark.parametrize("count", [1, 2, 6])
def test_as_many_channels_as_the_device_has(chip: Chip, count: int) -> None:
    """Fewer than eight: a pulse each 20 ms all the same, and the handshake accepts a preset with as many."""
    with chip(f"-DDERMIS_CHANNELS={count}") as board:
        sender = Sender(board, servos(count))
        sender.arm()
        wanted = np.linspace(-0.9, 0.9, count)
        sender.command(wanted)
        sender.run(0.05)
        board.pulses.clear()
        sender.run(0.2)
        assert {c for c, _, _ in board.pulses} == set(range(count))
        for channel in range(count):
            starts, widths = zip(*board.path(channel), strict=True)
            assert np.abs(np.array(widths) - wanted_us(wanted)[channel]).max() <= 1.0
            assert np.abs(np.diff(starts) - 0.02).max() <= 20e-6, "40000 ticks less the remainder of a division"

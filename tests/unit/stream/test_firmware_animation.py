"""The sketch as a receiver of Blender Servo Animation, on both boards."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from core.stream.protocols import adapters
from tests.unit.stream.firmware_board import ANIMATION_BAUD, Board, Chip, servos, wanted_us
from tests.unit.stream.firmware_host import every_line

pytestmark = [every_line, pytest.mark.one_line("3.11", "the sketch is C++, compiled by the system's compilers")]

RESOLUTION = 5.0  # a hobby servo's dead band is about 5 us of pulse; a position of this protocol is 1 us


@pytest.fixture
def animation(chip: Chip) -> Iterator[Board]:
    with chip("-DDERMIS_SERVO_ANIMATION", baud=ANIMATION_BAUD) as board:
        yield board


@pytest.mark.parametrize("frames", [pytest.param(60, id="480"), pytest.param(1250, id="10000", marks=pytest.mark.long)])
def test_random_values_reach_the_servos(animation: Board, frames: int) -> None:
    sender, rng, worst = adapters.make("servo-animation", servos(), {}), np.random.default_rng(2), 0.0
    for k, values in enumerate(rng.uniform(-1, 1, (frames, 8))):
        for message in sender.command(values, k * 0.03, None):
            animation.send(message)
        animation.run(0.006)
        animation.pulses.clear()
        animation.run(0.022)
        widths = animation.widths()
        assert sorted(widths) == list(range(8))
        worst = max(worst, max(abs(widths[i] - w) for i, w in enumerate(wanted_us(values))))
    moved = sender.counters["positions moved off the byte 0x3C"]
    assert worst <= 2.5 <= RESOLUTION, worst
    assert moved > 10 or frames < 1000, "four of the thousand positions hold the byte"


def test_no_pulse_on_a_channel_that_nobody_has_commanded(animation: Board) -> None:
    """A pulse of 1500 us to a servo that was not asked to move is a jump, at full speed, to where it may press."""
    sender = adapters.make("servo-animation", servos(2), {"first": "3"})
    for seconds in (0.2, 0.8, 0.2):  # the one in between ends the pulses
        for message in sender.command(np.array([0.5, -0.5]), animation.now, None):
            animation.send(message)
        animation.run(seconds)
        assert sorted(animation.widths()) == [3, 4]
    animation.run(0.8)
    animation.pulses.clear()
    for message in adapters.make("servo-animation", servos(1), {}).command(np.array([0.1]), 0.0, None):
        animation.send(message)
    animation.run(0.2)
    assert sorted(animation.widths()) == [0], "nor is what others were told before the silence taken up again"
